// SPDX-License-Identifier: Apache-2.0
//
// The ray-triangle tests of the papers, as they are published: floats, no error bound of their own.
// The engine's answers come from the exact predicate (predicate.h); these stand beside it, to be
// chosen for a query and to be measured.
//
//   kHavelHerout         Paper 003, section III: the triangle's plane and two planes perpendicular
//                        to it whose scaled distances are the barycentrics; division deferred.
//   kHavelHeroutDivided  The same planes, dividing before the barycentrics (section III, eq. 12).
//   kHavelHeroutDotProduct
//                        The first for one ray and one triangle, by SSE4.1's dot-product
//                        instruction (section IV): the same bits, and in lanes the very first.
//   kWald                Paper 003, section II A: projected along the normal's largest component.
//   kShevtsov            Paper 003, section II B: projected likewise, division deferred.
//   kKenslerShirley      Their search's result over raw corners (papers 000 and 003, reference 4).
//   kMoellerTrumbore     Raw corners, Cramer's rule (paper 003, reference 3); two-sided. Its
//                        published threshold on |det| is left out: it has the unit of length³, and
//                        would drop small triangles whole. Only det = 0 misses.
//
// Semantics: a ray O + tD hits where 0 <= t <= t_max, u >= 0, v >= 0, u + v <= 1, all as rounded;
// u is the weight of B, v that of C. A zero or NaN determinant misses, and so does one so small
// that its reciprocal, or t, is not finite.
//
// One order of operations. Each test is written once (intersector-inl.h), for whatever holds a
// number: dot products are (a + b) + (c + d), division is IEEE's, nothing is fused, zeros come out
// as +0. So one ray against one triangle, rays in lanes and triangles in lanes give the same bits,
// and so does the dot-product instruction.
//
// Range: products of a few coordinates are formed unscaled: kHavelHerout holds N·D·O, with |N| an
// edge squared. Where that overflows a float (edge² · direction · distance beyond 2^127) the tests
// miss. CheckIntersector (intersector_check.h) says so.
//
// Thread safety: plain values and pure functions. REQUIRES: round to nearest, gradual underflow.
//
//   const PreparedTriangle t = PrepareTriangle(Intersector::kWald, a, b, c);
//   IntersectorHit hit;
//   if (Intersect(Intersector::kWald, t, origin, direction, 1.0f, &hit)) Use(hit.t);
#ifndef SIGHTLINE_CORE_INTERSECT_INTERSECTOR_H_
#define SIGHTLINE_CORE_INTERSECT_INTERSECTOR_H_

#include <array>
#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/geometry/vec3.h"
#include "core/intersect/predicate.h"

namespace sightline {

enum class Intersector : uint8_t {
  kExact = 0,  // The predicate. It needs no prepared triangles: the functions below take others.
  kHavelHerout = 1,
  kHavelHeroutDivided = 2,
  kWald = 3,
  kShevtsov = 4,
  kKenslerShirley = 5,
  kMoellerTrumbore = 6,
  kHavelHeroutDotProduct = 7,  // For single rays: packets have no use for it.
};

inline constexpr std::array<Intersector, 7> kPaperIntersectors = {
    Intersector::kHavelHerout,
    Intersector::kHavelHeroutDivided,
    Intersector::kWald,
    Intersector::kShevtsov,
    Intersector::kKenslerShirley,
    Intersector::kMoellerTrumbore,
    Intersector::kHavelHeroutDotProduct};

// "EXACT", "HAVEL_HEROUT", "HAVEL_HEROUT_DIVIDED", "WALD", "SHEVTSOV", "KENSLER_SHIRLEY",
// "MOELLER_TRUMBORE", "HAVEL_HEROUT_DOT_PRODUCT".
absl::string_view IntersectorName(Intersector intersector);
// By that name, in any case. InvalidArgument listing the names.
absl::StatusOr<Intersector> ParseIntersector(absl::string_view name);

// What a test reads of a triangle: 48 bytes, whichever the test.
//   Havel-Herout: N, d; N1, d1; N2, d2. Kensler-Shirley, Möller-Trumbore: A, B, C; 0, 0, 0.
//   Wald: Np, Nq, d; Up, Uq, Ud; Vp, Vq, Vd; 0, 0; the axis.
//   Shevtsov: Np, Nq, d; Ap, Aq; E0p, E0q; E1p, E1q; 0, 0; the axis.
// The axis is r, the one that is projected along (0, 1, 2 as float); p and q follow cyclically, so
// that no sign depends on it.
inline constexpr int kPreparedFloats = 12;
inline constexpr int kPreparedAxis = 11;
struct alignas(16) PreparedTriangle {
  float value[kPreparedFloats];
};

struct IntersectorHit {
  float t = 0, u = 0, v = 0;
};

// REQUIRES, here and below: intersector != kExact.
PreparedTriangle PrepareTriangle(Intersector intersector, Vec3f a, Vec3f b, Vec3f c);

// One ray, one triangle. `hit` is written if the result is true. t_max may be +inf.
bool Intersect(Intersector intersector, const PreparedTriangle& triangle, Vec3f origin,
               Vec3f direction, float t_max, IntersectorHit* hit);
// A ray of the predicate's against corners: D is its rounded direction, t_max 1 for a segment and
// +inf for a ray. What a query with this intersector asks.
bool IntersectRay(Intersector intersector, const PredicateRay& ray, Vec3f a, Vec3f b, Vec3f c,
                  IntersectorHit* hit);

// Rays in lanes. Invariant: rows are readable up to the next multiple of kMaxIntersectorLanes.
inline constexpr size_t kMaxIntersectorLanes = 16;
struct IntersectorRays {
  const float* origin[3];
  const float* direction[3];
  const float* t_max;
  size_t count = 0;
};
// Where hits go: t, u, v of element i where hit[i] is 1, else untouched. Rows as long as the input.
struct IntersectorHits {
  float *t, *u, *v;
  uint8_t* hit;
};
// Triangles in lanes: row k of `value` holds value[k] of each. Invariant: as of rays' rows.
struct PreparedTriangles {
  const float* value[kPreparedFloats];
  size_t count = 0;
};

// Many rays, one triangle; one ray, many triangles. By the widest registers of this machine.
void IntersectRays(Intersector intersector, const PreparedTriangle& triangle,
                   const IntersectorRays& rays, const IntersectorHits& hits);
void IntersectTriangles(Intersector intersector, const PreparedTriangles& triangles, Vec3f origin,
                        Vec3f direction, float t_max, const IntersectorHits& hits);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_INTERSECT_INTERSECTOR_H_
