// SPDX-License-Identifier: Apache-2.0
//
// Builds a BinaryBvh as paper 004 does (section 2): from scratch, by the surface area heuristic
// over equally wide bins along the longest axis of the centroids' box, with its four rules to stop.
// From the root down in parallel; the tree depends on the geometry and the options alone.
//
// The heuristic is its equation (1): 2 + r·(A_L·n_L + A_R·n_R)/A for a split against r·n for a
// leaf, in units of one traversal step, r being the cost ratio (intersection over traversal).
//
// Thread safety: functions only; several builds may run at once.
//
//   absl::StatusOr<BinaryBvh> bvh = BuildBinaryBvh(geometry, {.bins = 8}, pool, cancel);
#ifndef SIGHTLINE_CORE_ACCEL_BINARY_BVH_BUILDER_H_
#define SIGHTLINE_CORE_ACCEL_BINARY_BVH_BUILDER_H_

#include <cstdint>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/accel/binary_bvh.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

inline constexpr int kMaxBinaryBvhBins = 1024;
inline constexpr float kMinCostRatio = 0.001f, kMaxCostRatio = 1000.0f;

struct BinaryBvhOptions {  // Speed and memory only, all of these.
  // 2 .. kMaxBinaryBvhBins. Two are the middle of the centroids' box. Paper 004 finds 8 enough.
  int bins = 8;
  // Intersection over traversal: kMinCostRatio .. kMaxCostRatio. Less makes larger leaves. Paper
  // 004 finds 1 best for scenes that stay and 0.1 for scenes rebuilt for every picture.
  float cost_ratio = 1.0f;
  // The four rules that end a branch: so few triangles (1 .. 2^20); so deep (1 ..
  // kMaxBinaryBvhDepth); a leaf is cheaper than the best split (switched off where trees of a given
  // leaf size are wanted, as in paper 001); the centroids' box no longer than this share of the
  // scene's (0 .. 1; one rounding of the scene's extent by default, below which centroids cannot
  // tell triangles apart).
  int min_triangles = 1;
  int max_depth = 64;
  bool stop_by_cost = true;
  float min_extent = 0x1p-23f;
};

// InvalidArgument naming what is out of range, its value and the range.
absl::Status ValidateBinaryBvhOptions(const BinaryBvhOptions& options);

// Errors: InvalidArgument (ValidateBinaryBvhOptions), ResourceExhausted (more than 2^31 triangles
// that can be hit), Cancelled or DeadlineExceeded from `cancel`.
absl::StatusOr<BinaryBvh> BuildBinaryBvh(const SceneGeometry& geometry,
                                         const BinaryBvhOptions& options, ThreadPool& pool,
                                         const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BINARY_BVH_BUILDER_H_
