// SPDX-License-Identifier: Apache-2.0
//
// HitDistance and HitBarycentrics (hit.h) for many rays with one origin against one triangle: the
// same operations in the same order on each lane, hence the same bits. Nothing here may use a fused
// multiply-add.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_INTERSECT_HIT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_INTERSECT_HIT_INL_H_
#undef SIGHTLINE_CORE_INTERSECT_HIT_INL_H_
#else
#define SIGHTLINE_CORE_INTERSECT_HIT_INL_H_
#endif

#include <limits>

#include "core/geometry/box3.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/predicate-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// What HitDistance needs of a triangle and an origin, whatever the ray.
struct TriangleDistance {
  Vec3d normal;      // (B-A)×(C-A) in double.
  double numerator;  // normal·(A-O).
  Vec3f lo, hi;      // The triangle's box, relative to O: fl(face - o).

  static TriangleDistance Make(Vec3f origin, Vec3f a, Vec3f b, Vec3f c) {
    const Vec3d ad = ToDouble(a);
    TriangleDistance t;
    t.normal = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
    t.numerator = Dot(t.normal, ad - ToDouble(origin));
    Box3f box;
    box.Extend(a);
    box.Extend(b);
    box.Extend(c);
    t.lo = box.lo - origin;
    t.hi = box.hi - origin;
    return t;
  }
};

// What HitBarycentrics needs: the forms e0 and e2 of the predicate.
struct TriangleWeights {
  Vec3d e0, e2;

  static TriangleWeights Make(Vec3f origin, Vec3f a, Vec3f b, Vec3f c) {
    const Vec3d o = ToDouble(origin), ad = ToDouble(a), bd = ToDouble(b), cd = ToDouble(c);
    return {Cross(ad - o, bd - ad), Cross(cd - o, ad - cd)};
  }
};

// SlabReciprocal of core/geometry/box_ray.h, lane by lane.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Vec3V<V> SlabReciprocals(D d, const Vec3V<V>& v) {
  const V least = hn::Set(d, std::numeric_limits<float>::min());
  const V nan = hn::Set(d, std::numeric_limits<float>::quiet_NaN());
  const auto reciprocal = [&](V c) HWY_ATTR {
    const auto subnormal = hn::And(hn::Lt(hn::Abs(c), least), hn::Ne(c, hn::Zero(d)));
    return hn::IfThenElse(subnormal, nan, hn::Div(hn::Set(d, 1.0f), c));
  };
  return {reciprocal(v.x), reciprocal(v.y), reciprocal(v.z)};
}

// Half a float vector's lanes, promoted: D = target - O for a segment.
template <class DH, class VH, class DD = hn::Rebind<double, DH>>
HWY_INLINE Vec3V<hn::Vec<DD>> DirectionInDoubles(DH, Vec3f origin, bool segments, VH x, VH y,
                                                 VH z) {
  const DD dd;
  Vec3V<hn::Vec<DD>> d = {hn::PromoteTo(dd, x), hn::PromoteTo(dd, y), hn::PromoteTo(dd, z)};
  if (segments) {
    d.x = hn::Sub(d.x, hn::Set(dd, static_cast<double>(origin.x)));
    d.y = hn::Sub(d.y, hn::Set(dd, static_cast<double>(origin.y)));
    d.z = hn::Sub(d.z, hn::Set(dd, static_cast<double>(origin.z)));
  }
  return d;
}

// (x·x' + y·y') + z·z', as Dot() of vec3.h.
template <class DD, class V = hn::Vec<DD>>
HWY_INLINE V DotInDoubles(DD dd, Vec3d a, const Vec3V<V>& b) {
  const V xy = hn::Add(hn::Mul(hn::Set(dd, a.x), b.x), hn::Mul(hn::Set(dd, a.y), b.y));
  return hn::Add(xy, hn::Mul(hn::Set(dd, a.z), b.z));
}

template <class DH, class VH, class DD = hn::Rebind<double, DH>>
HWY_INLINE hn::Vec<DD> PlaneReciprocal(DH half, const TriangleDistance& t, Vec3f origin,
                                       bool segments, VH x, VH y, VH z,
                                       Vec3V<hn::Vec<DD>>* direction) {
  const DD dd;
  *direction = DirectionInDoubles(half, origin, segments, x, y, z);
  return hn::Div(hn::Set(dd, 1.0), DotInDoubles(dd, t.normal, *direction));
}

// `target` as in RayPacket; `inv` the lanes' slab reciprocals. `weights` may be null; else u and v
// are written, too.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V HitDistances(D d, const TriangleDistance& t, Vec3f origin, bool segments,
                          const Vec3V<V>& target, const Vec3V<V>& inv,
                          const TriangleWeights* weights = nullptr, V* u = nullptr,
                          V* v = nullptr) {
  const hn::Half<D> half;
  const hn::Rebind<double, decltype(half)> dd;
  Vec3V<hn::Vec<decltype(dd)>> low_d, high_d;
  const auto low =
      PlaneReciprocal(half, t, origin, segments, hn::LowerHalf(half, target.x),
                      hn::LowerHalf(half, target.y), hn::LowerHalf(half, target.z), &low_d);
  const auto high =
      PlaneReciprocal(half, t, origin, segments, hn::UpperHalf(half, target.x),
                      hn::UpperHalf(half, target.y), hn::UpperHalf(half, target.z), &high_d);
  const auto numerator = hn::Set(dd, t.numerator);
  V distance = hn::Combine(d, hn::DemoteTo(half, hn::Mul(numerator, high)),
                           hn::DemoteTo(half, hn::Mul(numerator, low)));
  if (weights != nullptr) {
    const auto share = [&](Vec3d form) HWY_ATTR {
      const auto one = hn::Set(dd, 1.0), zero = hn::Zero(dd);
      const auto held = [&](auto s) HWY_ATTR {
        return hn::DemoteTo(
            half, hn::IfThenElse(hn::Gt(s, zero), hn::IfThenElse(hn::Lt(s, one), s, one), zero));
      };
      return hn::Combine(d, held(hn::Mul(DotInDoubles(dd, form, high_d), high)),
                         held(hn::Mul(DotInDoubles(dd, form, low_d), low)));
    };
    *u = share(weights->e2);
    *v = share(weights->e0);
  }

  V entry = hn::Set(d, -std::numeric_limits<float>::infinity());
  V exit = hn::Set(d, std::numeric_limits<float>::infinity());
  const auto slab = [&](V inv_k, float lo_k, float hi_k) HWY_ATTR {
    const V lo = hn::Mul(hn::Set(d, lo_k), inv_k), hi = hn::Mul(hn::Set(d, hi_k), inv_k);
    // The running value second: NaN is passed over (core/geometry/box_ray.h).
    entry = hn::Max(hn::IfNegativeThenElse(inv_k, hi, lo), entry);
    exit = hn::Min(hn::IfNegativeThenElse(inv_k, lo, hi), exit);
  };
  slab(inv.x, t.lo.x, t.hi.x);
  slab(inv.y, t.lo.y, t.hi.y);
  slab(inv.z, t.lo.z, t.hi.z);
  const V one = hn::Set(d, 1.0f);
  if (segments) distance = hn::IfThenElse(hn::Le(distance, one), distance, one);
  distance = hn::IfThenElse(hn::Le(distance, exit), distance, exit);
  distance = hn::IfThenElse(hn::Ge(distance, entry), distance, entry);
  return hn::IfThenElse(hn::Gt(distance, hn::Zero(d)), distance, hn::Zero(d));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
