// SPDX-License-Identifier: Apache-2.0
//
// The transient frustum of a packet, or of some of its lanes, and what can be told about triangles
// from it (paper 000, section 2): planes, near and far, and the triangle's edges.
//
// All rays of a packet run from one origin O. Along its prevalent axis, x, all directions share a
// sign; turned to be positive, and with y, z the other two axes, ray i runs through (1, y_i, z_i)
// with slopes y_i = D_y/|D_x|, z_i = D_z/|D_x|. The frustum is all points x·(1, y, z) with x >= 0
// and slopes between the lanes' extremes. Since it begins at the origin, the paper's rectangles on
// the leaf's two faces are one rectangle scaled, its planes have two terms instead of three, and a
// flat cell needs no widening: nothing is divided by the cell's width.
//
// Margins, with u = 2^-24, coordinates v - O carrying one rounding, and D two (one of a segment's
// difference, one of the product below):
//  * Slopes: fl(D_y · fl(1/D_x)) carries at most 4 roundings (two differences, reciprocal,
//    product): |error| <= 4.1u|y| + underflow. kSlopeUnits = 8u covers it and its own application.
//  * Side planes: a hit at x·(1, y, z) has y·x >= lo·x for the least slope `lo` (a float, taken as
//    exact). A corner lies outside when q = v_y - lo·v_x < 0. In floats, fused: two roundings of
//    the inputs and one of the result, <= 2.1u(|v_y| + |lo·v_x|); kSideUnits = 4u covers it and
//    the sum that applies it. If all three corners are outside, the triangle is, and no ray hits
//    it: wherever its corners are, behind the origin too.
//  * Near: a triangle with all v_x <= 0 is hit by no ray (x > 0 at a hit). The sign of a difference
//    of floats is exact: no margin.
//  * Far: its distance is held to its box's entry (core/intersect/hit.h), which is at least
//    fl(fl(min v_x) · inv_i), and that at least fl(min v_x · min inv): the same monotone products.
//    No margin; ties are not culled.
//  * Boxes: those of BVHs hold their triangles' hits, which lie on the exact ray. So do the
//    kd-tree's cells that any-hit walks need, and with perfect splits all. Without, closest-hit
//    walks need a chain of cells told by float intervals (kd_tree.h, 2), beside which the ray may
//    pass. Let a be faces relative to O, as rounded, which are the same here and there, T(a) =
//    fl(a·inv) their parameters, e that of claim 2, and s = d_y·inv_x, unrounded, of one lane's
//    floats, y's turned to be positive, too. Such a cell has T(near) <= e along every axis, and e
//    <= T(far) but for a far face before which all of the triangle's box lies: with a hit at t*
//    (exactly: at most that face's own parameter) e = E <= t*(1 + 4.1u) then. Beside y's near
//    face n the ray passes if it leaves x's far face f before it comes to n. n <= e·d_y(1 +
//    2.1u), by the reciprocal and the product; and e <= f·inv_x(1 + u), or in the other case e <=
//    f·inv_x(1 + 7.2u), by the 4.1u and the roundings of f, of a segment's D_x and of its
//    reciprocal. So n <= s·f(1 + 9.4u). To be taken for missed, n must be greater than s·f by
//    12u: the greatest slope is at least s(1 + 6u), by kSlopeUnits less its product's and its
//    sum's rounding; its product with f loses one, and kSideUnits of both sizes is 8u, less the
//    sum's. As much, 12u, is taken off where y's far face is left before x's near one is come to,
//    and there it is 7.3u that is needed.
//    Products that underflow are off by 2^-149 each, which D_y scales: beyond_[] covers a few of
//    them. Where the reciprocal of some D_y is not to be trusted (box_ray.h, 4) cells say nothing
//    along y, and neither is anything told here.
//  * Edges: with the origin behind the triangle, a hit needs e_k(D) >= 0 for its three edges (the
//    predicate's forms). They are linear in D, and D is a positive combination of the four corner
//    directions: negative at all four says negative for all rays, positive says positive. The
//    float stage's own bound (predicate-inl.h) decides what is certain.
//
// Thread safety: plain values.

