// SPDX-License-Identifier: Apache-2.0
//
// The binary tree that the BVH builder makes first, and that is then gathered into wide nodes.
// Private to core/accel.
//
// The tree's shape, and the order of `ids`, depend on the primitives and the options alone. Where
// its nodes stand in `nodes` depends on the timing of the threads: follow the links.
//
// Thread safety: a tree is built by one call, then read.
//
//   BinaryTree tree = BuildBinaryTree(geometry, cost, options, cancel, progress);
#ifndef SIGHTLINE_CORE_ACCEL_BINARY_TREE_H_
#define SIGHTLINE_CORE_ACCEL_BINARY_TREE_H_

#include <cstdint>
#include <functional>

#include "core/accel/build_primitive.h"
#include "core/accel/sah_split.h"
#include "core/accel/wide_cost.h"
#include "core/base/aligned_vector.h"
#include "core/base/cancel.h"
#include "core/base/sparse_array.h"
#include "core/mesh/scene_geometry.h"

namespace sightline::bvh_build {

struct alignas(64) BinaryNode {
  float lo[3];
  uint32_t
      first;  // Inner: the left child; the right one follows it. Leaf: its first place in `ids`.
  float hi[3];
  uint32_t count;  // Triangles below.
  WideCost wide;   // What its triangles cost as children of an eight-wide node.

  void SetBox(const BuildBox& box) {
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = box.lo(axis);
      hi[axis] = box.hi(axis);
    }
  }
  float HalfArea(float scale) const {
    const float x = (hi[0] - lo[0]) * scale, y = (hi[1] - lo[1]) * scale,
                z = (hi[2] - lo[2]) * scale;
    return (x * y + y * z) + z * x;
  }
};
static_assert(sizeof(BinaryNode) == 64);

struct BinaryTree {
  SparseArray<BinaryNode> nodes;  // nodes[0] is the root.
  AlignedVector<uint32_t> ids;    // Each leaf's triangles together, each subtree's too.
};

struct BinaryTreeOptions {
  int bins = 16;
  bool longest_axis_only = false;
  bool cells = false;        // Small ranges by the cells of a grid (range_cells.cc): faster.
  bool full_leaves = false;  // Whatever fits a leaf becomes one.
  int max_depth = 64;        // Inner nodes on a path. REQUIRES: >= kMinDepthBound.
};
inline constexpr int kMinDepthBound = 64;

// Over the triangles of `geometry` that are not inert. Incomplete once `cancel` has fired.
// `progress` is called with the share of triangles placed. REQUIRES: there are some, fewer than
// 2^31.
//
// By the binned surface area heuristic from the root down: the better tree.
BinaryTree BuildBinaryTree(const SceneGeometry& geometry, const SahCost& cost,
                           const BinaryTreeOptions& options, const CancelToken* cancel,
                           const std::function<void(double)>& progress);
// The upper part over the cells of a grid, by the same heuristic (grid_tree.cc): faster.
BinaryTree BuildGridTree(const SceneGeometry& geometry, const SahCost& cost,
                         const BinaryTreeOptions& options, const CancelToken* cancel,
                         const std::function<void(double)>& progress);

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_BINARY_TREE_H_
