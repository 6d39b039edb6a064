// SPDX-License-Identifier: Apache-2.0
//
// The lanes of a packet with one origin, and the exact test of a leaf's triangles against them:
// what the packet walk and the shaft walk share. They differ in how they find which triangles to
// put to which lanes.
//
// A leaf's triangles are turned once so that the origin lies behind them; their edge normals
// relative to the origin then serve every lane. Lanes that floats leave in doubt go to Blocks().
//
// Thread safety: a packet's lanes are one walk's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_PACKET_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PACKET_LANES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PACKET_LANES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PACKET_LANES_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/base/fill-inl.h"
#include "core/base/masked_store-inl.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/box_ray-inl.h"
#include "core/intersect/hit-inl.h"
#include "core/intersect/predicate-inl.h"
#include "core/traverse/lane_answers-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// One triangle, turned so that the origin lies behind it: all its forms are positive where it is
// hit.
struct FacingTriangle {
  float edge[3][3], edge_bound[3];
  float normal[3], normal_bound[3];
  float a[3];
  float depth, depth_bound;  // normal·(A-O), and how far rounding may have taken it off.
  uint32_t lane;             // In its leaf.
};

template <bool kAny>
class PacketLanes {
 public:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;
  using M = hn::Mask<D>;
  static constexpr int kMaxRays = RayPacket::kMaxRays;

  PacketLanes(const IndexedGeometry& scene, RayPacket& packet, WalkStats* stats)
      : scene_(scene), packet_(packet), stats_(stats) {
    const D d;
    const size_t lanes = hn::Lanes(d);
    groups_ = static_cast<uint32_t>((packet.count + lanes - 1) / lanes);
    padded_ = static_cast<int>(groups_ * lanes);
    // Lanes out of use copy the last one in use, and are never active.
    for (int i = packet.count; i < padded_; ++i) {
      packet.target_x[i] = packet.target_x[packet.count - 1];
      packet.target_y[i] = packet.target_y[packet.count - 1];
      packet.target_z[i] = packet.target_z[packet.count - 1];
      packet.target_source[i] = kNoTriangle;
    }
    const Vec3V<V> o = Broadcast(d, packet.origin.x, packet.origin.y, packet.origin.z);
    first_limit_ = packet.segments ? kSegmentEnd : std::numeric_limits<float>::infinity();
    for (int i = 0; i < padded_; i += static_cast<int>(lanes)) {
      Vec3V<V> dir = {hn::Load(d, packet.target_x + i), hn::Load(d, packet.target_y + i),
                      hn::Load(d, packet.target_z + i)};
      if (packet.segments) dir = SubV(dir, o);
      StoreV(d, dir, direction_, i);
      hn::Store(NormInfV(dir), d, direction_inf_ + i);
      StoreV(d, SlabReciprocals(d, dir), inv_, i);
      hn::Store(hn::Set(d, first_limit_), d, limit_of_ + i);
    }
    FillRow(packet.t, padded_, std::numeric_limits<float>::infinity());
    FillRow(packet.triangle, padded_, kNoTriangle);
    for (int i = packet.count; i < padded_; ++i) {
      limit_of_[i] = -std::numeric_limits<float>::infinity();  // Enters nothing.
    }
    if (packet.segments && !packet.sourceless) {
      static_assert(kNoTriangle == 0xFFFFFFFFu, "all bits, so that And keeps it");
      const hn::RebindToUnsigned<D> du;
      auto all = hn::Set(du, kNoTriangle);
      for (int i = 0; i < padded_; i += static_cast<int>(lanes)) {
        all = hn::And(all, hn::Load(du, packet.target_source + i));
      }
      has_sources_ = !hn::AllTrue(du, hn::Eq(all, hn::Set(du, kNoTriangle)));
    }
    for (uint32_t g = 0; g < groups_; ++g) {
      const int left = packet.count - static_cast<int>(g * lanes);
      active_[g] = left >= static_cast<int>(lanes) ? (1u << lanes) - 1 : (1u << left) - 1;
      if constexpr (kAny) active_[g] &= ~LaneBits(packet.unasked, g * lanes, lanes);
      live_ += std::popcount(active_[g]);
    }
  }

  uint32_t groups() const { return groups_; }                       // Vectors of lanes.
  uint32_t active(uint32_t group) const { return active_[group]; }  // Lanes still asked about.
  int live() const { return live_; }  // How many of them, when any hit ends a lane.
  float first_limit() const { return first_limit_; }
  Vec3f origin() const { return packet_.origin; }
  int count() const { return packet_.count; }
  const float* inv_row(int axis) const { return inv_[axis]; }
  const float* direction_row(int axis) const { return direction_[axis]; }
  const float* direction_inf_row() const { return direction_inf_; }
  bool segments() const { return packet_.segments; }
  uint32_t mask() const { return packet_.mask; }
  uint32_t origin_source() const { return packet_.origin_source; }
  TriangleRange unseen() const { return packet_.unseen; }
  const float* limit_row() const {
    return limit_of_;
  }  // Nearest hit or end, in units of D; -inf when done.