#if defined(SIGHTLINE_CORE_TRAVERSE_PACKET_FRUSTUM_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PACKET_FRUSTUM_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PACKET_FRUSTUM_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PACKET_FRUSTUM_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/traverse/leaf_view.h"
#include "core/traverse/packet_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr float kSlopeUnits = 8 * 0x1p-24f;
constexpr float kSideUnits = 4 * 0x1p-24f;
// What is left of the two margins of a box, and what cells of a kd-tree may need of them.
static_assert(kSlopeUnits + 2 * kSideUnits - 4 * 0x1p-24f > 9.4f * 0x1p-24f);
// Steeper slopes make no frustum: times a coordinate they may overflow, and what they are taken of
// is so short that x·D_x underflows. Such packets are split.
constexpr float kSteepest = 0x1p40f;

// Slopes between which all rays lie. Empty (lo > hi) where there are no rays.
struct Frustum {
  float lo[2], hi[2];
};

enum class Corners : uint8_t { kUnknown, kOutside, kInside };

// What all frusta of a packet share: the axis, and every lane's slopes.
class PacketSlopes {
 public:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;

  template <bool kAny>
  PacketSlopes(const PacketLanes<kAny>& lanes, bool first_axis) {
    float longest = 0;
    for (int k = 0; k < 3; ++k) {
      float shortest = std::numeric_limits<float>::infinity();
      bool positive = true, negative = true, usable = true;
      for (int i = 0; i < lanes.count(); ++i) {
        const float d = lanes.direction_row(k)[i], inv = lanes.inv_row(k)[i];
        positive &= d > 0;
        negative &= d < 0;
        usable &= std::isfinite(inv);
        shortest = std::min(shortest, std::abs(d));
      }
      if (!usable || (!positive && !negative) || !(shortest > longest)) continue;
      if (first_axis && axis_ >= 0) continue;
      axis_ = k;
      sign_ = positive ? 1.0f : -1.0f;
      longest = shortest;
    }
    if (axis_ < 0) return;
    const D d;
    const V sign = hn::Set(d, sign_), units = hn::Set(d, kSlopeUnits);
    const V underflow = hn::Set(d, kFloatUnderflow);
    V least = hn::Set(d, std::numeric_limits<float>::infinity());
    for (uint32_t g = 0; g < lanes.groups(); ++g) {
      const size_t first = g * hn::Lanes(d);
      const V inv = hn::Mul(hn::Load(d, lanes.inv_row(axis_) + first), sign);
      least = hn::Min(least, inv);
      for (int s = 0; s < 2; ++s) {
        const V slope = hn::Mul(hn::Load(d, lanes.direction_row(other(s)) + first), inv);
        const V margin = hn::MulAdd(hn::Abs(slope), units, underflow);
        hn::Store(hn::Sub(slope, margin), d, lo_[s] + first);
        hn::Store(hn::Add(slope, margin), d, hi_[s] + first);
      }
    }
    least_inv_ = hn::GetLane(hn::MinOfLanes(d, least));
    for (int s = 0; s < 2; ++s) {
      float longest_beside = 1;
      for (int i = 0; i < lanes.count(); ++i) {
        longest_beside = std::max(longest_beside, std::abs(lanes.direction_row(other(s))[i]));
        if (std::isnan(lanes.inv_row(other(s))[i])) {
          longest_beside = std::numeric_limits<float>::infinity();
        }
      }
      beyond_[s] = kFloatUnderflow * longest_beside;
    }
    uint32_t all[RayPacket::kMaxRays / 8];
    std::fill_n(all, lanes.groups(), ~0u);
    whole_ = Hold(all, 0, lanes.groups());
    for (int s = 0; s < 2; ++s) {
      if (!(whole_.lo[s] > -kSteepest && whole_.hi[s] < kSteepest)) axis_ = -1;
    }
  }

