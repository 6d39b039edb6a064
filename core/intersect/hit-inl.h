// SPDX-License-Identifier: Apache-2.0
//
// HitDistance and HitBarycentrics (hit.h) for many rays with one origin, each against a triangle:
// the same operations in the same order on each lane, hence the same bits. Nothing here may use a
// fused multiply-add.
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
#include "core/intersect/box_ray-inl.h"
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

// Dot() and Cross() of vec3.h, lane by lane: predicate-inl.h's own are fused.
template <class V>
HWY_INLINE V UnfusedDot(const Vec3V<V>& a, const Vec3V<V>& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
template <class V>
HWY_INLINE Vec3V<V> UnfusedCross(const Vec3V<V>& a, const Vec3V<V>& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)),
          hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}

template <class DD>
HWY_INLINE Vec3V<hn::Vec<DD>> BroadcastInDoubles(DD dd, Vec3d v) {
  return {hn::Set(dd, v.x), hn::Set(dd, v.y), hn::Set(dd, v.z)};
}

// What HitDistance and HitBarycentrics need of a triangle and an origin.
struct TriangleTerms {
  TriangleDistance distance;
  TriangleWeights weights;
};

// The terms of each lane's own triangle; doubles by halves of the float lanes. Without kWeights the
// weights' are not there.
template <class D, bool kWeights>
struct HitTerms {
  using DH = hn::Half<D>;
  using DD = hn::Rebind<double, DH>;
  using V = hn::Vec<D>;
  using VD = hn::Vec<DD>;

  Vec3V<VD> normal[2];
  VD numerator[2];
  Vec3V<VD> e0[2], e2[2];
  V lo[3], hi[3];  // Of the triangle's box, relative to O.

  // What EvaluateHits asks for, of half h and axis k.
  HWY_INLINE const Vec3V<VD>& Normal(int h) const { return normal[h]; }
  HWY_INLINE VD Numerator(int h) const { return numerator[h]; }
  HWY_INLINE const Vec3V<VD>& E0(int h) const { return e0[h]; }
  HWY_INLINE const Vec3V<VD>& E2(int h) const { return e2[h]; }
  HWY_INLINE V Lo(int k) const { return lo[k]; }
  HWY_INLINE V Hi(int k) const { return hi[k]; }

  // All lanes have one triangle.
  HWY_INLINE void Set(const TriangleDistance& t, const TriangleWeights* weights) {
    const D d;
    const DD dd;
    for (int h = 0; h < 2; ++h) {
      normal[h] = BroadcastInDoubles(dd, t.normal);
      numerator[h] = hn::Set(dd, t.numerator);
      if constexpr (kWeights) {
        e0[h] = BroadcastInDoubles(dd, weights->e0);
        e2[h] = BroadcastInDoubles(dd, weights->e2);
      }
    }
    for (int k = 0; k < 3; ++k) {
      lo[k] = hn::Set(d, t.lo[k]);
      hi[k] = hn::Set(d, t.hi[k]);
    }
  }

