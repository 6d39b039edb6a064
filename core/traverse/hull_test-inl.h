// SPDX-License-Identifier: Apache-2.0
//
// A triangle and a block of points, as the segments between these and all samples of an area light
// meet it (hull_walk-inl.h, whose leaves' pairs these are).
//
// Thread safety: one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_HULL_TEST_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_HULL_TEST_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_HULL_TEST_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_HULL_TEST_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>

#include "core/intersect/predicate.h"
#include "core/traverse/hull_leaf-inl.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/plane_side-inl.h"
#include "core/traverse/shaft_pair-inl.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class HullTest {
 public:
  // All are kept by reference. blocked[lane] gets a bit for each sample; points that no sample sees
  // any more are dropped from the bounds' open ones.
  HullTest(const LightHull& light, const HullRays& rays, const RayPacket& packet,
           const HullForms& forms, const HullBlocks& blocks, ShaftBounds* bounds, uint16_t* blocked,
           WalkStats* stats)
      : light_(light),
        rays_(rays),
        packet_(packet),
        forms_(forms),
        blocks_(blocks),
        bounds_(*bounds),
        blocked_(blocked),
        stats_(stats) {}

  // The points of block b that triangle `id` may block, and that some sample still sees.
  HWY_INLINE uint32_t Asked(uint32_t b, uint32_t id) const {
    return AskedOf(rays_, bounds_, b, id);
  }

  // Takes note that `samples` see none of a block's `points`.
  HWY_INLINE void Block(uint32_t b, uint32_t points, uint16_t samples) {
    const hn::CappedTag<uint16_t, kShaftBlockRays> d;
    uint16_t* const row = blocked_ + size_t{b} * kShaftBlockRays;
    const uint8_t bits[8] = {static_cast<uint8_t>(points), static_cast<uint8_t>(points >> 8)};
    const auto now = hn::Load(d, row);
    const auto all =
        hn::IfThenElse(hn::LoadMaskBits(d, bits), hn::Or(now, hn::Set(d, samples)), now);
    hn::Store(all, d, row);
    CloseSeen(b);
  }

  // The row of a triangle of `leaf`, whose forms are in place, and block b.
  HWY_INLINE void Test(const LeafView& leaf, uint32_t row, uint32_t b) {
    const ShaftD d;
    const uint32_t i = row % kMaxLeafTriangles;
    const size_t at = size_t{b} * kShaftBlockRays;
    uint32_t asked = Asked(b, leaf.id(i));

    // The side of the plane, from the triangle's own corner: as ShaftTest's.
    const Vec3f corner = leaf.corner(0, i);
    const Vec3V<V> a = Broadcast(d, corner.x, corner.y, corner.z);
    const Vec3V<V> normal = Row(forms_.normal, row);
    const Vec3V<V> normal_bound = Row(forms_.normal_bound, row);
    uint32_t beyond = 0, before = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const Vec3V<V> p = SubV(Points(at + k * kLanes), a);
      const V side = DotV(normal, p);
      const V off = BoundAlong(d, normal_bound, p);
      beyond |= MaskBits(d, hn::Gt(side, off)) << (k * kLanes);
      before |= MaskBits(d, hn::Lt(side, hn::Neg(off))) << (k * kLanes);
    }
    asked &= ~before;
    if (asked == 0) return;

    // The edges, for all samples.
    Edges edges;
    uint32_t some = 0, all = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const size_t to = k * kLanes;
      const Vec3V<V> q = rays_.Own(at + to);
      const V bound =
          hn::MulAdd(hn::Set(d, forms_.bound_scale[row]), hn::Set(d, MaxAbs(rays_.most_own())),
                     hn::Set(d, forms_.bound[row]));
      hn::Store(bound, d, edges.bound + to);
      V most = hn::Set(d, kInfinity), least = most;
      for (int e = 0; e < 3; ++e) {
        const V centre = DotV(Row(forms_.edge[e], row), q);
        V lean[2];
        for (int h = 0; h < 2; ++h) {
          const Vec3V<V> n = Row(forms_.lean[e][h], row);
          lean[h] = hn::MulAdd(
              n.x, q.x,
              hn::MulAdd(n.y, q.y,
                         hn::MulAdd(n.z, q.z, hn::Set(d, forms_.lean_form[e][h].f[3][row]))));
          hn::Store(lean[h], d, edges.lean[e][h] + to);
        }
        hn::Store(centre, d, edges.centre[e] + to);
        const V radius = hn::Add(hn::Abs(lean[0]), hn::Abs(lean[1]));
        most = hn::Min(most, hn::Add(centre, radius));
        least = hn::Min(least, hn::Sub(centre, radius));
      }
      some |= MaskBits(d, hn::Ge(hn::Add(most, bound), hn::Zero(d))) << to;
      all |= MaskBits(d, hn::Gt(hn::Sub(least, bound), hn::Zero(d))) << to;
    }
    asked &= some;
    if ((asked & ~beyond) != 0) beyond |= SettlePlane(leaf, row, at, asked & ~beyond);
    asked &= beyond;
    if (asked == 0) return;
    if ((asked & all) != 0) Block(b, asked & all, forms_.samples[row]);
    const uint32_t parted = asked & ~all;
    if (parted == 0) return;
    const int points = std::popcount(parted);
    const uint32_t samples =
        points < kFewPoints ? uint32_t{forms_.samples[row]} : ReachingSamples(row, b);
    const int origins = std::popcount(samples);
    stats_->triangle_tests += static_cast<uint64_t>(points) * static_cast<uint64_t>(origins);
    work_ += static_cast<uint32_t>(std::min(points, origins)) * kPointWork;
    if (points < origins) {
      TestPoints(leaf, row, at, parted, samples, edges);
    } else {
      TestSamples(leaf, row, at, parted, samples, edges);
    }
    CloseSeen(b);
  }

  // Those of the row's samples from which some point may be seen through the triangle.
  HWY_INLINE uint32_t ReachingSamples(uint32_t row) const {
    return ReachingSamples(row, {bounds_.cx, bounds_.cy, bounds_.ex, bounds_.ey, blocks_.all_middle,
                                 blocks_.all_extent, blocks_.all_most});
  }

  // What all of it has cost, in HullWalk's units.
  uint32_t work() const { return work_; }

 private:
  using V = ShaftV;
  static constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  static constexpr size_t kBlockVectors = kShaftBlockRays / kLanes;
  static constexpr float kInfinity = std::numeric_limits<float>::infinity();
  static_assert(LightHull::kMostSamples == kShaftBlockRays, "as many vectors");

  // What the forms of a block's points say of a row.
  struct Edges {
    alignas(64) float centre[3][kShaftBlockRays], lean[3][2][kShaftBlockRays];
    alignas(64) float bound[kShaftBlockRays];
  };

  // Those of the row's samples from which some point of block b may be seen through the triangle:
  // the forms of a sample are the centre's and their leanings, added up.
  HWY_INLINE uint32_t ReachingSamples(uint32_t row, uint32_t b) const {
    return ReachingSamples(row, {bounds_.mx[b], bounds_.my[b], bounds_.hx[b], bounds_.hy[b],
                                 blocks_.middle[b], blocks_.extent[b], blocks_.most[b]});
  }
  // A range of slopes and of inverse depths.
  struct Extent {
    float mx, my, hx, hy, middle, half, most;
  };
  HWY_INLINE uint32_t ReachingSamples(uint32_t row, const Extent& of_points) const {
    const ShaftD d;
    const V mx = hn::Set(d, of_points.mx), my = hn::Set(d, of_points.my);
    const V hx = hn::Set(d, of_points.hx), hy = hn::Set(d, of_points.hy);
    const V iz = hn::Set(d, of_points.middle), ez = hn::Set(d, of_points.half);
    const V margin = hn::Set(d, forms_.margin_inverse[row] * of_points.most + forms_.margin[row]);
    uint32_t beyond = 0;  // What is surely outside of an edge. Overflows make NaNs, which are not.
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const V s = hn::Load(d, light_.along[0] + k * kLanes);
      const V t = hn::Load(d, light_.along[1] + k * kLanes);
      V most = hn::Set(d, kInfinity);
      for (int e = 0; e < 3; ++e) {
        const auto of = [&](int n, V centre) HWY_ATTR {
          return hn::MulAdd(s, hn::Set(d, forms_.lean_form[e][0].f[n][row]),
                            hn::MulAdd(t, hn::Set(d, forms_.lean_form[e][1].f[n][row]), centre));
        };
        const auto& f = forms_.edge_form[e].f;
        const V f0 = of(0, hn::Set(d, f[0][row])), f1 = of(1, hn::Set(d, f[1][row]));
        const V f2 = of(2, hn::Set(d, f[2][row])), f3 = of(3, hn::Zero(d));
        const V middle = hn::MulAdd(f0, mx, hn::MulAdd(f1, my, hn::MulAdd(f3, iz, f2)));
        const V radius = hn::MulAdd(
            hn::Abs(f0), hx, hn::MulAdd(hn::Abs(f1), hy, hn::MulAdd(hn::Abs(f3), ez, margin)));
        most = hn::Min(most, hn::Add(middle, radius));
      }
      beyond |= MaskBits(d, hn::Lt(most, hn::Zero(d))) << (k * kLanes);
    }
    return forms_.samples[row] & ~beyond;
  }

  // Which of the points `parted` each of the `samples` does not see: a vector of points at a time.
  HWY_INLINE void TestSamples(const LeafView& leaf, uint32_t row, size_t at, uint32_t parted,
                              uint32_t samples, const Edges& edges) {
    const ShaftD d;
    const hn::CappedTag<uint16_t, kShaftBlockRays> d16;
    auto blocked = hn::Load(d16, blocked_ + at);
    uint16_t doubts[LightHull::kMostSamples];
    uint32_t some_doubt = 0;
    for (uint32_t left = samples; left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      const V s = hn::Set(d, light_.along[0][k]), t = hn::Set(d, light_.along[1][k]);
      uint32_t hit = 0, open = 0;
      for (size_t v = 0; v < kBlockVectors; ++v) {
        const size_t to = v * kLanes;
        const V bound = hn::Load(d, edges.bound + to);
        V inner = hn::Set(d, kInfinity);
        for (int e = 0; e < 3; ++e) {
          const V value = hn::MulAdd(
              s, hn::Load(d, edges.lean[e][0] + to),
              hn::MulAdd(t, hn::Load(d, edges.lean[e][1] + to), hn::Load(d, edges.centre[e] + to)));
          inner = hn::Min(inner, value);
        }
        hit |= MaskBits(d, hn::Gt(inner, bound)) << to;
        open |= MaskBits(d, hn::Ge(inner, hn::Neg(bound))) << to;
      }
      hit &= parted;
      doubts[k] = static_cast<uint16_t>(open & parted & ~hit);
      some_doubt |= doubts[k];
      const uint8_t bits[8] = {static_cast<uint8_t>(hit), static_cast<uint8_t>(hit >> 8)};
      const auto own = hn::Set(d16, static_cast<uint16_t>(1u << k));
      blocked = hn::IfThenElse(hn::LoadMaskBits(d16, bits), hn::Or(blocked, own), blocked);
    }
    hn::Store(blocked, d16, blocked_ + at);
    if (some_doubt == 0) return;
    for (uint32_t left = samples; left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      for (uint32_t doubt = doubts[k]; doubt != 0; doubt &= doubt - 1) {
        uint16_t& seen = blocked_[at + std::countr_zero(doubt)];
        if ((seen >> k & 1) != 0) continue;
        seen = static_cast<uint16_t>(
            seen | SettleSamples(leaf, row, at + std::countr_zero(doubt), 1u << k));
      }
    }
  }

  // The same, a vector of samples at a time.
  HWY_INLINE void TestPoints(const LeafView& leaf, uint32_t row, size_t at, uint32_t parted,
                             uint32_t samples, const Edges& edges) {
    const ShaftD d;
    for (; parted != 0; parted &= parted - 1) {
      const uint32_t lane = std::countr_zero(parted);
      const V bound = hn::Set(d, edges.bound[lane]);
      uint32_t hit = 0, open = 0;
      for (size_t k = 0; k < kBlockVectors; ++k) {
        const V s = hn::Load(d, light_.along[0] + k * kLanes);
        const V t = hn::Load(d, light_.along[1] + k * kLanes);
        V inner = hn::Set(d, kInfinity);
        for (int e = 0; e < 3; ++e) {
          const V value = hn::MulAdd(
              s, hn::Set(d, edges.lean[e][0][lane]),
              hn::MulAdd(t, hn::Set(d, edges.lean[e][1][lane]), hn::Set(d, edges.centre[e][lane])));
          inner = hn::Min(inner, value);
        }
        hit |= MaskBits(d, hn::Gt(inner, bound)) << (k * kLanes);
        open |= MaskBits(d, hn::Ge(inner, hn::Neg(bound))) << (k * kLanes);
      }
      uint16_t& blocked = blocked_[at + lane];
      hit &= samples;
      const uint32_t doubt = open & samples & ~hit & ~blocked;
      blocked = static_cast<uint16_t>(blocked | hit);
      if (doubt != 0) [[unlikely]] {
        blocked = static_cast<uint16_t>(blocked | SettleSamples(leaf, row, at + lane, doubt));
      }
    }
  }

  // Which of the samples `doubt` do not see a point, for certain.
  HWY_NOINLINE uint32_t SettleSamples(const LeafView& leaf, uint32_t row, size_t lane,
                                      uint32_t doubt) {
    const uint32_t i = row % kMaxLeafTriangles;
    const Vec3f corners[3] = {leaf.corner(0, i), leaf.corner(1, i), leaf.corner(2, i)};
    const Vec3f p = packet_.target(static_cast<int>(lane));
    stats_->doubt_double += static_cast<uint64_t>(std::popcount(doubt));
    work_ += kDoubtWork;
    // e(L, P) is (P-A)×(B-A)·(L-A): an edge's side is that of the plane through it and the point.
    const ShaftD d;
    uint32_t inside = doubt, outside = 0;
    for (int e = 0; e < 3; ++e) {
      const Vec3f from = corners[e];
      const Vec3d to_point = ToDouble(p) - ToDouble(from);
      const Vec3d edge = ToDouble(corners[(e + 1) % 3]) - ToDouble(from);
      uint32_t in = 0;
      for (size_t k = 0; k < kBlockVectors; ++k) {
        const Vec3V<V> samples = {hn::Load(d, light_.rows[0] + k * kLanes),
                                  hn::Load(d, light_.rows[1] + k * kLanes),
                                  hn::Load(d, light_.rows[2] + k * kLanes)};
        const V side = SideInDoubles(to_point, edge, forms_.turn[row], &from, samples);
        in |= MaskBits(d, hn::Gt(side, hn::Zero(d))) << (k * kLanes);
        outside |= MaskBits(d, hn::Lt(side, hn::Zero(d))) << (k * kLanes);
      }
      inside &= in;
    }
    uint32_t hit = inside;
    for (uint32_t left = doubt & ~(inside | outside); left != 0; left &= left - 1) {
      const uint32_t k = std::countr_zero(left);
      PredicateStage stage;
      const PredicateRay ray = PredicateRay::Segment(light_.samples[k], p);
      if (Blocks(ray, corners[0], corners[1], corners[2], &stage)) hit |= 1u << k;
      stats_->doubt_exact += stage == PredicateStage::kExact;
      work_ += kDoubtWork;
    }
    return hit;
  }

  // Which of the points `open` of a block are beyond the row's plane, for certain.
  HWY_NOINLINE uint32_t SettlePlane(const LeafView& leaf, uint32_t row, size_t at, uint32_t open) {
    const ShaftD d;
    const uint32_t i = row % kMaxLeafTriangles;
    const Vec3f a = leaf.corner(0, i), b = leaf.corner(1, i), c = leaf.corner(2, i);
    const float turn = forms_.turn[row];
    uint32_t beyond = 0, unknown = 0;
    for (size_t k = 0; k < kBlockVectors; ++k) {
      const V side = SideInDoubles(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a), turn, &a,
                                   Points(at + k * kLanes));
      beyond |= MaskBits(d, hn::Gt(side, hn::Zero(d))) << (k * kLanes);
      unknown |= MaskBits(d, hn::Eq(side, hn::Zero(d))) << (k * kLanes);
    }
    beyond &= open;
    stats_->doubt_double += static_cast<uint64_t>(std::popcount(open));
    for (uint32_t left = unknown & open; left != 0; left &= left - 1) {
      const uint32_t lane = std::countr_zero(left);
      const int side = SideOfPlane(a, b, c, packet_.target(static_cast<int>(at + lane)));
      if (static_cast<float>(side) * turn > 0) beyond |= 1u << lane;
      ++stats_->doubt_exact;
    }
    return beyond;
  }

  Vec3V<V> Points(size_t at) const {
    return {rays_.Point(0, at), rays_.Point(1, at), rays_.Point(2, at)};
  }
  static HWY_INLINE Vec3V<V> Row(const float (&rows)[3][kHullRows], uint32_t row) {
    return Broadcast(ShaftD(), rows[0][row], rows[1][row], rows[2][row]);
  }

  // Drops the points of block b that no sample sees any more.
  HWY_INLINE void CloseSeen(uint32_t b) {
    const hn::CappedTag<uint16_t, kShaftBlockRays> d;
    const auto now = hn::Load(d, blocked_ + size_t{b} * kShaftBlockRays);
    bounds_.open[b] &=
        static_cast<uint16_t>(MaskBits(d, hn::Ne(now, hn::Set(d, uint16_t{0xFFFF}))));
  }

  // So many points are put to all samples, without a look at which they are seen from.
  static constexpr int kFewPoints = 5;
  // Work, as HullWalk's.
  static constexpr uint32_t kPointWork = 2, kDoubtWork = 8;

  const LightHull& light_;
  const HullRays& rays_;
  const RayPacket& packet_;
  const HullForms& forms_;
  const HullBlocks& blocks_;
  ShaftBounds& bounds_;
  uint16_t* const blocked_;
  WalkStats* const stats_;
  uint32_t work_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
