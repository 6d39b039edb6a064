// SPDX-License-Identifier: Apache-2.0
//
// Placing hits (hit_placement.h), several at a time: to the bits of HitSource::PlacementOf and of
// PlaceTouching's first try, hence the same operations in the same order, none of them fused. Only
// NotApart, which spares work and decides nothing, may round as it likes.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_QUERY_PLACEMENT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_QUERY_PLACEMENT_INL_H_
#undef SIGHTLINE_CORE_QUERY_PLACEMENT_INL_H_
#else
#define SIGHTLINE_CORE_QUERY_PLACEMENT_INL_H_
#endif

#include <bit>
#include <limits>

#include "core/intersect/hit-inl.h"
#include "core/intersect/predicate.h"
#include "core/query/hit_source.h"
#include "core/query/placement.h"
#include "core/query/placement_kernels.h"
#include "core/query/touch_points.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using PlaceD = hn::CappedTag<double, PlacementKernels::kLanes>;
using PlaceFloatD = hn::Rebind<float, PlaceD>;
using PlaceV = hn::Vec<PlaceD>;
using PlaceV3 = Vec3V<PlaceV>;
inline constexpr int kPlaceLanes = static_cast<int>(hn::MaxLanes(PlaceD()));
inline constexpr uint32_t kPlaceMask = (1u << kPlaceLanes) - 1;

HWY_INLINE PlaceV All(double x) { return hn::Set(PlaceD(), x); }
HWY_INLINE PlaceV3 All(Vec3d v) { return BroadcastInDoubles(PlaceD(), v); }
HWY_INLINE PlaceV3 Times(const PlaceV3& v, PlaceV x) {
  return {hn::Mul(v.x, x), hn::Mul(v.y, x), hn::Mul(v.z, x)};
}
HWY_INLINE PlaceV3 Plus(const PlaceV3& a, const PlaceV3& b) {
  return {hn::Add(a.x, b.x), hn::Add(a.y, b.y), hn::Add(a.z, b.z)};
}
HWY_INLINE PlaceV3 PointsAt(const TouchPoints& points, int first) {
  const PlaceD d;
  return {hn::Load(d, points.x + first), hn::Load(d, points.y + first),
          hn::Load(d, points.z + first)};
}
HWY_INLINE hn::Mask<PlaceD> PlaceMaskOf(uint32_t bits) {
  const uint8_t bytes[8] = {static_cast<uint8_t>(bits)};
  return hn::LoadMaskBits(PlaceD(), bytes);
}

