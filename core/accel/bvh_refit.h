// SPDX-License-Identifier: Apache-2.0
//
// Fits a tree to triangles that moved: the nodes and leaves stay what they were, their boxes and
// corners become those of the new positions. A tenth of a build's time, and as good a tree as long
// as neighbours stay neighbours (`Bvh::cost_growth` says how good).
//
// Thread safety: functions only; several may run at once, over different trees.
//
//   absl::StatusOr<Bvh> next = RefitBvh(scene.bvh, moved, pool);
//   if (next.ok() && next->cost_growth > kMaxRefitGrowth) next = BuildBvh(moved, options, pool);
#ifndef SIGHTLINE_CORE_ACCEL_BVH_REFIT_H_
#define SIGHTLINE_CORE_ACCEL_BVH_REFIT_H_

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/accel/bvh.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// Beyond this a new tree pays within a picture or two: a build takes about a quarter of the time of
// a picture of two million pixels with three lights.
inline constexpr double kMaxRefitGrowth = 1.25;

// Whether the tree over `before` can be fitted to `now`: as many triangles, and the same of them
// inert. The caller knows that their indices are the same.
bool CanRefit(const SceneGeometry& before, const SceneGeometry& now);

// A tree over `geometry` with the nodes and leaves of `bvh`: what ValidateBvh asks of a built one
// holds for it. Errors: Cancelled / DeadlineExceeded from `cancel`. REQUIRES: CanRefit(the geometry
// that `bvh` is over, `geometry`), with the same indices.
absl::StatusOr<Bvh> RefitBvh(const Bvh& bvh, const SceneGeometry& geometry, ThreadPool& pool,
                             const CancelToken* cancel = nullptr);

// The same in place, for who owns the tree alone. After an error the tree is of no use: boxes of
// before and of now stand side by side. REQUIRES: nothing of the tree is borrowed from a file.
absl::Status RefitBvhInPlace(const SceneGeometry& geometry, ThreadPool& pool, Bvh* bvh,
                             const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BVH_REFIT_H_
