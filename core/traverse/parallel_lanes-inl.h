// SPDX-License-Identifier: Apache-2.0
//
// The rays of a packet with one direction, as the walk for any hit asks for them
// (occluded_packet-inl.h).
//
// The interval test is exact about floats: a lane's slab parameter is fl(fl(face - P)·inv) with inv
// common and P between the packet's extremes, and rounding is monotone. What is no number, where
// the direction runs along the face, culls nothing (core/geometry/box_ray.h).
//
// Thread safety: a packet's lanes are one walk's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_PARALLEL_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PARALLEL_LANES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PARALLEL_LANES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PARALLEL_LANES_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/base/masked_store-inl.h"
#include "core/geometry/box_ray.h"
#include "core/shaft/frame.h"
#include "core/shaft/margins.h"
#include "core/traverse/lane_bounds.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/trace_ray.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class ParallelLanes {
 public:
  using Packet = ParallelPacket;
  using D = ShaftD;
  using V = ShaftV;
  using M = ShaftM;
  static constexpr bool kParallel = true;
  static constexpr int kMaxRays = ParallelPacket::kMaxRays;

  ParallelLanes(const IndexedGeometry&, ParallelPacket& packet, WalkStats*) : packet_(packet) {
    const D d;
    const size_t lanes = hn::Lanes(d), count = static_cast<size_t>(packet.count);
    groups_ = static_cast<uint32_t>((count + lanes - 1) / lanes);
    // Lanes out of use copy the last one in use, and are never active.
    for (size_t i = count; i < groups_ * lanes; ++i) {
      packet.origin_x[i] = packet.origin_x[count - 1];
      packet.origin_y[i] = packet.origin_y[count - 1];
      packet.origin_z[i] = packet.origin_z[count - 1];
      packet.origin_source[i] = kNoTriangle;
    }
    apex_ = packet.origin(packet.count / 2);
    V widest = hn::Zero(d);
    const hn::RebindToUnsigned<D> du;
    auto sources = hn::Set(du, kNoTriangle);
    V least[3], most[3];
    for (int k = 0; k < 3; ++k) least[k] = most[k] = hn::Load(d, row(k));
    for (uint32_t g = 0; g < groups_; ++g) {
      const size_t at = g * lanes;
      const Vec3V<V> p = {Point(0, at), Point(1, at), Point(2, at)};
      const Vec3V<V> own = SubV(p, Broadcast(d, apex_.x, apex_.y, apex_.z));
      hn::Store(own.x, d, own_[0] + at);
      hn::Store(own.y, d, own_[1] + at);
      hn::Store(own.z, d, own_[2] + at);
      widest = hn::Max(widest, Norm1V(own));
      const V* const axes[3] = {&p.x, &p.y, &p.z};
      for (int k = 0; k < 3; ++k) {
        least[k] = hn::Min(least[k], *axes[k]);
        most[k] = hn::Max(most[k], *axes[k]);
      }
      sources = hn::And(sources, hn::Load(du, packet.origin_source + at));
      const size_t left = count - at;
      active_[g] = left >= lanes ? (1u << lanes) - 1 : (1u << left) - 1;
      active_[g] &= ~LaneBits(packet.unasked, at, lanes);
      live_ += std::popcount(active_[g]);
      hn::Store(hn::Set(du, kNoTriangle), du, packet.triangle + at);
    }
    static_assert(kNoTriangle == 0xFFFFFFFFu, "all bits, so that And keeps it");
    has_sources_ = !hn::AllTrue(du, hn::Eq(sources, hn::Set(du, kNoTriangle)));
    spread_ = hn::GetLane(hn::MaxOfLanes(d, widest));
    for (int k = 0; k < 3; ++k) {
      inv_[k] = SlabReciprocal(packet.direction[k]);
      backward_[k] = std::signbit(inv_[k]);
      const float lo = hn::GetLane(hn::MinOfLanes(d, least[k]));
      const float hi = hn::GetLane(hn::MaxOfLanes(d, most[k]));
      first_[k] = backward_[k] ? lo : hi;
      last_[k] = backward_[k] ? hi : lo;
    }
    open_groups_ = 0;
    for (uint32_t g = 0; g < groups_; ++g) open_groups_ |= (active_[g] != 0 ? 1u : 0u) << g;
    for (int k = 0; k < 3; ++k) {
      for (uint32_t g = 0; g < groups_; ++g) {
        const V p = Point(k, g * lanes);
        const float lo = hn::GetLane(hn::MinOfLanes(d, p)), hi = hn::GetLane(hn::MaxOfLanes(d, p));
        group_first_[k][g] = backward_[k] ? lo : hi;
        group_last_[k][g] = backward_[k] ? hi : lo;
      }
      for (uint32_t g = groups_; g % lanes != 0; ++g) group_first_[k][g] = group_last_[k][g] = 0;
    }
    BoundGroups();
  }

  uint32_t groups() const { return groups_; }
  int live() const { return live_; }  // Lanes still asked about.
  const ParallelPacket& packet() const { return packet_; }
  Vec3f apex() const { return apex_; }      // What `Own` is relative to.
  float spread() const { return spread_; }  // Bounds |P - apex|_1.
  uint32_t common_source() const { return packet_.direction_source; }
  // Axes across the direction; null where there are none.
  const ShaftFrame* frame() const { return has_frame_ ? &frame_ : nullptr; }
  // Of offsets.
  const LaneRectangle& rectangle(uint32_t group) const { return rectangles_[group]; }

  // What ShaftTest asks for.
  static constexpr bool segments() { return false; }
  Vec3f common() const { return packet_.direction; }
  HWY_INLINE Vec3V<V> Own(size_t at) const {
    const D d;
    return {hn::Load(d, own_[0] + at), hn::Load(d, own_[1] + at), hn::Load(d, own_[2] + at)};
  }
  HWY_INLINE V Point(int axis, size_t at) const { return hn::Load(D(), row(axis) + at); }
  // The same of one lane, everywhere.
  HWY_INLINE Vec3V<V> OwnOf(size_t lane) const {
    return Broadcast(D(), own_[0][lane], own_[1][lane], own_[2][lane]);
  }
  HWY_INLINE Vec3V<V> PointOf(size_t lane) const {
    return Broadcast(D(), packet_.origin_x[lane], packet_.origin_y[lane], packet_.origin_z[lane]);
  }

  uint32_t open_groups() const { return open_groups_; }  // With lanes still asked about.
  // Which of the node's boxes some lane may enter.
  HWY_INLINE uint32_t MeetNode(const BvhNode& node) const {
    const hn::CappedTag<float, kBvhWidth> d8;
    using V8 = hn::Vec<decltype(d8)>;
    V8 entry = hn::Zero(d8), exit = hn::Set(d8, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const V8 inv = hn::Set(d8, inv_[k]);
      const V8 near = hn::Load(d8, node.bounds[backward_[k] ? k + 3 : k]);
      const V8 far = hn::Load(d8, node.bounds[backward_[k] ? k : k + 3]);
      // The running value stays second: what is no number is passed over.
      entry = hn::Max(hn::Mul(hn::Sub(near, hn::Set(d8, first_[k])), inv), entry);
      exit = hn::Min(hn::Mul(hn::Sub(far, hn::Set(d8, last_[k])), inv), exit);
    }
    const auto met =
        hn::Le(entry, hn::MulAdd(exit, hn::Set(d8, kBoxExitScale), hn::Set(d8, kBoxExitShift)));
    return MaskBits(d8, met) & ((1u << node.child_count) - 1);
  }
  HWY_INLINE LaneSlab SlabOf(const BvhNode& node, int child) const {
    LaneSlab slab;
    for (int k = 0; k < 3; ++k) {
      slab.first[k] = node.bounds[backward_[k] ? k + 3 : k][child];
      slab.second[k] = node.bounds[backward_[k] ? k : k + 3][child];
    }
    return slab;
  }
  // The lanes of a group, still asked about, that may hit something in the box.
  HWY_INLINE uint32_t LanesMeet(uint32_t group, const LaneSlab& slab) const {
    if (active_[group] == 0) return 0;
    const D d;
    const size_t at = group * hn::Lanes(d);
    V entry = hn::Zero(d), exit = hn::Set(d, std::numeric_limits<float>::infinity());
    for (int k = 0; k < 3; ++k) {
      const V p = Point(k, at), inv = hn::Set(d, inv_[k]);
      entry = hn::Max(hn::Mul(hn::Sub(hn::Set(d, slab.first[k]), p), inv), entry);
      exit = hn::Min(hn::Mul(hn::Sub(hn::Set(d, slab.second[k]), p), inv), exit);
    }
    const M met =
        hn::Le(entry, hn::MulAdd(exit, hn::Set(d, kBoxExitScale), hn::Set(d, kBoxExitShift)));
    return MaskBits(d, met) & active_[group];
  }

  // Those of the groups `asked` (bit g for group g) of which some lane may enter the box, by
  // intervals of each group's origins, all groups at once.
  HWY_INLINE uint32_t GroupsMeet(const LaneSlab& slab, uint32_t asked) const {
    const D d;
    uint32_t met = 0;
    for (uint32_t g = 0; g < groups_; g += static_cast<uint32_t>(hn::Lanes(d))) {
      V entry = hn::Zero(d), exit = hn::Set(d, std::numeric_limits<float>::infinity());
      for (int k = 0; k < 3; ++k) {
        const V inv = hn::Set(d, inv_[k]);
        const V first = hn::Load(d, group_first_[k] + g), last = hn::Load(d, group_last_[k] + g);
        entry = hn::Max(hn::Mul(hn::Sub(hn::Set(d, slab.first[k]), first), inv), entry);
        exit = hn::Min(hn::Mul(hn::Sub(hn::Set(d, slab.second[k]), last), inv), exit);
      }
      met |= MaskBits(d, hn::Le(entry, hn::MulAdd(exit, hn::Set(d, kBoxExitScale),
                                                  hn::Set(d, kBoxExitShift))))
             << g;
    }
    return met & asked & open_groups_;
  }

  // Lanes of a group whose own source is triangle `id`.
  HWY_INLINE uint32_t SourceLanes(uint32_t group, uint32_t id) const {
    if (!has_sources_) return 0;
    const hn::RebindToUnsigned<D> du;
    return MaskBits(
        du, hn::Eq(hn::Load(du, packet_.origin_source + group * hn::Lanes(du)), hn::Set(du, id)));
  }
  // Ends lanes: triangle `id` blocks them.
  HWY_INLINE void Block(uint32_t id, uint32_t group, uint32_t hits) {
    const hn::RebindToUnsigned<D> du;
    active_[group] &= ~hits;
    open_groups_ &= ~((active_[group] == 0 ? 1u : 0u) << group);
    live_ -= std::popcount(hits);
    const uint32_t bits[2] = {hits};  // LoadMaskBits may read as many.
    StoreWhere(hn::LoadMaskBits(du, reinterpret_cast<const uint8_t*>(bits)), hn::Set(du, id), du,
               packet_.triangle + group * hn::Lanes(du));
  }
  // Ends a lane, if it is `hit`: by triangle `id`.
  HWY_INLINE void BlockLane(uint32_t id, size_t lane, bool hit) {
    const size_t group = lane / hn::Lanes(D());
    active_[group] &= ~((hit ? 1u : 0u) << lane % hn::Lanes(D()));
    open_groups_ &= ~((active_[group] == 0 ? 1u : 0u) << group);
    live_ -= hit ? 1 : 0;
    packet_.triangle[lane] = hit ? id : packet_.triangle[lane];
  }
  // A lane's own source.
  uint32_t source(size_t lane) const { return packet_.origin_source[lane]; }
  // Lanes of a group that are still asked about.
  uint32_t active(uint32_t group) const { return active_[group]; }

 private:
  void BoundGroups() {
    const Vec3d sideways =
        ToDouble(packet_.origin(std::min(3, packet_.count - 1))) - ToDouble(packet_.origin(0));
    has_frame_ = MakeShaftFrame(ToDouble(packet_.direction), sideways, &frame_);
    if (!has_frame_) return;
    const D d;
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const float margin = kBoxMargin * spread_;
    for (uint32_t g = 0; g < groups_; ++g) {
      const Vec3V<V> own = Own(g * hn::Lanes(d));
      const V x = DotV(u, own), y = DotV(v, own);
      rectangles_[g] = {
          hn::GetLane(hn::MinOfLanes(d, x)) - margin, hn::GetLane(hn::MaxOfLanes(d, x)) + margin,
          hn::GetLane(hn::MinOfLanes(d, y)) - margin, hn::GetLane(hn::MaxOfLanes(d, y)) + margin};
    }
  }

  const float* row(int axis) const {
    return axis == 0 ? packet_.origin_x : axis == 1 ? packet_.origin_y : packet_.origin_z;
  }

  ParallelPacket& packet_;
  uint32_t groups_ = 0;
  int live_ = 0;
  bool has_sources_ = false;
  Vec3f apex_;
  float spread_ = 0;
  float inv_[3];
  bool backward_[3];
  float first_[3], last_[3];  // Of the origins, along the direction: the foremost and the hindmost.
  uint32_t active_[kMaxRays / 8];
  uint32_t open_groups_;  // With a lane that is still asked about.
  // As first_ and last_, by group.
  alignas(64) float group_first_[3][kMaxRays / 8], group_last_[3][kMaxRays / 8];
  bool has_frame_ = false;
  ShaftFrame frame_;
  LaneRectangle rectangles_[kMaxRays / 8];
  alignas(64) float own_[3][kMaxRays];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