  // Of the lanes' reciprocals along an axis; usable where they share a sign and are finite.
  // Elsewhere intervals of the whole packet say nothing about the axis.
  struct ReciprocalRange {
    bool usable, negative;
    float least, most;
  };
  ReciprocalRange Reciprocals(int axis) const {
    // Lanes out of use copy one that is.
    const D d;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    V low = infinity, high = hn::Neg(infinity);
    M all_finite = hn::FirstN(d, hn::Lanes(d));
    for (size_t i = 0; i < static_cast<size_t>(padded_); i += hn::Lanes(d)) {
      const V inv = hn::Load(d, inv_[axis] + i);
      all_finite = hn::And(all_finite, hn::Lt(hn::Abs(inv), infinity));  // No NaN either.
      low = hn::Min(low, inv);
      high = hn::Max(high, inv);
    }
    const float least = hn::GetLane(hn::MinOfLanes(d, low));
    const float most = hn::GetLane(hn::MaxOfLanes(d, high));
    const bool finite = hn::AllTrue(d, all_finite);
    return {finite && (least > 0 || most < 0), most < 0, least, most};
  }

  // The lanes of a group that may hit something in a box, its corners given relative to the origin,
  // whatever their limits; and where each enters it. The slab test of core/geometry/box_ray.h.
  // Corner: three floats, by index.
  template <class Corner>
  HWY_INLINE M LanesMeet(uint32_t group, const Corner& lo, const Corner& hi, V* entry) const {
    const D d;
    const size_t first = group * hn::Lanes(d);
    *entry = hn::Set(d, -std::numeric_limits<float>::infinity());
    V exit = hn::Set(d, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      CutSlab(d, hn::Load(d, inv_[k] + first), hn::Set(d, lo[k]), hn::Set(d, hi[k]), entry, &exit);
    }
    return hn::Le(hn::Max(*entry, hn::Zero(d)), ExitWithMargin(d, exit));
  }
  HWY_INLINE M WithinLimits(uint32_t group, V entry) const {
    return hn::Le(entry, hn::Load(D(), limit_of_ + group * hn::Lanes(D())));
  }

  // The largest limit over all lanes, or of the groups asked about: nothing entered later matters.
  float LargestLimit(uint32_t asked = ~0u) const {
    const D d;
    V most = hn::Set(d, -std::numeric_limits<float>::infinity());
    for (uint32_t g = 0; g < groups_; ++g) {
      if ((asked >> g & 1) == 0) continue;
      most = hn::Max(most, hn::Load(d, limit_of_ + g * hn::Lanes(d)));
    }
    return hn::GetLane(hn::MaxOfLanes(d, most));
  }

  // Whether the leaf's triangle can block a ray from the origin at all, and if so, which way to
  // turn it: +1 when the origin is behind it, -1 in front, 0 when it blocks nothing. `side`,
  // `bound` as PrepareTriangles gives them.
  int Turn(const LeafView& leaf, uint32_t lane, float side, float bound) const {
    const uint32_t id = leaf.id(lane);
    if (id == packet_.origin_source || packet_.unseen.Holds(id)) return 0;
    int turn = side > bound ? 1 : side < -bound ? -1 : 0;
    if (turn == 0) {
      turn = -SideOfPlane(leaf.corner(0, lane), leaf.corner(1, lane), leaf.corner(2, lane),
                          packet_.origin);
      if (turn == 0) return 0;  // The origin lies in its plane.
    }
    if (MustAskObjects(scene_.geometry, packet_.mask) &&
        !ObjectBlocks(scene_.geometry, id, packet_.mask, -turn)) {
      return 0;
    }
    return turn;
  }

