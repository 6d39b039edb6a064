// SPDX-License-Identifier: Apache-2.0
//
// The exact answer to "has this triangle no area?": whether the cross product of its edge vectors,
// as real numbers of the stored floats, is zero. Such a triangle has no plane and blocks nothing.
//
// Thread safety: functions only.
//
//   if (IsZeroArea(a, b, c)) ++report.zero_area_triangles;
#ifndef SIGHTLINE_CORE_MESH_ZERO_AREA_H_
#define SIGHTLINE_CORE_MESH_ZERO_AREA_H_

#include "core/geometry/vec3.h"

namespace sightline {

// REQUIRES: all coordinates finite, |x| <= 2^41; round to nearest, gradual underflow.
bool IsZeroArea(Vec3f a, Vec3f b, Vec3f c);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_ZERO_AREA_H_
