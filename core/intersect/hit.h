// SPDX-License-Identifier: Apache-2.0
//
// Where a segment or ray meets a triangle that blocks it. One fixed order of double operations,
// compiled without contraction: the same bits everywhere.
//
// Thread safety: functions only. REQUIRES: round to nearest, gradual underflow (as predicate.h).
#ifndef SIGHTLINE_CORE_INTERSECT_HIT_H_
#define SIGHTLINE_CORE_INTERSECT_HIT_H_

#include <cstdint>
#include <limits>

#include "core/geometry/vec3.h"
#include "core/intersect/predicate.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// The first triangle on a segment or ray. Hits are ordered by (t, triangle): ties in distance go to
// the lowest id.
struct Hit {
  float t = std::numeric_limits<float>::infinity();
  uint32_t triangle = kNoTriangle;

  bool operator<(const Hit& other) const {
    return t < other.t || (t == other.t && triangle < other.triangle);
  }
};

// The parameter t of the crossing, in units of D (of P - O for a segment): N·(A-O) · (1 / N·D) with
// N = (B-A)×(C-A) in double, rounded once to float, then for a segment not above 1, then held
// between the ray's entry into and exit from the triangle's own box as the slab test computes them,
// and not below zero. So a node's entry never exceeds the t of a hit inside it, and distance
// culling needs no margin; for a segment, t may exceed 1 by that entry's rounding (kSegmentEnd). A
// tiny direction may bring t to +inf. REQUIRES: ABC blocks the ray.
float HitDistance(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c);

// The weights of B and C at the crossing: e2 · (1 / N·D) and e0 · (1 / N·D) of the predicate (N·D
// is e0 + e1 + e2, and the reciprocal is that of HitDistance), in double, each held to [0, 1] and
// rounded once. REQUIRES: ABC blocks the ray.
void HitBarycentrics(const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c, float* u, float* v);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_INTERSECT_HIT_H_