// One vector of hits.
HWY_INLINE uint32_t PlaceVector(const HitSource& source, const RayPacket& packet, int first,
                                uint32_t lanes, TouchPoints* points, Vec3f* placed) {
  const PlaceD dd;
  const PlaceFloatD floats;
  const auto load = [&](const float* row)
                        HWY_ATTR { return hn::PromoteTo(dd, hn::Load(floats, row + first)); };
  const PlaceV3 d = {load(packet.target_x), load(packet.target_y), load(packet.target_z)};
  const PlaceV t = load(packet.t);

  // PlacementOf.
  const PlaceV3 traced = Plus(All(ToDouble(packet.origin)), Times(d, t));
  const PlaceV3 n = All(source.normal), a = All(source.anchor);
  const PlaceV lost = hn::Div(UnfusedDot(n, SubV(a, traced)), UnfusedDot(n, d));
  const PlaceV3 p = Plus(traced, Times(d, lost));
  const ClosestPoints& closest = source.closest;
  const PlaceV3 m = All(closest.n);
  const auto inside = [&](Vec3d edge, const PlaceV3& corner) HWY_ATTR {
    return hn::Gt(UnfusedDot(UnfusedCross(All(edge), SubV(p, corner)), m), hn::Zero(dd));
  };
  const auto on_it = hn::And(
      hn::And(hn::Le(hn::Abs(lost), hn::Mul(All(kHitParameterError), t)), inside(closest.ab, a)),
      hn::And(inside(closest.bc, All(closest.b)), inside(closest.ca, All(closest.c))));
  const uint32_t inner = closest.sliver ? 0 : MaskBits(dd, on_it) & lanes;
  const auto held = [&](PlaceV x, double lo, double hi)
                        HWY_ATTR { return hn::Min(hn::Max(x, All(lo)), All(hi)); };
  const PlaceV3 at = {held(p.x, closest.box.lo.x, closest.box.hi.x),
                      held(p.y, closest.box.lo.y, closest.box.hi.y),
                      held(p.z, closest.box.lo.z, closest.box.hi.z)};

  const PlaceV norm_one = Norm1V(at), along = hn::Mul(Norm1V(d), t);
  const PlaceV tied = hn::Mul(All(0x1p-23), along);
  const PlaceV most = hn::Mul(All(kMostTied * 0x1p-24), norm_one);
  const PlaceV base = hn::Add(hn::Mul(All(4 * 0x1p-24), norm_one), hn::Min(tied, most));

  const int to = first % TouchPoints::kMost;
  const auto use = PlaceMaskOf(inner);
  const auto store = [&](PlaceV x, double* row) HWY_ATTR {
    hn::Store(hn::IfThenElse(use, x, hn::Load(dd, row + to)), dd, row + to);
  };
  store(at.x, points->x);
  store(at.y, points->y);
  store(at.z, points->z);
  store(base, points->base);

  // Correct, with PlacementOffset and the plane's slack (placement.cc).
  const Plane& plane = source.plane;
  const PlaceV3 unit = All(plane.normal), from_anchor = SubV(at, a);
  const PlaceV distance = UnfusedDot(unit, from_anchor);
  const PlaceV slack =
      hn::Mul(All(kSlackPerConditioning * plane.conditioning), Norm1V(from_anchor));
  const PlaceV rounding =
      Norm1V(PlaceV3{hn::Mul(unit.x, at.x), hn::Mul(unit.y, at.y), hn::Mul(unit.z, at.z)});
  const PlaceV offset =
      hn::Add(hn::Mul(All(2), hn::Add(hn::Mul(All(0x1p-24), rounding), All(2 * 0x1p-150))), slack);
  const PlaceV3 moved = Plus(at, Times(unit, hn::Sub(hn::Mul(All(kAim), offset), distance)));
  const auto far = hn::Ge(distance, offset);

  // Rounded; -0 becomes +0.
  const auto round = [&](PlaceV stays, PlaceV moves) HWY_ATTR {
    return hn::Add(hn::DemoteTo(floats, hn::IfThenElse(far, stays, moves)), hn::Zero(floats));
  };
  const auto x = round(at.x, moved.x), y = round(at.y, moved.y), z = round(at.z, moved.z);

  // The double stage of SideOfPlane. Not finite: no comparison holds.
  const PlaceV3 there = {hn::PromoteTo(dd, x), hn::PromoteTo(dd, y), hn::PromoteTo(dd, z)};
  const PlaceV3 out = SubV(there, a);
  const PlaceV height = hn::Mul(UnfusedDot(n, out), All(plane.side));
  const PlaceV bound = hn::Mul(
      All(kDoubleBound),
      UnfusedDot(All(source.permanent), PlaceV3{hn::Abs(out.x), hn::Abs(out.y), hn::Abs(out.z)}));
  // Farther off than it looked for what it touches, it may have crossed something.
  const PlaceV3 way = SubV(there, at);
  const auto holds = hn::And(hn::And(hn::Gt(height, bound), hn::Lt(bound, hn::Inf(dd))),
                             hn::Le(UnfusedDot(way, way), hn::Mul(base, base)));

  alignas(64) float px[kPlaceLanes], py[kPlaceLanes], pz[kPlaceLanes];
  hn::Store(x, floats, px);
  hn::Store(y, floats, py);
  hn::Store(z, floats, pz);
  for (uint32_t left = inner; left != 0; left &= left - 1) {
    const int i = std::countr_zero(left);
    placed[i] = {px[i], py[i], pz[i]};
  }
  // Beside the triangle by rounding, or a sliver.
  for (uint32_t left = lanes & ~inner; left != 0; left &= left - 1) {
    const int i = std::countr_zero(left);
    const Placement placement =
        source.PlacementOf(packet.origin, packet.target(first + i), packet.t[first + i]);
    points->x[to + i] = placement.at.x;
    points->y[to + i] = placement.at.y;
    points->z[to + i] = placement.at.z;
    points->base[to + i] = placement.radius.base;
  }
  return MaskBits(dd, holds) & inner;
}

