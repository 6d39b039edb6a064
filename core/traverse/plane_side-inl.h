// SPDX-License-Identifier: Apache-2.0
//
// The side of a triangle's plane that points lie on, in doubles: the stage between the floats of a
// shaft's tests and the predicate's own.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_PLANE_SIDE_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PLANE_SIDE_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PLANE_SIDE_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PLANE_SIDE_INL_H_
#endif

#include <cmath>

#include "core/geometry/permanent.h"
#include "core/intersect/hit-inl.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The signs of sign·(v×w)·q for the vectors q = P - base, or q = P where `base` is null: 1, -1, or
// 0 where doubles cannot tell. v and w are floats or differences of floats, `sign` is 1 or -1. The
// bound is the float stage's (predicate-inl.h), a permanent, with u = 2^-53: v and w err by u each,
// v×w by 3u of it more, the dot product by 3u and q by u.
constexpr double kDoubleUnits = 9 * 0x1p-53;
inline ShaftV SideInDoubles(Vec3d v, Vec3d w, float sign, const Vec3f* base,
                            const Vec3V<ShaftV>& points) {
  const ShaftD d;
  const hn::Half<ShaftD> half;
  const hn::Rebind<double, decltype(half)> dd;
  const Vec3d n = Cross(v, w) * static_cast<double>(sign);
  const Vec3d bound = Permanent(v, w) * kDoubleUnits;
  const Vec3f from = base == nullptr ? Vec3f{0, 0, 0} : *base;
  const auto side = [&](auto x, auto y, auto z) HWY_ATTR {
    const auto q = DirectionInDoubles(half, from, /*segments=*/base != nullptr, x, y, z);
    const auto value = UnfusedDot(BroadcastInDoubles(dd, n), q);
    const auto off = hn::MulAdd(hn::Set(dd, bound.x), hn::Abs(q.x),
                                hn::MulAdd(hn::Set(dd, bound.y), hn::Abs(q.y),
                                           hn::Mul(hn::Set(dd, bound.z), hn::Abs(q.z))));
    const auto one = hn::Set(dd, 1.0), zero = hn::Zero(dd);
    return hn::DemoteTo(
        half, hn::IfThenElse(hn::Gt(value, off), one,
                             hn::IfThenElse(hn::Lt(value, hn::Neg(off)), hn::Neg(one), zero)));
  };
  return hn::Combine(d,
                     side(hn::UpperHalf(half, points.x), hn::UpperHalf(half, points.y),
                          hn::UpperHalf(half, points.z)),
                     side(hn::LowerHalf(half, points.x), hn::LowerHalf(half, points.y),
                          hn::LowerHalf(half, points.z)));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
