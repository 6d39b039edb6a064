// SPDX-License-Identifier: Apache-2.0
//
// Builds a Bvh with the binned surface area heuristic over centroid bounds (paper 004, section
// 2.1), in parallel with TBB, and gathers the binary tree into eight-wide nodes.
//
// The result depends on the geometry and the options alone: not on the number of threads.
//
// Thread safety: functions only; several builds may run at once.
//
//   absl::StatusOr<Bvh> bvh =
//       BuildBvh(geometry, BvhPresetOptions(BvhPreset::kDynamic), pool, cancel);
#ifndef SIGHTLINE_CORE_ACCEL_BVH_BUILDER_H_
#define SIGHTLINE_CORE_ACCEL_BVH_BUILDER_H_

#include <cstdint>
#include <functional>

#include "absl/status/statusor.h"
#include "core/accel/bvh.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

inline constexpr float kMaxTraversalCost = 1000.0f;

// What a build favours. Answers are the same with all of them.
enum class BvhPreset : uint8_t {
  kStatic,   // The best tree: for scenes that are queried much more than they change.
  kDynamic,  // The fastest build: for scenes that change before every few pictures.
  kCompact,  // The least memory: leaves name their triangles, and walks fetch the corners.
};

struct BvhBuildOptions {        // As made, those of kStatic.
  int bins = 16;                // 2 .. 256 per axis. Speed and quality only, like all of these.
  int max_leaf_triangles = 16;  // 1 .. kMaxLeafTriangles.
  // Cost of one node visit, its eight boxes together, in units of testing one full leaf:
  // 0 .. kMaxTraversalCost.
  float traversal_cost = 1.0f;
  bool longest_axis_only = false;  // Paper 004's choice for rebuilt scenes: one axis, fewer bins.
  // Whatever fits a leaf becomes one, instead of being split where that is expected to pay: a third
  // less time to build, and pictures as fast (within 3 %, some faster).
  bool full_leaves = true;
  // Upper levels and small ranges over the cells of grids, several levels at once: another half
  // less.
  bool grid = false;
  // Whether leaves hold their triangles' corners. Without, they hold ids alone: 4 bytes a triangle
  // instead of 40, and a walk has to gather the corners of every leaf that it visits.
  bool leaf_rows = true;
  // Whether it finds out which triangles share an edge (leaf_mates.h): 13 bytes a triangle, and
  // two to seven tenths of the time again, for shadows behind what many triangles make up.
  bool mates = true;
  // Not for the builder, but for an edit that only moves vertices (core/scene/scene.h): whether it
  // fits the tree before to them (bvh_refit.h), as long as that is about as good as a new one.
  bool refit = false;
};

BvhBuildOptions BvhPresetOptions(BvhPreset preset);

// `progress`, if set, is called now and then with a share in [0, 1], possibly from several threads.
// Errors: InvalidArgument (options out of range), ResourceExhausted (more leaf units than ChildRef
// holds), Cancelled / DeadlineExceeded from `cancel`.
absl::StatusOr<Bvh> BuildBvh(const SceneGeometry& geometry, const BvhBuildOptions& options,
                             ThreadPool& pool, const CancelToken* cancel = nullptr,
                             const std::function<void(double)>& progress = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BVH_BUILDER_H_