  // One triangle against the lanes `asked` of one group. Returns the lanes that need no further
  // triangle of this leaf (those just blocked, when any hit ends a lane). Without kEdges, the lanes
  // are known to pass strictly within all three edges, and only the ends are looked at.
  template <bool kEdges = true>
  HWY_INLINE uint32_t Test(const LeafView& leaf, const FacingTriangle& f, uint32_t group,
                           uint32_t asked) {
    const D d;
    const size_t first = group * hn::Lanes(d);
    stats_->triangle_tests += std::popcount(asked);
    const V underflow = hn::Set(d, kFloatUnderflow);
    const Vec3V<V> dir = LoadV(d, direction_, first);
    const V dir_inf = hn::Load(d, direction_inf_ + first);
    V least = hn::Set(d, std::numeric_limits<float>::infinity()), most = least;
    for (int e = 0; kEdges && e < 3; ++e) {
      const V value = DotV(Broadcast(d, f.edge[e][0], f.edge[e][1], f.edge[e][2]), dir);
      const V bound = hn::MulAdd(hn::Set(d, f.edge_bound[e]), dir_inf, underflow);
      least = hn::Min(least, hn::Sub(value, bound));
      most = hn::Min(most, hn::Add(value, bound));
    }
    // `most` < 0: some form is certainly negative. `least` > 0: all are certainly positive.
    uint32_t open = asked & ~MaskBits(d, hn::Lt(most, hn::Zero(d)));
    if (open == 0) return 0;
    if (packet_.segments) {
      const Vec3V<V> ap = SubV(Targets(first), Broadcast(d, f.a[0], f.a[1], f.a[2]));
      const V value = DotV(Broadcast(d, f.normal[0], f.normal[1], f.normal[2]), ap);
      const V bound =
          BoundAlong(d, Broadcast(d, f.normal_bound[0], f.normal_bound[1], f.normal_bound[2]), ap);
      open &= ~MaskBits(d, hn::Lt(hn::Add(value, bound), hn::Zero(d)));
      least = hn::Min(least, hn::Sub(value, bound));
    }
    const uint32_t id = leaf.id(f.lane);
    open &= ~SourceLanes(group, id);
    uint32_t hits = open & MaskBits(d, hn::Gt(least, hn::Zero(d)));
    const Vec3f a = leaf.corner(0, f.lane), b = leaf.corner(1, f.lane), c = leaf.corner(2, f.lane);
    for (uint32_t doubt = open & ~hits; doubt != 0; doubt &= doubt - 1) {
      const uint32_t bit = std::countr_zero(doubt);
      PredicateStage stage;
      if (Blocks(packet_.ray(static_cast<int>(first + bit)), a, b, c, &stage)) hits |= 1u << bit;
      ++stats_->doubt_double;
      stats_->doubt_exact += stage == PredicateStage::kExact;
    }
    if (hits == 0) return 0;
    if constexpr (kAny) {
      Block(id, group, hits);
      return hits;
    } else {
      KeepCloser(TriangleDistance::Make(packet_.origin, a, b, c), id, first, hits);
      return 0;
    }
  }

  // A hit of one lane, found elsewhere: kept if it is the least by (t, id).
  HWY_INLINE void Offer(size_t lane, Hit hit) {
    if (!(hit < packet_.hit(static_cast<int>(lane)))) return;
    if (packet_.near != nullptr && !(hit.t > packet_.near[lane])) return;
    packet_.t[lane] = hit.t;
    packet_.triangle[lane] = hit.triangle;
    if (hit.t < limit_of_[lane]) limit_of_[lane] = hit.t;
  }

  // Lanes of a group whose own source is triangle `id`.
  HWY_INLINE uint32_t SourceLanes(uint32_t group, uint32_t id) const {
    if (!has_sources_) return 0;
    const hn::RebindToUnsigned<D> du;
    return MaskBits(
        du, hn::Eq(hn::Load(du, packet_.target_source + group * hn::Lanes(du)), hn::Set(du, id)));
  }

  // A lane's own source; of rays that lead on there are none.
  uint32_t source(size_t lane) const {
    return has_sources_ ? packet_.target_source[lane] : kNoTriangle;
  }

  // Ends a lane, if it is `hit`, or lanes: by triangle `id`, for walks that ask for neither `live`
  // nor limits.
  HWY_INLINE void AnswerLane(uint32_t id, size_t lane, bool hit) {
    HWY_NAMESPACE::AnswerLane(id, lane, hit, active_, packet_.triangle);
  }
  HWY_INLINE void Answer(uint32_t id, uint32_t group, uint32_t hits) {
    AnswerLanes(id, group, hits, active_, packet_.triangle);
  }
  // Groups with lanes that are still asked about, a bit each.
  HWY_INLINE uint32_t ActiveGroups() const { return GroupsLeft(active_); }

