// SPDX-License-Identifier: Apache-2.0
//
// How far the papers' tests (intersector.h) may be off, and so whether one of their answers is
// certain: a bound for each test, triangle and ray.
//
// Derivation: running error analysis (Higham, Accuracy and Stability of Numerical Algorithms,
// section 3.3), by the very operations of the test. A number is a float x with a bound e on
// |x - exact|, where exact is what the operations so far give in real arithmetic on the stored
// corners and the ray. With u = 2^-24 and x the rounded result:
//   x = fl(a ± b):  e = ea + eb + u|x|                               (sums do not underflow)
//   x = fl(a · b):  e = |a|eb + |b|ea + ea·eb + u|x| + 2^-150
//   x = fl(a / b):  e = (ea + |a/b|eb) / (|b| - eb) + u|x| + 2^-150  (no bound unless eb < |b|)
// and no bound where x overflowed. Bounds are computed in doubles; each is enlarged by 2^-40 of
// itself for the handful of roundings in its formula. A segment's direction begins with u|D|.
// Preparation (planes, projections) is part of the operations, so the bound belongs to the
// triangle as much as to the ray.
//
// A comparison a <= b is certain where |b - a| > ea + eb; the sign of the determinant, which turns
// the others, likewise. In real arithmetic every test is a correct one, so a certain answer is the
// predicate's (Blocks), and a disagreement can only be one of the others: it lies within the bound.
//
// Thread safety: pure functions. REQUIRES: round to nearest, gradual underflow.
//
//   const IntersectorCheck check = CheckIntersector(Intersector::kWald, ray, a, b, c);
//   if (check.hit != Blocks(ray, a, b, c)) EXPECT_FALSE(check.certain);
#ifndef SIGHTLINE_CORE_INTERSECT_INTERSECTOR_CHECK_H_
#define SIGHTLINE_CORE_INTERSECT_INTERSECTOR_CHECK_H_

#include "core/geometry/vec3.h"
#include "core/intersect/intersector.h"
#include "core/intersect/predicate.h"

namespace sightline {

struct IntersectorCheck {
  bool hit = false;      // What Intersect says, with t_max = 1 for a segment and +inf for a ray.
  bool certain = false;  // No rounding can have changed that.
  // Of a hit: what Intersect gives, and how far each may be off (+inf: any amount).
  IntersectorHit at;
  double t_error = 0, u_error = 0, v_error = 0;
};

// REQUIRES: intersector != kExact.
IntersectorCheck CheckIntersector(Intersector intersector, const PredicateRay& ray, Vec3f a,
                                  Vec3f b, Vec3f c);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_INTERSECT_INTERSECTOR_CHECK_H_
