// SPDX-License-Identifier: Apache-2.0
//
// The relevant triangles of a shaft (paper 002, section 3): those that some ray between its corner
// rays may meet, and those that all rays meet.
//
// A triangle's five conditions (three edge forms, the plane ahead of the origin, the plane before
// the end) are linear in the ray; one that certainly fails at all four corners fails in between.
// One whose edge forms certainly hold at all corners is met by every ray: it covers the shaft. Two
// triangles that share an edge, and all of whose other edge forms hold at all corners, cover it
// together: the form of the shared edge is the same determinant in both, so each ray is on one
// side of it or the other (an option: paper 002, section 3.1, left it out as complicated). Where
// any hit will do, each ray is blocked by one of the two, whatever else there is: they alone are
// its list. So it is with a light's shadows, too, where all ends certainly lie beyond both planes,
// on neither of the two; a segment's first hit may be a triangle that ends before them, and is
// looked for as ever. Not where hits count from a distance on (`near`).
//
// Thread safety: a list is one walk's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_RTT_LIST_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_RTT_LIST_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_RTT_LIST_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_RTT_LIST_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>

#include "core/accel/indexed_geometry.h"
#include "core/intersect/box_ray-inl.h"
#include "core/intersect/hit-inl.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/rtt_shaft-inl.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class RttList {
 public:
  // More, and testing them ray by ray takes longer than walking.
  static constexpr uint32_t kMaxRelevant = 48;
  // How far beyond a covering triangle the shaft is looked through: more than its distances may be
  // off (kLeastSine).
  static constexpr double kBeyond = 1 + 0x1p-10;
  // A covering triangle's plane quotient, in doubles of u = 2^-53, is off by at most
  //     [3u·|N|·diameter + 4u·|N|·|A-O| + 4u·t·|N|·|D|] / |N·D|   with |N| = |B-A|_1·|C-A|_1,
  // so with |N·D| >= kLeastSine·|N|·|D| and t·|D| >= kLeastNear·(diameter + |A-O|) by less than
  // 2^-53·2^20·(4·2^16 + 4) < 2^-14 of it at the corners, and by less than 2^-11 between them,
  // where both hold up to the ratio of the corners' lengths.
  static constexpr double kLeastSine = 0x1p-20, kLeastNear = 0x1p-16;

  RttList(const IndexedGeometry& scene, const RttShaft& shaft, std::span<const RttRays> rays,
          bool any, bool shared_edges, WalkStats* stats)
      : scene_(scene),
        shaft_(shaft),
        rays_(rays),
        any_(any),
        shared_edges_(shared_edges),
        stats_(stats) {}

  using D = hn::CappedTag<float, kMaxLeafTriangles>;

  // Adds what it must of a leaf's triangles `first` to first + Lanes(D) - 1, of which `t` are the
  // forms. False: there are too many.
  HWY_INLINE bool Add(const LeafView& leaf, uint32_t first, const OriginTriangles<hn::Vec<D>>& t) {
    const D d;
    using V = hn::Vec<D>;
    const uint32_t lanes = static_cast<uint32_t>(hn::Lanes(d));
    const V zero = hn::Zero(d), underflow = hn::Set(d, kFloatUnderflow);
    const auto all = hn::Eq(zero, zero);
    // By form, the last one the plane's: whether it is certainly negative, or positive, at all
    // corners.
    decltype(hn::Eq(zero, zero)) negative[4] = {all, all, all, all},
                                 positive[4] = {all, all, all, all};
    for (int corner = 0; corner < 4; ++corner) {
      const Vec3f c = shaft_.direction(corner);
      const Vec3V<V> dir = Broadcast(d, c.x, c.y, c.z);
      const V inf = hn::Set(d, MaxAbs(c));
      for (int k = 0; k < 4; ++k) {
        const V value = DotV(k == 3 ? t.normal : t.edge[k % 3], dir);
        const V bound = k == 3 ? BoundAlong(d, t.normal_bound, dir)
                               : hn::MulAdd(t.edge_bound[k % 3], inf, underflow);
        negative[k] = hn::And(negative[k], hn::Lt(hn::Add(value, bound), zero));
        positive[k] = hn::And(positive[k], hn::Gt(hn::Sub(value, bound), zero));
      }
    }
    const auto some_negative =
        hn::Or(hn::Or(negative[0], negative[1]), hn::Or(negative[2], negative[3]));
    const auto some_positive =
        hn::Or(hn::Or(positive[0], positive[1]), hn::Or(positive[2], positive[3]));
    const auto behind = hn::Gt(t.origin_side, t.origin_bound);
    const auto front = hn::Lt(t.origin_side, hn::Neg(t.origin_bound));
    const auto passed =
        hn::Or(hn::Or(hn::And(behind, some_negative), hn::And(front, some_positive)),
               hn::And(some_negative, some_positive));
    const uint32_t count = std::min(lanes, leaf.count - first);
    uint32_t left = ~MaskBits(d, passed) & ((1u << count) - 1);
    stats_->triangle_tests += 4 * count;
    if (left == 0) return true;
    uint32_t held[3];  // By edge: forms that hold at all corners.
    for (int k = 0; k < 3; ++k) {
      held[k] = MaskBits(d, hn::Or(hn::And(behind, positive[k]), hn::And(front, negative[k])));
    }
    const uint32_t turned = MaskBits(d, front);
    for (; left != 0; left &= left - 1) {
      const uint32_t bit = static_cast<uint32_t>(std::countr_zero(left));
      const uint32_t edges =
          (held[0] >> bit & 1) | (held[1] >> bit & 1) << 1 | (held[2] >> bit & 1) << 2;
      if (!AddOne(leaf, first + bit, edges, turned >> bit & 1)) return false;
      if (complete_) return true;
    }
    return true;
  }

  std::span<const uint32_t> ids() const { return {ids_, count_}; }
  // No ray looks for anything that the corners meet after this: +inf, or a covering triangle's
  // distance with kBeyond.
  float limit() const { return limit_; }
  // All rays are blocked by it: set when any hit will do.
  uint32_t blocker() const { return blocker_; }
  // All rays are blocked, whatever is not on the list: likewise.
  bool complete() const { return complete_; }

 private:
  struct HalfCover {
    uint32_t id;
    int open;  // Its edge whose form does not hold.
    bool turned;
    float limit;
  };

  bool AddOne(const LeafView& leaf, uint32_t lane, uint32_t edges, bool turned) {
    const uint32_t id = leaf.id(lane);
    const RayPacket& packet = *rays_[0].packet;
    if (id == packet.origin_source || packet.unseen.Holds(id)) return true;
    for (uint32_t i = 0; i < count_; ++i) {
      if (ids_[i] == id) return true;
    }
    const Vec3f a = leaf.corner(0, lane), b = leaf.corner(1, lane), c = leaf.corner(2, lane);
    const uint32_t mask = packet.mask;
    if (MustAskObjects(scene_.geometry, mask)) {
      const int side = SideOfPlane(a, b, c, shaft_.origin());
      if (side == 0 || !ObjectBlocks(scene_.geometry, id, mask, side)) return true;
    }
    bool all_beyond = true;  // All ends of segments certainly lie beyond its plane.
    if (shaft_.segments() && IsSparedByAll(a, b, c, id, &all_beyond)) return true;
    if (count_ == kMaxRelevant) return false;
    ids_[count_++] = id;
    if (edges == 7 && any_ && all_beyond) {
      blocker_ = id;
      complete_ = true;
    } else if (edges == 7 && !shaft_.segments()) {
      if (packet.near == nullptr || IsBeyondNear(a, b, c))
        limit_ = std::min(limit_, LimitOf(a, b, c));
    } else if (shared_edges_ && (any_ ? all_beyond : !shaft_.segments()) &&
               packet.near == nullptr && std::popcount(edges) == 2) {
      // Where any hit will do no distance matters.
      AddHalf({id, std::countr_zero(~edges & 7u), turned, any_ ? 0.0f : LimitOf(a, b, c)});
    }
    return true;
  }

  // Whether no segment can be blocked: all end before the plane, or on this triangle.
  bool IsSparedByAll(Vec3f a, Vec3f b, Vec3f c, uint32_t id, bool* all_beyond) const {
    const D d;
    const hn::RebindToUnsigned<D> du;
    using V = hn::Vec<D>;
    const Vec3f ab = b - a, bc = c - b, o = shaft_.origin();
    const Vec3f n = Cross(ab, bc);
    const float bound = kFloatUnits * ((std::abs(ab.x) + std::abs(ab.y) + std::abs(ab.z)) *
                                       (std::abs(bc.x) + std::abs(bc.y) + std::abs(bc.z))) +
                        kFloatUnderflow;
    const Vec3f oa = a - o;
    const float side = Dot(n, oa), side_bound = bound * MaxAbs(oa) + kFloatUnderflow;
    const int turn = side > side_bound ? 1 : side < -side_bound ? -1 : 0;
    const float sign = turn < 0 ? -1.0f : 1.0f;
    const Vec3V<V> normal = Broadcast(d, sign * n.x, sign * n.y, sign * n.z);
    const Vec3V<V> va = Broadcast(d, a.x, a.y, a.z);
    *all_beyond = turn != 0;
    bool all_spared = true;
    for (const RttRays& some : rays_) {
      const RayPacket& packet = *some.packet;
      for (int i = some.first; i < some.first + some.count; i += static_cast<int>(hn::Lanes(d))) {
        const Vec3V<V> p = {hn::Load(d, packet.target_x + i), hn::Load(d, packet.target_y + i),
                            hn::Load(d, packet.target_z + i)};
        const Vec3V<V> ap = SubV(p, va);
        const V value = DotV(normal, ap);
        const V slack = hn::MulAdd(hn::Set(d, bound), NormInfV(ap), hn::Set(d, kFloatUnderflow));
        const uint32_t in_use = some.first + some.count - i >= static_cast<int>(hn::Lanes(d))
                                    ? (1u << hn::Lanes(d)) - 1
                                    : (1u << (some.first + some.count - i)) - 1;
        const uint32_t own =
            packet.sourceless
                ? 0
                : MaskBits(du, hn::Eq(hn::Load(du, packet.target_source + i), hn::Set(du, id)));
        const uint32_t before =
            turn == 0 ? 0 : MaskBits(d, hn::Lt(hn::Add(value, slack), hn::Zero(d)));
        const uint32_t beyond = MaskBits(d, hn::Gt(hn::Sub(value, slack), hn::Zero(d))) & ~own;
        all_spared &= ((before | own) & in_use) == in_use;
        *all_beyond &= (beyond & in_use) == in_use;
      }
    }
    return all_spared;
  }

  // Whether the hits of all rays on a covering triangle count.
  HWY_NOINLINE bool IsBeyondNear(Vec3f a, Vec3f b, Vec3f c) const {
    const D d;
    using V = hn::Vec<D>;
    const TriangleDistance triangle = TriangleDistance::Make(shaft_.origin(), a, b, c);
    for (const RttRays& some : rays_) {
      const RayPacket& packet = *some.packet;
      const int end = some.first + some.count;
      for (int i = some.first; i < end; i += static_cast<int>(hn::Lanes(d))) {
        const Vec3V<V> dir = {hn::Load(d, packet.target_x + i), hn::Load(d, packet.target_y + i),
                              hn::Load(d, packet.target_z + i)};
        const V t = HitDistances(d, triangle, shaft_.origin(), /*segments=*/false, dir,
                                 SlabReciprocals(d, dir));
        const uint32_t beyond = MaskBits(d, hn::Gt(t, hn::LoadU(d, packet.near + i)));
        const int lanes = std::min(end - i, static_cast<int>(hn::Lanes(d)));
        const uint32_t asked = (1u << lanes) - 1;
        if ((beyond & asked) != asked) return false;
      }
    }
    return true;
  }

  // Where the corners have certainly passed its plane, as every ray's distance has; +inf if that
  // cannot be said.
  float LimitOf(Vec3f a, Vec3f b, Vec3f c) const {
    constexpr float kNone = std::numeric_limits<float>::infinity();
    const Vec3d o = ToDouble(shaft_.origin()), ad = ToDouble(a);
    const Vec3d ab = ToDouble(b) - ad, ac = ToDouble(c) - ad;
    const Vec3d normal = Cross(ab, ac);
    const double size = Norm1(ab) * Norm1(ac), reach = Norm1(ab) + Norm1(ac) + Norm1(ad - o);
    const double numerator = Dot(normal, ad - o);
    double most = 0;
    for (int i = 0; i < 4; ++i) {
      const Vec3d dir = ToDouble(shaft_.direction(i));
      const double along = Dot(normal, dir), t = numerator / along;
      if (!(std::abs(along) >= kLeastSine * size * Norm1(dir)) ||
          !(t * MaxAbs(dir) >= kLeastNear * reach)) {
        return kNone;
      }
      most = std::max(most, t);
    }
    return static_cast<float>(most * kBeyond);
  }

  static double Norm1(const Vec3d& v) { return std::abs(v.x) + std::abs(v.y) + std::abs(v.z); }

  // Looks for another triangle that, with this one, covers the shaft.
  void AddHalf(const HalfCover& half) {
    if (half.limit == std::numeric_limits<float>::infinity() || half_count_ == kMaxHalves) return;
    const auto mine = scene_.geometry.Corners(half.id);
    const Vec3f p = mine[half.open], q = mine[(half.open + 1) % 3];
    for (int i = 0; i < half_count_; ++i) {
      const HalfCover& other = halves_[i];
      const auto its = scene_.geometry.Corners(other.id);
      const Vec3f r = its[other.open], s = its[(other.open + 1) % 3];
      const bool against = r == q && s == p && half.turned == other.turned;
      const bool along = r == p && s == q && half.turned != other.turned;
      if (!against && !along) continue;
      if (any_) {
        ids_[0] = other.id;
        ids_[1] = half.id;
        count_ = 2;
        complete_ = true;
        return;
      }
      limit_ = std::min(limit_, std::max(half.limit, other.limit));
    }
    halves_[half_count_++] = half;
  }

  static constexpr int kMaxHalves = 16;

  const IndexedGeometry& scene_;
  const RttShaft& shaft_;
  const std::span<const RttRays> rays_;
  const bool any_, shared_edges_;
  WalkStats* const stats_;
  uint32_t ids_[kMaxRelevant];
  uint32_t count_ = 0;
  float limit_ = std::numeric_limits<float>::infinity();
  uint32_t blocker_ = kNoTriangle;
  bool complete_ = false;
  HalfCover halves_[kMaxHalves];
  int half_count_ = 0;
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
