// SPDX-License-Identifier: Apache-2.0
//
// HitDistance (hit.h) for many rays with one origin against one triangle: the same operations in
// the same order on each lane, hence the same bits. Nothing here may use a fused multiply-add.
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

// Half a float vector's lanes of numerator / (normal·D), D = target - O for a segment.
template <class DH, class VH, class DD = hn::Rebind<double, DH>>
HWY_INLINE VH PlaneQuotient(DH half, const TriangleDistance& t, Vec3f origin, bool segments, VH x,
                            VH y, VH z) {
  const DD dd;
  auto dx = hn::PromoteTo(dd, x), dy = hn::PromoteTo(dd, y), dz = hn::PromoteTo(dd, z);
  if (segments) {
    dx = hn::Sub(dx, hn::Set(dd, static_cast<double>(origin.x)));
    dy = hn::Sub(dy, hn::Set(dd, static_cast<double>(origin.y)));
    dz = hn::Sub(dz, hn::Set(dd, static_cast<double>(origin.z)));
  }
  const auto xy =
      hn::Add(hn::Mul(hn::Set(dd, t.normal.x), dx), hn::Mul(hn::Set(dd, t.normal.y), dy));
  const auto denominator = hn::Add(xy, hn::Mul(hn::Set(dd, t.normal.z), dz));
  return hn::DemoteTo(half, hn::Div(hn::Set(dd, t.numerator), denominator));
}

// `target` as in RayPacket; `inv` the lanes' slab reciprocals.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V HitDistances(D d, const TriangleDistance& t, Vec3f origin, bool segments,
                          const Vec3V<V>& target, const Vec3V<V>& inv) {
  const hn::Half<D> half;
  const auto low = PlaneQuotient(half, t, origin, segments, hn::LowerHalf(half, target.x),
                                 hn::LowerHalf(half, target.y), hn::LowerHalf(half, target.z));
  const auto high = PlaneQuotient(half, t, origin, segments, hn::UpperHalf(half, target.x),
                                  hn::UpperHalf(half, target.y), hn::UpperHalf(half, target.z));
  V distance = hn::Combine(d, high, low);

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
