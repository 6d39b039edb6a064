// SPDX-License-Identifier: Apache-2.0
//
// The few functions that the built-in scenes need beyond + - * / and sqrt, written so that every
// machine and compiler gives the same bits: no libm function whose last digit is left to the
// library. Angles are in turns (1 = 360 degrees), so that range reduction is exact and quarter
// turns give exact 0 and 1.
//
// Thread safety: pure functions.
//
//   const SinCos sc = SinCosTurns(1.0 / 12);   // 30 degrees: sc.sin = 0.5 within 1 ulp or so.
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_DETERMINISTIC_MATH_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_DETERMINISTIC_MATH_H_

#include <cmath>
#include <cstdint>

#include "core/geometry/vec3.h"

namespace sightline {

struct SinCos {
  double sin, cos;
};

// Sine and cosine of `turns` full turns. Taylor polynomials on |x| <= pi/4: the first dropped terms
// are (pi/4)^17/17! < 2^-54 and (pi/4)^18/18! < 2^-58, so only rounding remains. REQUIRES: |turns|
// < 2^51 (beyond it a double no longer holds a fraction of a turn).
inline SinCos SinCosTurns(double turns) {
  const double t = turns - std::floor(turns + 0.5);  // [-1/2, 1/2), exact.
  const double quarter = std::floor(t * 4 + 0.5);    // -2 .. 2.
  const double x = (t - quarter * 0.25) * 6.283185307179586476925;
  const double y = x * x;
  double s = -1.0 / 1307674368000.0;
  s = s * y + 1.0 / 6227020800.0;
  s = s * y - 1.0 / 39916800.0;
  s = s * y + 1.0 / 362880.0;
  s = s * y - 1.0 / 5040.0;
  s = s * y + 1.0 / 120.0;
  s = s * y - 1.0 / 6.0;
  s = x + x * (y * s);
  double c = 1.0 / 20922789888000.0;
  c = c * y - 1.0 / 87178291200.0;
  c = c * y + 1.0 / 479001600.0;
  c = c * y - 1.0 / 3628800.0;
  c = c * y + 1.0 / 40320.0;
  c = c * y - 1.0 / 720.0;
  c = c * y + 1.0 / 24.0;
  c = c * y - 0.5;
  c = 1.0 + y * c;
  switch (static_cast<int>(quarter)) {
    case 0:
      return {s, c};
    case 1:
      return {c, -s};
    case -1:
      return {-c, s};
    default:
      return {-s, -c};
  }
}

inline double Lerp(double a, double b, double t) { return a + (b - a) * t; }
inline Vec3d Lerp(Vec3d a, Vec3d b, double t) { return a + (b - a) * t; }
inline double Clamp(double x, double lo, double hi) { return x < lo ? lo : x > hi ? hi : x; }
// 0 below `lo`, 1 above `hi`, a cubic in between.
inline double SmoothStep(double lo, double hi, double x) {
  const double t = Clamp((x - lo) / (hi - lo), 0, 1);
  return t * t * (3 - 2 * t);
}
// REQUIRES: a is not zero.
inline Vec3d Unit(Vec3d a) { return a * (1 / Length(a)); }
// A unit vector across unit vector `a`.
inline Vec3d AnyAcross(Vec3d a) {
  return Unit(std::abs(a.z) < 0.8 ? Cross({0, 0, 1}, a) : Cross({1, 0, 0}, a));
}
// Unit direction of azimuth (degrees from +x toward +y) and elevation (degrees above the xy plane).
inline Vec3d DirectionDegrees(double azimuth, double elevation) {
  const SinCos a = SinCosTurns(azimuth / 360);
  const SinCos e = SinCosTurns(elevation / 360);
  return Unit({e.cos * a.cos, e.cos * a.sin, e.sin});
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_DETERMINISTIC_MATH_H_