  // Ends lanes: triangle `id` blocks them.
  void Block(uint32_t id, uint32_t group, uint32_t hits) {
    const D d;
    const hn::RebindToUnsigned<D> du;
    const size_t first = group * hn::Lanes(d);
    active_[group] &= ~hits;
    live_ -= std::popcount(hits);
    const uint32_t bits[2] = {hits};  // LoadMaskBits may read as many.
    const auto hit = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(bits));
    StoreWhere(hn::RebindMask(du, hit), hn::Set(du, id), du, packet_.triangle + first);
    StoreWhere(hit, hn::Set(d, -std::numeric_limits<float>::infinity()), d, limit_of_ + first);
  }

 private:
  static HWY_INLINE Vec3V<V> LoadV(D d, const float (&rows)[3][kMaxRays], size_t first) {
    return {hn::Load(d, rows[0] + first), hn::Load(d, rows[1] + first),
            hn::Load(d, rows[2] + first)};
  }
  static HWY_INLINE void StoreV(D d, const Vec3V<V>& v, float (&rows)[3][kMaxRays], size_t first) {
    hn::Store(v.x, d, rows[0] + first);
    hn::Store(v.y, d, rows[1] + first);
    hn::Store(v.z, d, rows[2] + first);
  }
  HWY_INLINE Vec3V<V> Targets(size_t first) const {
    const D d;
    return {hn::Load(d, packet_.target_x + first), hn::Load(d, packet_.target_y + first),
            hn::Load(d, packet_.target_z + first)};
  }

  // Keeps the least hit by (t, id) in the lanes of `hits`.
  HWY_INLINE void KeepCloser(const TriangleDistance& triangle, uint32_t id, size_t first,
                             uint32_t hits) {
    const D d;
    HWY_ALIGN float distances[16];
    hn::Store(HitDistances(d, triangle, packet_.origin, packet_.segments, Targets(first),
                           LoadV(d, inv_, first)),
              d, distances);
    for (; hits != 0; hits &= hits - 1) {
      const uint32_t bit = std::countr_zero(hits);
      Offer(first + bit, {distances[bit], id});
    }
  }

  const IndexedGeometry& scene_;
  RayPacket& packet_;
  WalkStats* stats_;
  uint32_t groups_ = 0;
  int padded_ = 0;
  int live_ = 0;
  bool has_sources_ = false;
  float first_limit_ = 0;
  alignas(64) uint32_t active_[kMaxRays / 8] = {};
  alignas(64) float direction_[3][kMaxRays];
  alignas(64) float inv_[3][kMaxRays];
  alignas(64) float direction_inf_[kMaxRays];
  alignas(64) float limit_of_[kMaxRays];
};

// Turns the triangles `chosen` of a leaf (bit i for lane i) into facing[0 .. returned count).
template <bool kAny>
HWY_INLINE uint32_t TurnTriangles(const PacketLanes<kAny>& lanes, const LeafView& leaf,
                                  uint32_t chosen, FacingTriangle* facing) {
  const hn::CappedTag<float, kMaxLeafTriangles> d;
  using V = hn::Vec<decltype(d)>;
  const size_t width = hn::Lanes(d);
  const Vec3V<V> o = Broadcast(d, lanes.origin().x, lanes.origin().y, lanes.origin().z);
  uint32_t count = 0;
  for (uint32_t first = 0; first < leaf.count; first += static_cast<uint32_t>(width)) {
    uint32_t todo = chosen >> first & ((1u << width) - 1);
    if (todo == 0) continue;
    const OriginTriangles<V> t = PrepareTriangles(d, leaf.rows + first, leaf.stride, o);
    // From a vector per quantity to a record per triangle, through memory.
    HWY_ALIGN float columns[23][kMaxLeafTriangles];
    const auto put = [&](int row, const Vec3V<V>& v) HWY_ATTR {
      hn::Store(v.x, d, columns[row]);
      hn::Store(v.y, d, columns[row + 1]);
      hn::Store(v.z, d, columns[row + 2]);
    };
    put(0, t.edge[0]);
    put(3, t.edge[1]);
    put(6, t.edge[2]);
    put(9, t.normal);
    put(12, t.a);
    put(15, {t.edge_bound[0], t.edge_bound[1], t.edge_bound[2]});
    put(18, t.normal_bound);
    hn::Store(t.origin_side, d, columns[21]);
    hn::Store(t.origin_bound, d, columns[22]);
    for (; todo != 0; todo &= todo - 1) {
      const uint32_t i = std::countr_zero(todo);
      const int turn = lanes.Turn(leaf, first + i, columns[21][i], columns[22][i]);
      if (turn == 0) continue;
      FacingTriangle& f = facing[count++];
      const float sign = static_cast<float>(turn);
      for (int e = 0; e < 3; ++e) {
        for (int k = 0; k < 3; ++k) f.edge[e][k] = sign * columns[3 * e + k][i];
        f.edge_bound[e] = columns[15 + e][i];
        f.normal[e] = sign * columns[9 + e][i];
        f.a[e] = columns[12 + e][i];
        f.normal_bound[e] = columns[18 + e][i];
      }
      f.depth = sign * columns[21][i];
      f.depth_bound = columns[22][i];
      f.lane = first + i;
    }
  }
  return count;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
