// SPDX-License-Identifier: Apache-2.0
//
// The predicate's float stage for one ray and a vector of triangles. Where PrepareTriangles
// (predicate-inl.h) serves many rays of one origin by forms that are linear in D, here D is known
// from the start, and three of the products serve all three edges. With a = A-O, b = B-A, c = C-A,
// s = D × a and N = b × c:
//     det(A-O, B-O, D) = s·b,  det(C-O, A-O, D) = -s·c,  det(B-O, C-O, D) = N·D - s·b + s·c,
// since the three add up to N·D. That is two thirds of the operations, and half the norms.
//
// Error bound. As in predicate-inl.h, with u = 2^-24, each of s·b, s·c and N·D is off by at most
// 8(1 + 9u)u times its permanent; the permanents are at most |a|_1·|b|_1·|D|_inf,
// |a|_1·|c|_1·|D|_inf and |b|_1·|c|_1·|D|_inf. A product is at most its permanent and that error,
// so that the two additions add at most 2(1 + 10u)u times the three permanents together. One bound
// for all three edges,
//     (|a|_1·(|b|_1 + |c|_1) + |b|_1·|c|_1)·|D|_inf
// times (8(1 + 9u) + 2(1 + 10u))u, therefore holds; as computed it carries at most 12 roundings:
// 10(1 + 10u)(1 + 12u) < 11 = kRayUnits. Products of D and a that underflow lose 2^-149 each, which
// b and c scale; those of b and c lose as much, which D scales: kFloatUnderflow is added to what
// either is multiplied by, and once more for the products that come last. The units' share of
// |D|_inf, which |a|_1 multiplies, is taken of kLeastDirection at least: of a shorter direction it
// would underflow itself, and what that lost come to 2^-150 times |a|_1. Values stay below 2^126.7
// for coordinates within 2^40. Up to 1.5·2^40 the difference N·D - s·b may overflow, and the middle
// edge be infinite: no determinant of them reaches 2^127.2, so that its sign is right even then.
// Measured (tests/core/intersect/float_stage_test.cc): the largest error that a hill climb finds is
// 0.37 of its bound.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_INTERSECT_RAY_FORMS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_INTERSECT_RAY_FORMS_INL_H_
#undef SIGHTLINE_CORE_INTERSECT_RAY_FORMS_INL_H_
#else
#define SIGHTLINE_CORE_INTERSECT_RAY_FORMS_INL_H_
#endif

#include <cstddef>

#include "core/intersect/predicate-inl.h"
#include "core/intersect/predicate.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr float kRayUnits = 11 * 0x1p-24f;
constexpr float kLeastDirection = 0x1p-100f;
static_assert(kRayUnits * kLeastDirection >= kFloatUnderflow, "a normal number");

// The ray, in every lane.
template <class V>
struct RayLanes {
  Vec3V<V> origin, direction, target;
  V direction_inf;    // |D|_inf,
  V direction_units;  // and kRayUnits of it, or of kLeastDirection.

  template <class D>
  static HWY_INLINE RayLanes Of(D d, const PredicateRay& ray) {
    const Vec3f o = ray.origin, t = ray.target, dir = ray.RoundedDirection();
    RayLanes lanes = {.origin = Broadcast(d, o.x, o.y, o.z),
                      .direction = Broadcast(d, dir.x, dir.y, dir.z),
                      .target = Broadcast(d, t.x, t.y, t.z)};
    lanes.direction_inf = NormInfV(lanes.direction);
    lanes.direction_units =
        hn::Mul(hn::Max(lanes.direction_inf, hn::Set(d, kLeastDirection)), hn::Set(d, kRayUnits));
    return lanes;
  }
};

// What the predicate asks about. A value's sign is certain beyond its bound.
template <class V>
struct RayForms {
  V edge[3];
  V edge_bound;   // Of all three.
  V origin_side;  // N·(A-O): positive when O is behind.
  V origin_bound;
  V target_side;  // N·(P-A), of segments alone.
  V target_bound;
};

// `rows` points at the triangles' first lane in row 0 of a leaf (core/accel/bvh.h), `stride` floats
// apart.
template <class D, class V = hn::Vec<D>>
HWY_INLINE RayForms<V> EvaluateForms(D d, const float* HWY_RESTRICT rows, size_t stride,
                                     const RayLanes<V>& ray, bool segment) {
  const auto load = [&](int corner) HWY_ATTR -> Vec3V<V> {
    return {hn::LoadU(d, rows + (3 * corner) * stride),
            hn::LoadU(d, rows + (3 * corner + 1) * stride),
            hn::LoadU(d, rows + (3 * corner + 2) * stride)};
  };
  const V units = hn::Set(d, kRayUnits), underflow = hn::Set(d, kFloatUnderflow);
  const Vec3V<V> corner = load(0);
  const Vec3V<V> a = SubV(corner, ray.origin), b = SubV(load(1), corner), c = SubV(load(2), corner);
  const V b1 = Norm1V(b), c1 = Norm1V(c);
  const Vec3V<V> normal = CrossV(b, c), s = CrossV(ray.direction, a);
  const V normal_bound = hn::MulAdd(units, hn::Mul(b1, c1), underflow);
  const V sb = DotV(s, b), sc = DotV(s, c);
  RayForms<V> forms;
  forms.edge[0] = sb;
  forms.edge[1] = hn::Add(hn::Sub(DotV(normal, ray.direction), sb), sc);
  forms.edge[2] = hn::Neg(sc);
  forms.edge_bound =
      hn::MulAdd(hn::MulAdd(ray.direction_units, Norm1V(a), underflow), hn::Add(b1, c1),
                 hn::MulAdd(normal_bound, ray.direction_inf, underflow));
  forms.origin_side = DotV(normal, a);
  forms.origin_bound = hn::MulAdd(normal_bound, NormInfV(a), underflow);
  if (segment) {
    const Vec3V<V> p = SubV(ray.target, corner);
    forms.target_side = DotV(normal, p);
    forms.target_bound = hn::MulAdd(normal_bound, NormInfV(p), underflow);
  }
  return forms;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
