// SPDX-License-Identifier: Apache-2.0
//
// The rays of a packet with one direction, as the walk for any hit asks for them
// (occluded_packet-inl.h).
//
// A box is put to what all lanes reach over together on the coordinate planes and along the axes,
// then to that of each sixteen, then to the lanes' own (lane_shadows-inl.h).
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
#include "core/shaft/frame.h"
#include "core/shaft/margins.h"
#include "core/traverse/lane_answers-inl.h"
#include "core/traverse/lane_rectangles-inl.h"
#include "core/traverse/lane_shadows-inl.h"
#include "core/traverse/point_box-inl.h"
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

  ParallelLanes(const IndexedGeometry& scene, ParallelPacket& packet, WalkStats*)
      : packet_(packet), shadows_(static_cast<size_t>(packet.count)) {
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
    const Vec3f reach = FarthestFrom(BoxAround(packet), apex_);
    spread_ = reach.x + reach.y + reach.z;
    const hn::RebindToUnsigned<D> du;
    auto sources = hn::Set(du, kNoTriangle);
    for (uint32_t g = 0; g < groups_; ++g) {
      const size_t at = g * lanes;
      const Vec3V<V> p = {Point(0, at), Point(1, at), Point(2, at)};
      const Vec3V<V> own = SubV(p, Broadcast(d, apex_.x, apex_.y, apex_.z));
      hn::Store(own.x, d, own_[0] + at);
      hn::Store(own.y, d, own_[1] + at);
      hn::Store(own.z, d, own_[2] + at);
      if (!packet.sourceless) sources = hn::And(sources, hn::Load(du, packet.origin_source + at));
      const size_t left = count - at;
      active_[g] = left >= lanes ? (1u << lanes) - 1 : (1u << left) - 1;
      active_[g] &= ~LaneBits(packet.unasked, at, lanes);
      open_groups_ |= (active_[g] != 0 ? 1u : 0u) << g;
      hn::Store(hn::Set(du, kNoTriangle), du, packet.triangle + at);
    }
    static_assert(kNoTriangle == 0xFFFFFFFFu, "all bits, so that And keeps it");
    has_sources_ = !hn::AllTrue(du, hn::Eq(sources, hn::Set(du, kNoTriangle)));
    for (int k = 0; k < 3; ++k) {
      backward_[k] = packet.direction[k] < 0;
      turn_[k] = backward_[k] ? -0.0f : 0.0f;
    }
    PutShadows(scene);
    BoundGroups();
  }

  uint32_t groups() const { return groups_; }
  const ParallelPacket& packet() const { return packet_; }
  Vec3f apex() const { return apex_; }      // What `Own` is relative to.
  float spread() const { return spread_; }  // Bounds |P - apex|_1.
  uint32_t common_source() const { return packet_.direction_source; }
  // Axes across the direction; null where there are none.
  const ShaftFrame* frame() const { return has_frame_ ? &frame_ : nullptr; }
  // Of offsets.
  LaneRectangle rectangle(uint32_t group) const { return rectangles_.of(group); }

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
  HWY_INLINE uint32_t MeetNode(const BvhNode& node, BoxShadows* boxes) const {
    const BoxShadows::D d8;
    using V8 = hn::Vec<BoxShadows::D>;
    V8 lo[3], hi[3];
    for (int k = 0; k < 3; ++k) {
      const V8 reference = hn::Set(d8, apex_[k]);
      lo[k] = hn::Sub(hn::Load(d8, node.bounds[k]), reference);
      hi[k] = hn::Sub(hn::Load(d8, node.bounds[k + 3]), reference);
      const V8 last = hn::Load(d8, node.bounds[backward_[k] ? k : k + 3]);
      hn::Store(backward_[k] ? hn::Neg(last) : last, d8, boxes->along[k]);
    }
    const V8 margin = hn::Set(d8, shadow_margin_);
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      const V8 di = hn::Set(d8, scaled_[i]), dj = hn::Set(d8, scaled_[j]);
      const V8 i0 = backward_[j] ? lo[i] : hi[i], i1 = backward_[j] ? hi[i] : lo[i];
      const V8 j0 = backward_[i] ? hi[j] : lo[j], j1 = backward_[i] ? lo[j] : hi[j];
      hn::Store(hn::Sub(hn::MulSub(di, j0, hn::Mul(dj, i0)), margin), d8, boxes->least[k]);
      hn::Store(hn::Add(hn::MulSub(di, j1, hn::Mul(dj, i1)), margin), d8, boxes->most[k]);
    }
    return shadows_.BoxesMet(*boxes) & ((1u << node.child_count) - 1);
  }
  // What a lane is put to of a box.
  using LaneBox = BoxShadow;
  HWY_INLINE static LaneBox Everywhere() {
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    LaneBox all;
    for (int k = 0; k < 3; ++k) {
      all.least[k] = -kInfinity;
      all.most[k] = all.along[k] = kInfinity;
    }
    return all;
  }
  HWY_INLINE LaneBox LaneBoxOf(const BvhNode&, const BoxShadows& boxes, int child) const {
    return {boxes, child};
  }
  // The lanes of a group, still asked about, that may hit something in the box.
  HWY_INLINE uint32_t LanesMeet(uint32_t group, const LaneBox& box) const {
    const D d;
    const size_t at = group * hn::Lanes(d);
    M in = hn::FirstN(d, hn::Lanes(d));
    for (int k = 0; k < 3; ++k) {
      const V m = hn::Load(d, moments_[k] + at);
      const V height = hn::Xor(Point(k, at), hn::Set(d, turn_[k]));
      in = hn::And(
          in, hn::And(hn::Le(m, hn::Set(d, box.most[k])), hn::Ge(m, hn::Set(d, box.least[k]))));
      in = hn::And(in, hn::Le(height, hn::Set(d, box.along[k])));
    }
    return MaskBits(d, in) & active_[group];
  }

  // Those of the groups `asked` (bit g for group g) of which some lane may enter a child's box.
  HWY_INLINE uint32_t GroupsMeet(const BoxShadows& boxes, int child, uint32_t asked) const {
    return shadows_.GroupsMet(boxes, child) & asked & open_groups_;
  }

  // Lanes of a group whose own source is triangle `id`.
  HWY_INLINE uint32_t SourceLanes(uint32_t group, uint32_t id) const {
    if (!has_sources_) return 0;
    const hn::RebindToUnsigned<D> du;
    return MaskBits(
        du, hn::Eq(hn::Load(du, packet_.origin_source + group * hn::Lanes(du)), hn::Set(du, id)));
  }
  // Ends lanes: triangle `id` blocks them. CloseGroups must follow before groups are asked about.
  HWY_INLINE void Block(uint32_t id, uint32_t group, uint32_t hits) {
    AnswerLanes(id, group, hits, active_, packet_.triangle);
  }
  // Ends a lane, if it is `hit`, likewise.
  HWY_INLINE void BlockLane(uint32_t id, size_t lane, bool hit) {
    AnswerLane(id, lane, hit, active_, packet_.triangle);
  }
  // Groups of which no lane is left are open no more.
  HWY_INLINE void CloseGroups() { open_groups_ = GroupsLeft(active_); }
  // A lane's own source.
  uint32_t source(size_t lane) const {
    return has_sources_ ? packet_.origin_source[lane] : kNoTriangle;
  }
  // Lanes of a group that are still asked about.
  uint32_t active(uint32_t group) const { return active_[group]; }

 private:
  void PutShadows(const IndexedGeometry& scene) {
    const D d;
    const Vec3f direction = packet_.direction;
    const float most = MaxAbs(direction);
    // A power of two, so that nothing overflows.
    const float scale = most > 0 ? std::ldexp(1.0f, std::clamp(-std::ilogb(most), -126, 126)) : 1;
    shadow_margin_ =
        kBoxMargin * (FarthestNorm1(scene.bvh.bounds) + Norm1(apex_) + spread_) + kFloatUnderflow;
    const auto count = static_cast<size_t>(packet_.count);
    for (int k = 0; k < 3; ++k) scaled_[k] = direction[k] * scale;
    for (int k = 0; k < 3; ++k) {
      const int i = (k + 1) % 3, j = (k + 2) % 3;
      float* const row = moments_[k];
      const V di = hn::Set(d, scaled_[i]), dj = hn::Set(d, scaled_[j]);
      for (size_t at = 0; at < count; at += hn::Lanes(d)) {
        const V oi = hn::Load(d, own_[i] + at), oj = hn::Load(d, own_[j] + at);
        hn::Store(hn::MulSub(di, oj, hn::Mul(dj, oi)), d, row + at);
      }
      shadows_.PutPlane(k, row);
    }
    // What lies behind an origin; where a ray does not move along an axis, that is what lies below.
    for (int k = 0; k < 3; ++k) {
      RowRanges points;
      shadows_.FindRanges(this->row(k), &points);
      shadows_.PutAxis(k, points, backward_[k]);
    }
  }

  void BoundGroups() {
    const Vec3d sideways =
        ToDouble(packet_.origin(std::min(3, packet_.count - 1))) - ToDouble(packet_.origin(0));
    has_frame_ = MakeShaftFrame(ToDouble(packet_.direction), sideways, &frame_);
    if (!has_frame_) return;
    const D d;
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const float margin = kBoxMargin * spread_;
    alignas(64) float x[kMaxRays], y[kMaxRays];
    for (uint32_t g = 0; g < groups_; ++g) {
      const size_t at = g * hn::Lanes(d);
      const Vec3V<V> own = Own(at);
      hn::Store(DotV(u, own), d, x + at);
      hn::Store(DotV(v, own), d, y + at);
    }
    rectangles_.Put(x, y, margin);
  }

  const float* row(int axis) const {
    return axis == 0 ? packet_.origin_x : axis == 1 ? packet_.origin_y : packet_.origin_z;
  }

  ParallelPacket& packet_;
  uint32_t groups_ = 0;
  bool has_sources_ = false;
  Vec3f apex_;
  float spread_ = 0;
  bool backward_[3];
  alignas(64) uint32_t active_[kMaxRays / 8] = {};
  uint32_t open_groups_ = 0;  // With a lane that is still asked about.
  LaneShadows shadows_;
  alignas(64) float moments_[3][LaneShadows::kRays];
  float scaled_[3];  // The direction, its largest component between 1 and 2.
  float turn_[3];    // Its components' signs alone.
  float shadow_margin_;
  bool has_frame_ = false;
  ShaftFrame frame_;
  LaneRectangles rectangles_;
  alignas(64) float own_[3][kMaxRays];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
