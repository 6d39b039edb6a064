// SPDX-License-Identifier: Apache-2.0
//
// Whether a binary BVH is one of a given geometry: what binary_bvh.h promises, checked. For tests,
// and for trees that come from files.
//
// Thread safety: functions only.
//
//   SL_RETURN_IF_ERROR(ValidateBinaryBvh(bvh, geometry));
#ifndef SIGHTLINE_CORE_ACCEL_BINARY_BVH_VALIDATION_H_
#define SIGHTLINE_CORE_ACCEL_BINARY_BVH_VALIDATION_H_

#include "absl/status/status.h"
#include "core/accel/binary_bvh.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// OK when: children stand behind their parent and within the tree, and each is one node's child
// alone; leaves name ranges of ids that ascend; every triangle that is not inert stands in exactly
// one leaf; every box is exactly the union of what is below it; `leaf_count` and `max_depth` say
// what is there, the latter at most kMaxBinaryBvhDepth. Otherwise DataLoss naming a fault;
// Cancelled or DeadlineExceeded from `cancel`. Linear; never reads out of bounds. `leaves` is not
// looked at. REQUIRES: the geometry is valid (core/mesh/geometry_validation.h).
absl::Status ValidateBinaryBvh(const BinaryBvh& bvh, const SceneGeometry& geometry,
                               const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BINARY_BVH_VALIDATION_H_
