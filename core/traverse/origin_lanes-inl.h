// SPDX-License-Identifier: Apache-2.0
//
// The rays of a packet with one origin, as the walk for any hit asks for them
// (occluded_packet-inl.h).
//
// A box is put to what all lanes reach over together on the coordinate planes and along the axes,
// then to that of each sixteen (lane_shadows-inl.h), then to lanes by the slab test. Axes along
// which the rays do not share a sign say nothing of more than one.
//
// Thread safety: a packet's lanes are one walk's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_ORIGIN_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_ORIGIN_LANES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_ORIGIN_LANES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_ORIGIN_LANES_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "core/accel/indexed_geometry.h"
#include "core/base/check.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/box_ray-inl.h"
#include "core/shaft/frame.h"
#include "core/shaft/margins.h"
#include "core/traverse/lane_rectangles-inl.h"
#include "core/traverse/lane_shadows-inl.h"
#include "core/traverse/packet_lanes-inl.h"
#include "core/traverse/point_box-inl.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/trace_ray.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class OriginLanes {
 public:
  using Packet = RayPacket;
  using D = ShaftD;
  using V = ShaftV;
  using M = ShaftM;
  static constexpr bool kParallel = false;
  static constexpr int kMaxRays = RayPacket::kMaxRays;

  OriginLanes(const IndexedGeometry& scene, RayPacket& packet, WalkStats* stats)
      : packet_(packet), lanes_(scene, packet, stats), shadows_(static_cast<size_t>(packet.count)) {
    // Any hit knows neither (TraceRay).
    SIGHTLINE_DCHECK(packet.near == nullptr && packet.unseen.count == 0);
    for (uint32_t g = 0; g < groups(); ++g) open_groups_ |= (active(g) != 0 ? 1u : 0u) << g;
    PutMost();
    PutAxes();
    PutPlanes();
    PlaceGroups();
  }

  uint32_t groups() const { return lanes_.groups(); }
  const RayPacket& packet() const { return packet_; }
  Vec3f apex() const { return packet_.origin; }
  float spread() const { return 0; }
  uint32_t common_source() const { return packet_.origin_source; }
  // Slopes are taken in it; null: the rays lead nowhere together.
  const ShaftFrame* frame() const { return has_frame_ ? &frame_ : nullptr; }
  // Of slopes; without end where a lane leads too far aside for the frame.
  LaneRectangle rectangle(uint32_t group) const { return rectangles_.of(group); }

  // What ShaftTest asks for.
  bool segments() const { return packet_.segments; }
  Vec3f common() const { return packet_.origin; }
  HWY_INLINE Vec3V<V> Own(size_t at) const {
    const D d;
    return {hn::Load(d, lanes_.direction_row(0) + at), hn::Load(d, lanes_.direction_row(1) + at),
            hn::Load(d, lanes_.direction_row(2) + at)};
  }
  // By axis, |D| is nowhere above it.
  Vec3f most_own() const { return most_own_; }
  HWY_INLINE V Point(int axis, size_t at) const {
    return hn::Load(D(), (axis == 0   ? packet_.target_x
                          : axis == 1 ? packet_.target_y
                                      : packet_.target_z) +
                             at);
  }
  // The same of one lane, everywhere.
  HWY_INLINE Vec3V<V> OwnOf(size_t lane) const {
    return Broadcast(D(), lanes_.direction_row(0)[lane], lanes_.direction_row(1)[lane],
                     lanes_.direction_row(2)[lane]);
  }
  HWY_INLINE Vec3V<V> PointOf(size_t lane) const {
    return Broadcast(D(), packet_.target_x[lane], packet_.target_y[lane], packet_.target_z[lane]);
  }

  uint32_t open_groups() const { return open_groups_; }  // With lanes still asked about.
  // Which of the node's boxes some lane may enter.
  HWY_INLINE uint32_t MeetNode(const BvhNode& node, BoxShadows* boxes) const {
    const BoxShadows::D d8;
    using V8 = hn::Vec<BoxShadows::D>;
    const V8 zero = hn::Zero(d8), infinity = hn::Set(d8, std::numeric_limits<float>::infinity());
    V8 lo[3], hi[3];
    auto met = hn::FirstN(d8, node.child_count);
    for (int k = 0; k < 3; ++k) {
      const V8 o = hn::Set(d8, packet_.origin[k]);
      lo[k] = hn::Sub(hn::Load(d8, node.bounds[k]), o);
      hi[k] = hn::Sub(hn::Load(d8, node.bounds[k + 3]), o);
    }
    // Relative to the origin, along the way that the rays lead.
    const auto near = [&](int k) HWY_ATTR { return axes_[k].backward ? hn::Neg(hi[k]) : lo[k]; };
    const auto far = [&](int k) HWY_ATTR { return axes_[k].backward ? hn::Neg(lo[k]) : hi[k]; };
    for (int k = 0; k < 3; ++k) {
      if (axes_[k].shared) met = hn::And(met, hn::Ge(far(k), zero));
      hn::Store(hn::Neg(near(k)), d8, boxes->along[k]);
    }
    for (int k = 0; k < 3; ++k) {
      const int i = planes_[k].over, j = planes_[k].under;
      if (j < 0) {
        hn::Store(hn::Neg(infinity), d8, boxes->least[k]);
        hn::Store(infinity, d8, boxes->most[k]);
        continue;
      }
      // Of those that the origin's own height runs through nothing is known.
      const V8 nearer = near(j);
      const auto ahead = hn::Ge(nearer, hn::Set(d8, kLeastDepth));
      const V8 steep = hn::Div(hn::Set(d8, 1.0f), nearer);
      const V8 flat = hn::Div(hn::Set(d8, 1.0f), far(j));
      const V8 least = hn::Mul(lo[i], hn::IfThenElse(hn::Ge(lo[i], zero), flat, steep));
      const V8 most = hn::Mul(hi[i], hn::IfThenElse(hn::Ge(hi[i], zero), steep, flat));
      const V8 scale = hn::Set(d8, kBoxExitScale - 1), shift = hn::Set(d8, kBoxExitShift);
      const V8 below = hn::MulAdd(hn::Abs(least), scale, shift);
      const V8 above = hn::MulAdd(hn::Abs(most), scale, shift);
      hn::Store(hn::IfThenElse(ahead, hn::Sub(least, below), hn::Neg(infinity)), d8,
                boxes->least[k]);
      hn::Store(hn::IfThenElse(ahead, hn::Add(most, above), infinity), d8, boxes->most[k]);
    }
    return shadows_.BoxesMet(*boxes) & MaskBits(d8, met);
  }
  // A box's faces by axis, relative to the origin: that which the rays come to first, or the lower
  // one where they do not share a sign, and the other.
  struct LaneBox {  // Trivial: stacks of them are not initialized.
    float first[3], second[3];
  };
  // One that no lane misses: what is no number culls nothing.
  HWY_INLINE static LaneBox Everywhere() {
    constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
    return {{kNoNumber, kNoNumber, kNoNumber}, {kNoNumber, kNoNumber, kNoNumber}};
  }
  HWY_INLINE LaneBox LaneBoxOf(const BvhNode& node, const BoxShadows&, int child) const {
    LaneBox box;
    for (int k = 0; k < 3; ++k) {
      const bool turned = axes_[k].backward;
      box.first[k] = node.bounds[turned ? k + 3 : k][child] - packet_.origin[k];
      box.second[k] = node.bounds[turned ? k : k + 3][child] - packet_.origin[k];
    }
    return box;
  }
  // The lanes of a group, still asked about, that may hit something in the box.
  HWY_INLINE uint32_t LanesMeet(uint32_t group, const LaneBox& box) const {
    if (lanes_.active(group) == 0) return 0;
    const D d;
    const size_t at = group * hn::Lanes(d);
    V entry = hn::Zero(d), exit = hn::Set(d, lanes_.first_limit());
    for (int k = 0; k < 3; ++k) {
      const V inv = hn::Load(d, lanes_.inv_row(k) + at);
      const V first = hn::Set(d, box.first[k]), second = hn::Set(d, box.second[k]);
      if (axes_[k].shared) {
        entry = hn::Max(hn::Mul(first, inv), entry);
        exit = hn::Min(hn::Mul(second, inv), exit);
      } else {
        CutSlab(d, inv, first, second, &entry, &exit);
      }
    }
    return MaskBits(d, hn::Le(entry, ExitWithMargin(d, exit))) & lanes_.active(group);
  }

  // Those of the groups `asked` (bit g for group g) of which some lane may enter a child's box.
  HWY_INLINE uint32_t GroupsMeet(const BoxShadows& boxes, int child, uint32_t asked) const {
    return shadows_.GroupsMet(boxes, child) & asked & open_groups_;
  }

  // Lanes of a group whose own source is triangle `id`.
  HWY_INLINE uint32_t SourceLanes(uint32_t group, uint32_t id) const {
    return lanes_.SourceLanes(group, id);
  }
  // Ends lanes: triangle `id` blocks them. CloseGroups must follow before groups are asked about.
  HWY_INLINE void Block(uint32_t id, uint32_t group, uint32_t hits) {
    lanes_.Answer(id, group, hits);
  }
  // Ends a lane, if it is `hit`, likewise.
  HWY_INLINE void BlockLane(uint32_t id, size_t lane, bool hit) {
    lanes_.AnswerLane(id, lane, hit);
  }
  // Groups of which no lane is left are open no more.
  HWY_INLINE void CloseGroups() { open_groups_ = lanes_.ActiveGroups(); }
  // A lane's own source.
  uint32_t source(size_t lane) const { return lanes_.source(lane); }
  // Lanes of a group that are still asked about.
  uint32_t active(uint32_t group) const { return lanes_.active(group); }

 private:
  HWY_INLINE V OwnInf(size_t at) const { return hn::Load(D(), lanes_.direction_inf_row() + at); }

  void PutMost() {
    if (packet_.segments) {
      most_own_ = FarthestFrom(BoxAround(packet_), packet_.origin);
      return;
    }
    const D d;
    V inf = hn::Zero(d);
    for (uint32_t g = 0; g < groups(); ++g) inf = hn::Max(inf, OwnInf(g * hn::Lanes(d)));
    const float most = hn::GetLane(hn::MaxOfLanes(d, inf));
    most_own_ = {most, most, most};
  }

  // Around the rays' own axis.
  void MakeFrame() {
    const D d;
    const size_t lanes = hn::Lanes(d);
    Vec3V<V> sum = {hn::Zero(d), hn::Zero(d), hn::Zero(d)};
    // Every third group stands for all.
    for (uint32_t g = 0; g < groups(); g += 3) {
      const Vec3V<V> own = Own(g * lanes);
      // Without those that lead nowhere: their groups are left open below.
      const V inf = OwnInf(g * lanes);
      const V scale =
          hn::IfThenElseZero(hn::Ge(inf, hn::Set(d, kLeastDepth)), hn::Div(hn::Set(d, 1.0f), inf));
      sum = {hn::MulAdd(own.x, scale, sum.x), hn::MulAdd(own.y, scale, sum.y),
             hn::MulAdd(own.z, scale, sum.z)};
    }
    const Vec3d axis = {hn::GetLane(hn::SumOfLanes(d, sum.x)),
                        hn::GetLane(hn::SumOfLanes(d, sum.y)),
                        hn::GetLane(hn::SumOfLanes(d, sum.z))};
    const Vec3d sideways =
        ToDouble(packet_.target(std::min(3, packet_.count - 1))) - ToDouble(packet_.target(0));
    has_frame_ = MakeShaftFrame(axis, sideways, &frame_);
  }

  // Whether a neighbour's shaft has left a frame that may hold these rays.
  bool HasSeed() const {
    if (packet_.seed == nullptr || !packet_.seed->made || packet_.point_box == nullptr)
      return false;
    const Box3f& box = *packet_.point_box;
    return packet_.seed->LeadsTo((box.lo + box.hi) * 0.5f - packet_.origin);
  }

  // Finds the frame, and the groups' places in it.
  void PlaceGroups() {
    const D d;
    const size_t lanes = hn::Lanes(d);
    if (HasSeed()) {
      frame_ = packet_.seed->frame;
      has_frame_ = true;
    } else {
      MakeFrame();
    }
    if (!has_frame_) return;
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const Vec3V<V> w = Broadcast(d, frame_.w.x, frame_.w.y, frame_.w.z);
    alignas(64) float x[kMaxRays], y[kMaxRays];
    uint32_t aside = 0;
    for (uint32_t g = 0; g < groups(); ++g) {
      const Vec3V<V> own = Own(g * lanes);
      const V depth = DotV(w, own);
      aside |= (hn::AllTrue(d, FitsFrame(own, depth)) ? 0u : 1u) << g;
      const V inverse = InverseOf(depth);
      hn::Store(hn::Mul(DotV(u, own), inverse), d, x + g * lanes);
      hn::Store(hn::Mul(DotV(v, own), inverse), d, y + g * lanes);
    }
    rectangles_.Put(x, y, kSlopeMargin);
    for (; aside != 0; aside &= aside - 1) rectangles_.Open(std::countr_zero(aside));
  }

  // Which way the rays lead along the axes, and how far they reach.
  void PutAxes() {
    constexpr float kLeast = std::numeric_limits<float>::min();  // Whose reciprocal is finite.
    for (int k = 0; k < 3; ++k) {
      RowRanges ranges;
      shadows_.FindRanges(lanes_.direction_row(k), &ranges);
      axes_[k].backward = ranges.all_most <= -kLeast;
      axes_[k].shared = axes_[k].backward || ranges.all_least >= kLeast;
      if (axes_[k].shared && packet_.segments) {
        shadows_.PutAxis(k, ranges, !axes_[k].backward);
      } else {
        shadows_.OpenAxis(k);
      }
    }
  }

  // Slopes over the axis along which the middle ray leads farthest; and on the plane of the two
  // others over the next one. Of those alone along which all rays lead the same way.
  void PutPlanes() {
    const D d;
    const size_t middle = static_cast<size_t>(packet_.count / 2);
    const auto length = [&](int k) {
      return axes_[k].shared ? std::abs(lanes_.direction_row(k)[middle]) : -1.0f;
    };
    int order[3] = {0, 1, 2};
    std::sort(order, order + 3, [&](int a, int b) { return length(a) > length(b); });
    planes_[0] = {order[1], order[0]};
    planes_[1] = {order[2], order[0]};
    planes_[2] = {order[2], order[1]};
    alignas(64) float row[kMaxRays];
    for (int k = 0; k < 3; ++k) {
      if (!axes_[planes_[k].under].shared) {
        planes_[k].under = -1;
        shadows_.OpenPlane(k);
        continue;
      }
      for (uint32_t g = 0; g < groups(); ++g) {
        const size_t at = g * hn::Lanes(d);
        hn::Store(hn::Mul(hn::Load(d, lanes_.direction_row(planes_[k].over) + at),
                          hn::Abs(hn::Load(d, lanes_.inv_row(planes_[k].under) + at))),
                  d, row + at);
      }
      shadows_.PutPlane(k, row);
    }
  }

  RayPacket& packet_;
  PacketLanes<true> lanes_;
  LaneShadows shadows_;
  struct Plane {
    int over, under;  // Axes of the slope; under -1: none.
  } planes_[3];
  struct Axis {
    bool shared;    // All rays lead the same way along it,
    bool backward;  // and that is down.
  } axes_[3];
  bool has_frame_ = false;
  ShaftFrame frame_;
  LaneRectangles rectangles_;
  Vec3f most_own_;
  uint32_t open_groups_ = 0;  // With a lane that is still asked about.
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