  // The lanes of `bits` have this one.
  HWY_INLINE void Blend(uint32_t bits, const TriangleDistance& t, const TriangleWeights* weights) {
    const D d;
    const DD dd;
    const auto some = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&bits));
    for (int h = 0; h < 2; ++h) {
      const uint8_t half_bits = static_cast<uint8_t>(bits >> (h * hn::MaxLanes(dd)));
      const auto half = hn::LoadMaskBits(dd, &half_bits);
      const auto put = [&](Vec3d v, Vec3V<VD>* out) HWY_ATTR {
        out->x = hn::IfThenElse(half, hn::Set(dd, v.x), out->x);
        out->y = hn::IfThenElse(half, hn::Set(dd, v.y), out->y);
        out->z = hn::IfThenElse(half, hn::Set(dd, v.z), out->z);
      };
      put(t.normal, &normal[h]);
      numerator[h] = hn::IfThenElse(half, hn::Set(dd, t.numerator), numerator[h]);
      if constexpr (kWeights) {
        put(weights->e0, &e0[h]);
        put(weights->e2, &e2[h]);
      }
    }
    for (int k = 0; k < 3; ++k) {
      lo[k] = hn::IfThenElse(some, hn::Set(d, t.lo[k]), lo[k]);
      hi[k] = hn::IfThenElse(some, hn::Set(d, t.hi[k]), hi[k]);
    }
  }

  // Each lane has its own, with these corners: TriangleDistance::Make and TriangleWeights::Make.
  HWY_INLINE void Make(Vec3f origin, const Vec3V<V>& a, const Vec3V<V>& b, const Vec3V<V>& c) {
    const D d;
    const DH half;
    const DD dd;
    const Vec3V<VD> o = BroadcastInDoubles(dd, ToDouble(origin));
    for (int h = 0; h < 2; ++h) {
      const auto promote = [&](const Vec3V<V>& v) HWY_ATTR -> Vec3V<VD> {
        return h == 0 ? Vec3V<VD>{hn::PromoteTo(dd, hn::LowerHalf(half, v.x)),
                                  hn::PromoteTo(dd, hn::LowerHalf(half, v.y)),
                                  hn::PromoteTo(dd, hn::LowerHalf(half, v.z))}
                      : Vec3V<VD>{hn::PromoteTo(dd, hn::UpperHalf(half, v.x)),
                                  hn::PromoteTo(dd, hn::UpperHalf(half, v.y)),
                                  hn::PromoteTo(dd, hn::UpperHalf(half, v.z))};
      };
      const Vec3V<VD> ad = promote(a), bd = promote(b), cd = promote(c);
      const Vec3V<VD> ab = SubV(bd, ad), oa = SubV(ad, o);
      normal[h] = UnfusedCross(ab, SubV(cd, ad));
      numerator[h] = UnfusedDot(normal[h], oa);
      if constexpr (kWeights) {
        e0[h] = UnfusedCross(oa, ab);
        e2[h] = UnfusedCross(SubV(cd, o), SubV(ad, cd));
      }
    }
    const auto face = [&](V p, V q, V r, float at, V* low, V* high) HWY_ATTR {
      *low = hn::Sub(hn::Min(hn::Min(p, q), r), hn::Set(d, at));
      *high = hn::Sub(hn::Max(hn::Max(p, q), r), hn::Set(d, at));
    };
    face(a.x, b.x, c.x, origin.x, &lo[0], &hi[0]);
    face(a.y, b.y, c.y, origin.y, &lo[1], &hi[1]);
    face(a.z, b.z, c.z, origin.z, &lo[2], &hi[2]);
  }
};

// The same, where all lanes have one triangle: fetched where they are used.
template <class D>
class OneTriangleTerms {
 public:
  using DD = hn::Rebind<double, hn::Half<D>>;
  using V = hn::Vec<D>;
  using VD = hn::Vec<DD>;

  // `terms` must outlive it.
  explicit OneTriangleTerms(const TriangleTerms& terms) : terms_(terms) {}

  HWY_INLINE Vec3V<VD> Normal(int) const {
    return BroadcastInDoubles(DD(), terms_.distance.normal);
  }
  HWY_INLINE VD Numerator(int) const { return hn::Set(DD(), terms_.distance.numerator); }
  HWY_INLINE Vec3V<VD> E0(int) const { return BroadcastInDoubles(DD(), terms_.weights.e0); }
  HWY_INLINE Vec3V<VD> E2(int) const { return BroadcastInDoubles(DD(), terms_.weights.e2); }
  HWY_INLINE V Lo(int k) const { return hn::Set(D(), terms_.distance.lo[k]); }
  HWY_INLINE V Hi(int k) const { return hn::Set(D(), terms_.distance.hi[k]); }

 private:
  const TriangleTerms& terms_;
};

