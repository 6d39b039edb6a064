// SPDX-License-Identifier: Apache-2.0
//
// Builds a KdTree with the surface area heuristic by an exact sweep: every plane at which a
// reference begins or ends is a candidate, in sorted lists that are kept sorted on the way down
// (O(n log n) for n triangles), in parallel. Paper 000, section 3.2 names the one parameter that
// controls such a tree, the cost ratio; paper 001 adds the depth rule and least leaf sizes.
//
// The result depends on the geometry and the options alone: not on the number of threads.
//
// Thread safety: functions only; several builds may run at once.
//
//   absl::StatusOr<KdTree> tree = BuildKdTree(geometry, {.traversal_cost = 0.5f}, pool, cancel);
#ifndef SIGHTLINE_CORE_ACCEL_KD_BUILDER_H_
#define SIGHTLINE_CORE_ACCEL_KD_BUILDER_H_

#include <cstdint>
#include <functional>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

inline constexpr float kMinKdTraversalCost = 0.01f, kMaxKdTraversalCost = 10.0f;
inline constexpr int kMaxKdLeafTriangles = 1 << 20;
inline constexpr float kMaxKdReferences = 64.0f;

struct KdBuildOptions {  // Speed and memory only, all of these.
  // Cost of visiting one inner node, in units of one triangle's test: kMinKdTraversalCost ..
  // kMaxKdTraversalCost. Less makes deeper trees with fewer triangles in a leaf. (Paper 000 plots
  // the inverse: intersection over traversal, 0.1 .. 100.) The default is what walks were fastest
  // with (core/traverse/DESIGN.md).
  float traversal_cost = 2.0f;
  // Cuts triangles to the cell instead of their boxes: fewer references and tighter leaves for
  // large slanted triangles, for 24 more bytes a node and closest hits that look further
  // (kd_tree.h, 3).
  bool perfect_splits = false;
  // Cells of so few triangles, or fewer, stay whole: 1 .. kMaxKdLeafTriangles.
  int min_leaf_triangles = 1;
  // Cells of more are split even where the heuristic would not, while depth and references allow
  // and a plane takes something off; 0: none are. 0, or min_leaf_triangles .. kMaxKdLeafTriangles.
  int max_leaf_triangles = 0;
  // Inner nodes on a path: 1 .. kMaxKdDepth; 0: PBRT's rule, 8 + 1.3 log2(triangles).
  int max_depth = 0;
  // Bound on memory: references over triangles, 1 .. kMaxKdReferences. A cell's share is handed
  // down in proportion; a split that would exceed it is not made.
  float max_references = 6.0f;
  // Bound on memory as such, which nodes and leaves take more of than references do: bytes of the
  // tree (KdTree::MemoryBytes); 0: none. Handed down likewise, and a split that would exceed it is
  // not made: so a tree that comes to it ends in larger leaves. A root that is one leaf is always
  // made, whatever it takes.
  uint64_t max_bytes = 0;
  // Not read here: whoever keeps the tree lays its leaves' triangles out beside it (kd_leaves of
  // IndexedGeometry), 64 bytes for each that a leaf names, for walks that cull within leaves.
  bool lay_out_leaves = false;
};

// InvalidArgument naming what is out of range, its value and the range.
absl::Status ValidateKdOptions(const KdBuildOptions& options);

// `progress`, if set, is called now and then with a share in [0, 1], possibly from several threads.
// Errors: InvalidArgument (ValidateKdOptions), ResourceExhausted (more nodes or references than a
// tree numbers), Cancelled / DeadlineExceeded from `cancel`.
absl::StatusOr<KdTree> BuildKdTree(const SceneGeometry& geometry, const KdBuildOptions& options,
                                   ThreadPool& pool, const CancelToken* cancel = nullptr,
                                   const std::function<void(double)>& progress = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_KD_BUILDER_H_
