// SPDX-License-Identifier: Apache-2.0
//
// The predicate: does triangle ABC block this segment or ray?
//
// A segment runs from O to P, a ray from O along D; write D = P - O, unrounded, for a segment. ABC
// blocks when
//   1. e0 = det(A-O, B-O, D), e1 = det(B-O, C-O, D), e2 = det(C-O, A-O, D)
//      are all >= 0 or all <= 0, not all zero;
//   2. O and P lie strictly on opposite sides of the plane of ABC
//      (a ray: O off the plane, D toward it).
// All are signs of determinants of stored floats. They are evaluated exactly, so every correct
// evaluation agrees.
//
// Properties that follow and that the walks use:
//  a. e0 + e1 + e2 = N·D with N = (B-A)×(C-A): the ray goes toward N exactly when the sum is > 0.
//  b. The answer does not depend on the order of A, B and C.
//  c. A triangle of zero area blocks nothing, nor does one whose plane holds O or P.
//  d. Two triangles with a bit-equal edge compute the same determinant (up to sign) for it: no
//     segment that crosses a closed surface of such triangles slips through.
//
// Blocks decides in doubles where its error bound allows it and in exact expansions otherwise. The
// float stage before it lives in predicate-inl.h.
//
// Thread safety: functions only. REQUIRES: finite coordinates, |x| <= 2^41 (the float stage needs
// |x| <= 1.5·2^40: kMaxCoordinate and what placement may add to it); round to nearest, gradual
// underflow.
#ifndef SIGHTLINE_CORE_INTERSECT_PREDICATE_H_
#define SIGHTLINE_CORE_INTERSECT_PREDICATE_H_

#include <cstdint>

#include "core/geometry/vec3.h"

namespace sightline {

struct PredicateRay {
  Vec3f origin;
  Vec3f target;  // The end P of a segment, the direction D of a ray.
  bool segment = true;

  static PredicateRay Segment(Vec3f from, Vec3f to) { return {from, to, true}; }
  static PredicateRay Ray(Vec3f origin, Vec3f direction) { return {origin, direction, false}; }
  // What the slab test and the float stage take for D: the direction, or fl(P - O).
  Vec3f RoundedDirection() const { return segment ? target - origin : target; }
};

// Error of the double stage. With u = 2^-53, (x × y)·z for x, y, z that each carry one rounding
// takes, per product of three components: three input roundings, two products, one difference, two
// sums: 8 roundings, so the error is at most 8.1u times the permanent |x|,|y|,|z| (the sum of the
// six products of absolute values). The permanent itself suffers as many, and its product with the
// constant one more: 8.1(1 + 10u) < 9. Nothing under- or overflows: a difference of stored floats
// is 0 or at least 2^-149, so products of three lie within 2^±450.
inline constexpr double kDoubleBound = 9 * 0x1p-53;

// Which stage decided; never part of an answer.
enum class PredicateStage : uint8_t { kDouble, kExact };

bool Blocks(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c, PredicateStage* stage = nullptr);

// The definition, in expansions throughout: what Blocks is tested against.
bool BlocksExactly(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c);

// The exact sign of det(B-A, C-A, P-A): +1 in front of ABC (from where it runs counter-clockwise),
// 0 in its plane.
int SideOfPlane(Vec3f a, Vec3f b, Vec3f c, Vec3f p);
// The exact sign of det(B-A, C-A, D): whether D leads to the front.
int SideOfDirection(Vec3f a, Vec3f b, Vec3f c, Vec3f direction);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_INTERSECT_PREDICATE_H_
