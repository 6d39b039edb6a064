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

#include "core/geometry/float4.h"
#include "core/geometry/vec3.h"

namespace sightline {

// REQUIRES: all coordinates finite, |x| <= 2^41; round to nearest, gradual underflow.
bool IsZeroArea(Vec3f a, Vec3f b, Vec3f c);

// One component of (B - A) × (C - A) in double is p - q with p = e1·f2, q = e2·f1, each edge
// coordinate rounded once, each product once, the difference once. With u = 2^-53 and no underflow
// (a difference of floats is 0 or at least 2^-149, so a product is 0 or at least 2^-298):
//   |computed - exact| <= ((1 + u)^4 - 1) · (|p| + |q|), with p and q exact,
// and the computed sum |p| + |q| is at least (1 - u)^4 times the exact one. ((1 + u)^4 - 1) / (1 -
// u)^4 < 5u, and the product of the constant with that sum is rounded once more: 6u covers it.
inline constexpr double kCrossErrorBound = 6.0 / 9007199254740992.0;  // 6 · 2^-53.

// True if double arithmetic proves a component of it nonzero; false where a corner is not a number.
// Of lanes as LoadVertex gives them. REQUIRES: as IsZeroArea, but that a corner may be NaN in all
// three coordinates, as the stored ones are that were not finite.
inline bool SurelyHasArea(Float4 a, Float4 b, Float4 c) {
  const Double4 e = ToDouble(b) - ToDouble(a), f = ToDouble(c) - ToDouble(a);
  const Double4 p =
      __builtin_shufflevector(e, e, 1, 2, 0, 3) * __builtin_shufflevector(f, f, 2, 0, 1, 3);
  const Double4 q =
      __builtin_shufflevector(e, e, 2, 0, 1, 3) * __builtin_shufflevector(f, f, 1, 2, 0, 3);
  const Double4 bound = {kCrossErrorBound, kCrossErrorBound, kCrossErrorBound, kCrossErrorBound};
  return AnyOfThree(Abs(p - q) > bound * (Abs(p) + Abs(q)));
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_ZERO_AREA_H_
