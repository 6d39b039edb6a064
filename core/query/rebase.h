// SPDX-License-Identifier: Apache-2.0
//
// World coordinates to stored ones: one subtraction in double, one rounding to float.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_CORE_QUERY_REBASE_H_
#define SIGHTLINE_CORE_QUERY_REBASE_H_

#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// False, leaving `stored` alone, if `world` is not finite or lies beyond kMaxCoordinate from the origin.
inline bool RebasePoint(Vec3d world, Vec3d origin, Vec3f* stored) {
  if (!IsFinite(world)) return false;
  const Vec3d relative = world - origin;
  if (!(MaxAbs(relative) <= kMaxCoordinate)) return false;
  *stored = ToFloat(relative);
  return true;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_REBASE_H_
