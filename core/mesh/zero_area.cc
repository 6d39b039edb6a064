// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/zero_area.h"

#include <cmath>

#include "core/geometry/exact_sum.h"

namespace sightline {
namespace {

// One component of (B - A) × (C - A) in double is p - q with p = e1·f2, q = e2·f1, each edge
// coordinate rounded once, each product once, the difference once. With u = 2^-53 and no underflow
// (a difference of floats is 0 or at least 2^-149, so a product is 0 or at least 2^-298):
//   |computed - exact| <= ((1 + u)^4 - 1) · (|p| + |q|), with p and q exact,
// and the computed sum |p| + |q| is at least (1 - u)^4 times the exact one. ((1 + u)^4 - 1) / (1 -
// u)^4 < 5u, and the product of the constant with that sum is rounded once more: 6u covers it.
constexpr double kCrossErrorBound = 6.0 / 9007199254740992.0;  // 6 · 2^-53.

struct Projected {
  double s, t;  // Two of a vertex's three coordinates.
};

// The component as a sum of six products of two floats each: 48 bits, exact in double.
bool IsZeroExactly(Projected a, Projected b, Projected c) {
  ExactSum<6> sum;
  sum.Add(b.s * c.t);
  sum.Add(-(b.s * a.t));
  sum.Add(-(a.s * c.t));
  sum.Add(-(b.t * c.s));
  sum.Add(b.t * a.s);
  sum.Add(a.t * c.s);
  return sum.sign() == 0;
}

// True if double arithmetic proves the component nonzero.
bool IsSurelyNonzero(Projected a, Projected b, Projected c) {
  const double p = (b.s - a.s) * (c.t - a.t);
  const double q = (b.t - a.t) * (c.s - a.s);
  return std::abs(p - q) > kCrossErrorBound * (std::abs(p) + std::abs(q));
}

}  // namespace

bool IsZeroArea(Vec3f a, Vec3f b, Vec3f c) {
  const Projected ax{a.y, a.z}, bx{b.y, b.z}, cx{c.y, c.z};
  const Projected ay{a.z, a.x}, by{b.z, b.x}, cy{c.z, c.x};
  const Projected az{a.x, a.y}, bz{b.x, b.y}, cz{c.x, c.y};
  if (IsSurelyNonzero(ax, bx, cx) || IsSurelyNonzero(ay, by, cy) || IsSurelyNonzero(az, bz, cz)) {
    return false;
  }
  return IsZeroExactly(ax, bx, cx) && IsZeroExactly(ay, by, cy) && IsZeroExactly(az, bz, cz);
}

}  // namespace sightline