  // False: directions share a sign along no axis (or some slope is too steep); nothing below holds.
  bool valid() const { return axis_ >= 0; }
  int axis() const { return axis_; }
  int other(int s) const { return axis_ + 1 + s < 3 ? axis_ + 1 + s : axis_ + s - 2; }
  float sign() const { return sign_; }
  float least_inv() const { return least_inv_; }  // Of 1/|D_x|.
  const Frustum& whole() const { return whole_; }

  // The frustum of the lanes `masks` (a word a group), groups first .. end - 1.
  Frustum Hold(const uint32_t* masks, uint32_t begin, uint32_t end) const {
    const D d;
    const V inf = hn::Set(d, std::numeric_limits<float>::infinity());
    V lo0 = inf, lo1 = inf, hi0 = hn::Neg(inf), hi1 = hi0;
    for (uint32_t g = begin; g < end; ++g) {
      if (masks[g] == 0) continue;
      const size_t first = g * hn::Lanes(d);
      const auto some = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&masks[g]));
      lo0 = hn::Min(lo0, hn::IfThenElse(some, hn::Load(d, lo_[0] + first), inf));
      lo1 = hn::Min(lo1, hn::IfThenElse(some, hn::Load(d, lo_[1] + first), inf));
      hi0 = hn::Max(hi0, hn::IfThenElse(some, hn::Load(d, hi_[0] + first), hn::Neg(inf)));
      hi1 = hn::Max(hi1, hn::IfThenElse(some, hn::Load(d, hi_[1] + first), hn::Neg(inf)));
    }
    return {{hn::GetLane(hn::MinOfLanes(d, lo0)), hn::GetLane(hn::MinOfLanes(d, lo1))},
            {hn::GetLane(hn::MaxOfLanes(d, hi0)), hn::GetLane(hn::MaxOfLanes(d, hi1))}};
  }

  // The leaf's triangles that the frustum's planes leave over; `limit`: no lane that is asked
  // about them looks further.
  HWY_INLINE uint32_t KeepByPlanes(const LeafView& leaf, Vec3f origin, const Frustum& frustum,
                                   bool side_planes, bool near_far, float limit) const {
    const hn::CappedTag<float, kMaxLeafTriangles> d;
    using W = hn::Vec<decltype(d)>;
    const W sign = hn::Set(d, sign_), zero = hn::Zero(d);
    uint32_t kept = 0;
    for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(hn::Lanes(d))) {
      const auto load = [&](int corner, int k) HWY_ATTR {
        return hn::Sub(hn::LoadU(d, leaf.rows + (3 * corner + k) * leaf.stride + first),
                       hn::Set(d, origin[k]));
      };
      const W x[3] = {hn::Mul(load(0, axis_), sign), hn::Mul(load(1, axis_), sign),
                      hn::Mul(load(2, axis_), sign)};
      auto out = hn::Lt(zero, zero);  // None.
      if (near_far) {
        const W nearest = hn::Min(hn::Min(x[0], x[1]), x[2]);
        out = hn::Or(hn::Le(hn::Max(hn::Max(x[0], x[1]), x[2]), zero),
                     hn::Gt(hn::Mul(nearest, hn::Set(d, least_inv_)), hn::Set(d, limit)));
      }
      for (int s = 0; side_planes && s < 2; ++s) {
        const W y[3] = {load(0, other(s)), load(1, other(s)), load(2, other(s))};
        out = hn::Or(out, Beyond(d, x, y, frustum.lo[s], 1.0f));
        out = hn::Or(out, Beyond(d, x, y, frustum.hi[s], -1.0f));
      }
      kept |= (~MaskBits(d, out) & ((1u << hn::Lanes(d)) - 1)) << first;
    }
    return kept & ((1u << leaf.count) - 1);
  }

  // The four corner rays against a triangle's edges.
  HWY_INLINE Corners AgainstEdges(const FacingTriangle& f, const Frustum& frustum) const {
    const hn::CappedTag<float, 4> d;
    HWY_ALIGN float rows[3][4];
    float longest = 1;
    for (int i = 0; i < 4; ++i) {
      rows[axis_][i] = sign_;
      rows[other(0)][i] = (i & 1) != 0 ? frustum.hi[0] : frustum.lo[0];
      rows[other(1)][i] = (i & 2) != 0 ? frustum.hi[1] : frustum.lo[1];
    }
    for (int s = 0; s < 2; ++s) {
      longest = std::max({longest, std::abs(frustum.lo[s]), std::abs(frustum.hi[s])});
    }
    const auto x = hn::Load(d, rows[0]), y = hn::Load(d, rows[1]), z = hn::Load(d, rows[2]);
    const auto infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    bool inside = true;
    for (int e = 0; e < 3; ++e) {
      const auto value =
          hn::MulAdd(hn::Set(d, f.edge[e][0]), x,
                     hn::MulAdd(hn::Set(d, f.edge[e][1]), y, hn::Mul(hn::Set(d, f.edge[e][2]), z)));
      const auto bound = hn::Set(d, f.edge_bound[e] * longest * (1 + 0x1p-22f) + kFloatUnderflow);
      // A sum that has overflowed says nothing, not even its sign: fused, a later product that is
      // larger still does not turn it into NaN.
      const auto sound = hn::Lt(hn::Abs(value), infinity);
      const auto below = hn::And(sound, hn::Lt(hn::Add(value, bound), hn::Zero(d)));
      const auto above = hn::And(sound, hn::Gt(hn::Sub(value, bound), hn::Zero(d)));
      if (hn::AllTrue(d, below)) return Corners::kOutside;
      inside &= hn::AllTrue(d, above);
    }
    return inside ? Corners::kInside : Corners::kUnknown;
  }

  // Whether a box, given relative to the origin, is certainly missed by all rays: behind, or beside
  // on one axis at both its near and its far face.
  HWY_INLINE bool MissesBox(const float* lo, const float* hi) const {
    float x0 = sign_ > 0 ? lo[axis_] : -hi[axis_], x1 = sign_ > 0 ? hi[axis_] : -lo[axis_];
    if (x1 < 0) return true;
    x0 = std::max(x0, 0.0f);
    for (int s = 0; s < 2; ++s) {
      const int k = other(s);
      // "Boxes" above.
      const float below = std::max(whole_.hi[s] * x0, whole_.hi[s] * x1);
      const float above = std::min(whole_.lo[s] * x0, whole_.lo[s] * x1);
      const auto margin = [&](float a, float b) {
        return kSideUnits * (std::abs(a) + std::abs(b)) + beyond_[s];
      };
      if (below + margin(below, lo[k]) < lo[k] || above - margin(above, hi[k]) > hi[k]) return true;
    }
    return false;
  }

 private:
  // All three corners beyond one plane: `turn` is +1 for a least slope, -1 for a greatest.
  template <class DT, class W>
  static HWY_INLINE hn::Mask<DT> Beyond(DT d, const W (&x)[3], const W (&y)[3], float slope,
                                        float turn) {
    const W lo = hn::Set(d, slope * turn), steep = hn::Set(d, std::abs(slope));
    const W sign = hn::Set(d, turn), units = hn::Set(d, kSideUnits);
    W most = hn::Set(d, -std::numeric_limits<float>::infinity());
    for (int c = 0; c < 3; ++c) {
      const W q = hn::NegMulAdd(lo, x[c], hn::Mul(y[c], sign));
      const W size = hn::MulAdd(steep, hn::Abs(x[c]), hn::Abs(y[c]));
      most = hn::Max(most, hn::MulAdd(size, units, q));
    }
    return hn::Lt(hn::Add(most, hn::Set(d, kFloatUnderflow)), hn::Zero(d));
  }

  int axis_ = -1;
  float sign_ = 1;
  float least_inv_ = 0;
  float beyond_[2];  // Underflow's margin of a box, along other(s); infinite: no box is missed.
  Frustum whole_{};
  alignas(64) float lo_[2][RayPacket::kMaxRays], hi_[2][RayPacket::kMaxRays];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
