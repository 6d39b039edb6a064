// SPDX-License-Identifier: Apache-2.0
//
// What the rounding of a determinant is measured by (core/intersect/predicate-inl.h).
//
// Thread safety: a pure function.
#ifndef SIGHTLINE_CORE_GEOMETRY_PERMANENT_H_
#define SIGHTLINE_CORE_GEOMETRY_PERMANENT_H_

#include <cmath>

#include "core/geometry/vec3.h"

namespace sightline {

// The permanent of |x|, |y| and |z| is its product with |z|.
inline Vec3d Permanent(Vec3d x, Vec3d y) {
  return {std::abs(x.y * y.z) + std::abs(x.z * y.y), std::abs(x.z * y.x) + std::abs(x.x * y.z),
          std::abs(x.x * y.y) + std::abs(x.y * y.x)};
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_PERMANENT_H_
