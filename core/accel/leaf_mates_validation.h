// SPDX-License-Identifier: Apache-2.0
//
// Structural validation: mates say what their tree says. Used by tests, and by whatever reads mates
// that it did not find itself: answers rest on them (core/traverse/patch_cover-inl.h).
//
// Thread safety: functions only.
#ifndef SIGHTLINE_CORE_ACCEL_LEAF_MATES_VALIDATION_H_
#define SIGHTLINE_CORE_ACCEL_LEAF_MATES_VALIDATION_H_

#include "absl/status/status.h"
#include "core/accel/bvh.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// OK when there are none, or: `units` says of each unit which leaf it belongs to; every mate is a
// triangle of the tree, one of whose edges has both ends where this edge has them, runs as it is
// said to, and has this triangle for its mate; unused lanes have none. That edges which could have
// mates have them is not asked. Otherwise DataLoss naming a fault; Cancelled or DeadlineExceeded
// from `cancel`. Linear, in parallel within the calling thread's pool; needs no memory. REQUIRES:
// ValidateBvh and ValidateGeometry are OK.
absl::Status ValidateLeafMates(const Bvh& bvh, const SceneGeometry& geometry,
                               const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_LEAF_MATES_VALIDATION_H_
