// SPDX-License-Identifier: Apache-2.0
//
// A bounding volume hierarchy of two children a node and leaves of any size: the papers' own
// structure (000, 001 and 004), for walks that cull within large leaves. The engine's ordinary BVH
// (bvh.h) is eight wide and holds at most sixteen triangles in a leaf.
//
// Layout: nodes[0] is the root; an inner node's children stand side by side; a leaf names a range
// of `ids`, which ascend within it. Boxes hold the stored floats of their triangles exactly. Every
// triangle that is not inert stands in one leaf.
//
// Thread safety: immutable after construction.
//
//   const BinaryBvhNode& node = bvh.nodes[0];
//   if (node.is_leaf()) Test(bvh.leaves, node.first, node.count);
#ifndef SIGHTLINE_CORE_ACCEL_BINARY_BVH_H_
#define SIGHTLINE_CORE_ACCEL_BINARY_BVH_H_

#include <cstddef>
#include <cstdint>

#include "core/accel/leaf_triangles.h"
#include "core/base/aligned_vector.h"
#include "core/geometry/box3.h"

namespace sightline {

struct BinaryBvhNode {
  float lo[3];
  uint32_t first;  // Inner: the left child, the right one following. Leaf: its first place.
  float hi[3];
  uint32_t count;  // 0: an inner node.

  bool is_leaf() const { return count != 0; }
  Box3f box() const { return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}}; }
};
static_assert(sizeof(BinaryBvhNode) == 32);

struct BinaryBvh {
  AlignedVector<BinaryBvhNode> nodes;  // Empty for a scene with nothing to hit.
  AlignedVector<uint32_t> ids;
  LeafTriangles leaves;  // Of `ids`.
  uint32_t leaf_count = 0;
  uint32_t max_depth = 0;  // Inner nodes on the longest path from the root, the root included.

  bool empty() const { return nodes.empty(); }
  // Without the leaves' triangles, which is how the papers count.
  size_t TreeBytes() const {
    return nodes.size() * sizeof(BinaryBvhNode) + ids.size() * sizeof(uint32_t);
  }
  size_t MemoryBytes() const { return TreeBytes() + leaves.MemoryBytes(); }
};

// Bound of max_depth that the builder keeps: a depth-first walk has one sibling pending per level.
inline constexpr uint32_t kMaxBinaryBvhDepth = 96;

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BINARY_BVH_H_
