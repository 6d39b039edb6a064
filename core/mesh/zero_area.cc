// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/zero_area.h"

#include "core/geometry/exact_sum.h"

namespace sightline {
namespace {

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

}  // namespace

bool IsZeroArea(Vec3f a, Vec3f b, Vec3f c) {
  if (SurelyHasArea(LoadVertex(a), LoadVertex(b), LoadVertex(c))) return false;
  const Projected ax{a.y, a.z}, bx{b.y, b.z}, cx{c.y, c.z};
  const Projected ay{a.z, a.x}, by{b.z, b.x}, cy{c.z, c.x};
  const Projected az{a.x, a.y}, bz{b.x, b.y}, cz{c.x, c.y};
  return IsZeroExactly(ax, bx, cx) && IsZeroExactly(ay, by, cy) && IsZeroExactly(az, bz, cz);
}

}  // namespace sightline
