// SPDX-License-Identifier: Apache-2.0
//
// The power of two by which boxes are scaled before their areas are compared. Since it is one, it
// changes no rounding: what is compared is as it would be without, but that it neither leaves the
// range of floats nor, for anything that matters, sinks below it.
//
// Thread safety: pure functions.
//
//   const Vec3f e = box.Extent() * AreaScale(bounds);
#ifndef SIGHTLINE_CORE_ACCEL_AREA_SCALE_H_
#define SIGHTLINE_CORE_ACCEL_AREA_SCALE_H_

#include <algorithm>
#include <cmath>

#include "core/geometry/box3.h"

namespace sightline {

// Brings `length` to 1 .. 2, or, as 1/length would be no float, near it. REQUIRES: it is finite.
inline float ScaleToOne(float length) {
  if (!(length > 0)) return 1.0f;
  return std::ldexp(1.0f, std::clamp(-std::ilogb(length), -126, 126));
}

// Brings the longest side of `bounds`, which are not empty, to 1 .. 2, or near it.
inline float AreaScale(const Box3f& bounds) {
  const Vec3f extent = bounds.Extent();
  return ScaleToOne(std::max({extent.x, extent.y, extent.z}));
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_AREA_SCALE_H_
