// SPDX-License-Identifier: Apache-2.0
//
// The slab test of core/geometry/box_ray.h for a vector of rays and a box, or of boxes and a ray,
// lane by lane: reciprocals, entries and exits have its bits on each. What is asked of them after
// that, with a margin for rounding, may be fused.
//
//   V entry = -infinity, exit = infinity;
//   for each axis: CutSlab(d, inv, lo - origin, hi - origin, &entry, &exit);
//   met = Le(Max(entry, zero), ExitWithMargin(d, exit));
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_INTERSECT_BOX_RAY_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_INTERSECT_BOX_RAY_INL_H_
#undef SIGHTLINE_CORE_INTERSECT_BOX_RAY_INL_H_
#else
#define SIGHTLINE_CORE_INTERSECT_BOX_RAY_INL_H_
#endif

#include <limits>

#include "core/geometry/box_ray.h"
#include "core/intersect/predicate-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// SlabReciprocal of each component.
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

// What one axis leaves of an interval along a ray: `lo` and `hi` are a box's faces, relative to the
// ray's origin.
template <class D, class V = hn::Vec<D>>
HWY_INLINE void CutSlab(D, V inv, V lo, V hi, V* entry, V* exit) {
  const V a = hn::Mul(lo, inv), b = hn::Mul(hi, inv);
  // By sign, not by minimum: a face on the ray's line gives NaN, which must stay with its own face;
  // and the running value second, which NaN leaves as it is.
  *entry = hn::Max(hn::IfNegativeThenElse(inv, b, a), *entry);
  *exit = hn::Min(hn::IfNegativeThenElse(inv, a, b), *exit);
}

// Where an exit may be in exact arithmetic, at most: what is entered later does not meet the ray.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V ExitWithMargin(D d, V exit) {
  return hn::MulAdd(exit, hn::Set(d, kBoxExitScale), hn::Set(d, kBoxExitShift));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
