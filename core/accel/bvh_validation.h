// SPDX-License-Identifier: Apache-2.0
//
// Structural validation: a Bvh says what its geometry says. Used by tests, and by whatever reads a
// structure it did not build.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_CORE_ACCEL_BVH_VALIDATION_H_
#define SIGHTLINE_CORE_ACCEL_BVH_VALIDATION_H_

#include <cstdint>

#include "absl/status/status.h"
#include "core/accel/bvh.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// OK when: every reference is in range and every node and leaf is reached exactly once; depths are
// within kMaxBvhDepth; every triangle that is not inert stands in exactly one leaf with its stored
// corners, bit for bit; every box is exactly the union of what is below it; empty slots are last
// and inverted; counts agree. Mates are not looked at. Otherwise DataLoss naming a fault; Cancelled
// or DeadlineExceeded from `cancel`. Linear, in parallel within the calling thread's pool.
// REQUIRES: the geometry's own indices are in range, `inert` among them.
absl::Status ValidateBvh(const Bvh& bvh, const SceneGeometry& geometry,
                         const CancelToken* cancel = nullptr);

// At most the memory that takes meanwhile, about, of a sound tree of so many units of leaves.
uint64_t BvhValidationBytes(uint64_t triangles, uint64_t nodes, uint64_t units);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BVH_VALIDATION_H_