inline HWY_NOINLINE uint32_t PlaceHits(const HitSource& source, const RayPacket& packet, int first,
                                       uint32_t lanes, TouchPoints* points, Vec3f* placed) {
  uint32_t settled = 0;
  for (int i = 0; i < PlacementKernels::kLanes; i += kPlaceLanes) {
    const uint32_t some = lanes >> i & kPlaceMask;
    if (some != 0) settled |= PlaceVector(source, packet, first + i, some, points, placed + i) << i;
  }
  return settled;
}

inline HWY_NOINLINE TouchExtent ExtentOf(const TouchPoints& points) {
  const PlaceD d;
  const PlaceV inf = hn::Inf(d), minus_inf = hn::Neg(inf);
  PlaceV3 lo = {inf, inf, inf}, hi = {minus_inf, minus_inf, minus_inf};
  PlaceV base = hn::Zero(d), norm_one = hn::Zero(d);
  for (int first = 0; first < TouchPoints::kMost; first += kPlaceLanes) {
    const auto used = PlaceMaskOf(points.used >> first & kPlaceMask);
    const PlaceV3 at = PointsAt(points, first);
    const auto extend = [&](PlaceV x, PlaceV* low, PlaceV* high) HWY_ATTR {
      *low = hn::Min(*low, hn::IfThenElse(used, x, inf));
      *high = hn::Max(*high, hn::IfThenElse(used, x, minus_inf));
    };
    extend(at.x, &lo.x, &hi.x);
    extend(at.y, &lo.y, &hi.y);
    extend(at.z, &lo.z, &hi.z);
    base = hn::Max(base, hn::IfThenElseZero(used, hn::Load(d, points.base + first)));
    norm_one = hn::Max(norm_one, hn::IfThenElseZero(used, Norm1V(at)));
  }
  const auto least = [&](PlaceV x) HWY_ATTR { return hn::GetLane(hn::MinOfLanes(d, x)); };
  const auto most = [&](PlaceV x) HWY_ATTR { return hn::GetLane(hn::MaxOfLanes(d, x)); };
  return {.box = {{least(lo.x), least(lo.y), least(lo.z)}, {most(hi.x), most(hi.y), most(hi.z)}},
          .base = most(base),
          .norm_one = most(norm_one)};
}

inline HWY_NOINLINE uint32_t NotApart(const TouchPlanes& planes, const TouchPoints& points) {
  const PlaceD d;
  uint32_t open = 0;
  for (int first = 0; first < TouchPoints::kMost; first += kPlaceLanes) {
    if ((points.used >> first & kPlaceMask) == 0) continue;
    const PlaceV3 at = PointsAt(points, first);
    const PlaceV twice_base = hn::Mul(All(2), hn::Load(d, points.base + first));
    const auto beyond = [&](int plane) HWY_ATTR {
      const PlaceV3 n = {All(planes.x[plane]), All(planes.y[plane]), All(planes.z[plane])};
      const PlaceV s = hn::Sub(DotV(n, at), All(planes.offset[plane]));
      return hn::Gt(plane == 0 ? hn::Abs(s) : s, hn::Add(All(planes.reach[plane]), twice_base));
    };
    const auto apart = hn::Or(hn::Or(beyond(0), beyond(1)), hn::Or(beyond(2), beyond(3)));
    open |= (~MaskBits(d, apart) & kPlaceMask) << first;
  }
  return open & points.used;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // SIGHTLINE_CORE_QUERY_PLACEMENT_INL_H_