// `target` as in RayPacket, `inv` the lanes' slab reciprocals. `octant`, where it is not null, says
// for all lanes together and by axis that inv is negative, and that it is neither infinite nor NaN.
// u and v are written with kWeights. Terms: HitTerms or OneTriangleTerms, with weights for that.
template <bool kWeights, class D, class Terms, class V = hn::Vec<D>>
HWY_INLINE V EvaluateHits(D d, const Terms& terms, Vec3f origin, bool segments,
                          const Vec3V<V>& target, const Vec3V<V>& inv, const bool* octant, V* u,
                          V* v) {
  const hn::Half<D> half;
  const hn::Rebind<double, decltype(half)> dd;
  using VH = hn::Vec<decltype(half)>;
  VH t_half[2], u_half[2], v_half[2];
  for (int h = 0; h < 2; ++h) {
    const auto part = [&](V x) HWY_ATTR {
      return h == 0 ? hn::LowerHalf(half, x) : hn::UpperHalf(half, x);
    };
    const auto direction =
        DirectionInDoubles(half, origin, segments, part(target.x), part(target.y), part(target.z));
    const auto reciprocal = hn::Div(hn::Set(dd, 1.0), UnfusedDot(terms.Normal(h), direction));
    t_half[h] = hn::DemoteTo(half, hn::Mul(terms.Numerator(h), reciprocal));
    if constexpr (kWeights) {
      u_half[h] = hn::DemoteTo(half, hn::Mul(UnfusedDot(terms.E2(h), direction), reciprocal));
      v_half[h] = hn::DemoteTo(half, hn::Mul(UnfusedDot(terms.E0(h), direction), reciprocal));
    }
  }
  V distance = hn::Combine(d, t_half[1], t_half[0]);
  const V one = hn::Set(d, 1.0f), zero = hn::Zero(d);
  if constexpr (kWeights) {
    // Held to 0 .. 1 after rounding, which keeps order; NaN and -0 give the second operand, 0.
    *u = hn::Min(hn::Max(hn::Combine(d, u_half[1], u_half[0]), zero), one);
    *v = hn::Min(hn::Max(hn::Combine(d, v_half[1], v_half[0]), zero), one);
  }
  V entry, exit;
  if (octant != nullptr) {
    const auto near = [&](int k) HWY_ATTR { return octant[k] ? terms.Hi(k) : terms.Lo(k); };
    const auto far = [&](int k) HWY_ATTR { return octant[k] ? terms.Lo(k) : terms.Hi(k); };
    entry =
        hn::Max(hn::Max(hn::Mul(near(0), inv.x), hn::Mul(near(1), inv.y)), hn::Mul(near(2), inv.z));
    exit = hn::Min(hn::Min(hn::Mul(far(0), inv.x), hn::Mul(far(1), inv.y)), hn::Mul(far(2), inv.z));
  } else {
    entry = hn::Set(d, -std::numeric_limits<float>::infinity());
    exit = hn::Set(d, std::numeric_limits<float>::infinity());
    CutSlab(d, inv.x, terms.Lo(0), terms.Hi(0), &entry, &exit);
    CutSlab(d, inv.y, terms.Lo(1), terms.Hi(1), &entry, &exit);
    CutSlab(d, inv.z, terms.Lo(2), terms.Hi(2), &entry, &exit);
  }
  if (segments) distance = hn::IfThenElse(hn::Le(distance, one), distance, one);
  distance = hn::IfThenElse(hn::Le(distance, exit), distance, exit);
  distance = hn::IfThenElse(hn::Ge(distance, entry), distance, entry);
  return hn::IfThenElse(hn::Gt(distance, zero), distance, zero);
}

// One triangle for all lanes, distances alone.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V HitDistances(D d, const TriangleDistance& t, Vec3f origin, bool segments,
                          const Vec3V<V>& target, const Vec3V<V>& inv) {
  const TriangleTerms terms = {t, {}};
  return EvaluateHits<false>(d, OneTriangleTerms<D>(terms), origin, segments, target, inv, nullptr,
                             static_cast<V*>(nullptr), static_cast<V*>(nullptr));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
