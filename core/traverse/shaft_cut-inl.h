// SPDX-License-Identifier: Apache-2.0
//
// Makes a ShaftCut for packets with one origin, or one direction, together, and for all rays
// between theirs.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_CUT_INL_H_
#endif

#include <algorithm>
#include <limits>
#include <span>

#include "core/traverse/cut_opener-inl.h"
#include "core/traverse/point_box-inl.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <bool kParallel>
class CutMaker {
 public:
  using Packet = std::conditional_t<kParallel, ParallelPacket, RayPacket>;

  CutMaker(const IndexedGeometry& scene, std::span<const Packet> packets)
      : scene_(scene), packets_(packets) {}

  // False: the rays fit no frame together.
  bool Make(ShaftCut* cut) {
    if (!MakeFrame() || !Bound()) return false;
    CutOpener opener(kParallel ? kFewCutChildren : ShaftCut::kMaxChildren, sides_, &wedges_, caps_,
                     margin_, frame_.w);
    opener.Open(scene_.bvh.nodes[0]);
    opener.OpenLargest(scene_.bvh);
    // Near before far; for any hit what is nearest to the light first, which blocks the most.
    opener.Sort(/*descending=*/kParallel);
    opener.Pack(cut);
    return true;
  }

 private:
  using V = ShaftV;

  bool Segments() const {
    if constexpr (kParallel) {
      return false;
    } else {
      return packets_[0].segments;
    }
  }
  const float* Row(const Packet& packet, int axis) const {
    if constexpr (kParallel) {
      return axis == 0 ? packet.origin_x : axis == 1 ? packet.origin_y : packet.origin_z;
    } else {
      return axis == 0 ? packet.target_x : axis == 1 ? packet.target_y : packet.target_z;
    }
  }
  // As `own` of shaft_rays-inl.h.
  Vec3d Own(const Packet& packet, int lane) const {
    Vec3f own = {Row(packet, 0)[lane], Row(packet, 1)[lane], Row(packet, 2)[lane]};
    if (kParallel || Segments()) own = own - apex_;
    return ToDouble(own);
  }

  // A lane for each corner of a box, and again if there are more lanes.
  static HWY_INLINE Vec3V<V> CornersOf(const Box3f& box) {
    const auto along = [&](uint8_t first, int k) HWY_ATTR {
      const uint8_t high[8] = {first, first};
      return hn::IfThenElse(hn::LoadMaskBits(ShaftD(), high), hn::Set(ShaftD(), box.hi[k]),
                            hn::Set(ShaftD(), box.lo[k]));
    };
    return {along(0xAA, 0), along(0xCC, 1), along(0xF0, 2)};
  }

  bool MakeFrame() {
    const Packet& first = packets_[0];
    Vec3d axis;
    if constexpr (kParallel) {
      apex_ = first.origin(0);
      axis = ToDouble(first.direction);
    } else {
      apex_ = first.origin;
      Box3f all;
      for (const Packet& packet : packets_) {
        const Box3f box = BoxAround(packet);
        if (!box.empty()) all.Extend(box);
      }
      axis = (ToDouble(all.lo) + ToDouble(all.hi)) * 0.5;
      if (Segments()) axis = axis - ToDouble(apex_);
    }
    const Vec3d sideways = Own(first, std::min(3, first.count - 1)) - Own(first, 0);
    return MakeShaftFrame(axis, sideways, &frame_);
  }

  bool Bound() {
    const ShaftD d;
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    const Vec3V<V> u = Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z);
    const Vec3V<V> v = Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z);
    const Vec3V<V> w = Broadcast(d, frame_.w.x, frame_.w.y, frame_.w.z);
    const Vec3V<V> o = Broadcast(d, apex_.x, apex_.y, apex_.z);
    V x0 = infinity, x1 = hn::Neg(infinity), y0 = x0, y1 = x1, z0 = x0, z1 = x1;
    V widest = hn::Zero(d);
    bool fits = true;
    Box3f all;  // Around all points.
    // A packet's box stands for its points. Slopes and offsets are extreme at its corners, and
    // finding it takes a quarter of the operations; the outline becomes little wider.
    for (const Packet& packet : packets_) {
      const Box3f box = BoxAround(packet);
      if (box.empty()) continue;  // Nothing of it is asked about.
      all.Extend(box);
      Vec3V<V> own = CornersOf(box);
      if (kParallel || Segments()) own = SubV(own, o);
      V x = DotV(u, own), y = DotV(v, own);
      const V z = DotV(w, own);
      if constexpr (kParallel) {
        widest = hn::Max(widest, Norm1V(own));
      } else {
        fits = fits && hn::AllTrue(d, FitsFrame(own, z));
        const V inverse = hn::Div(hn::Set(d, 1.0f), z);
        x = hn::Mul(x, inverse);
        y = hn::Mul(y, inverse);
      }
      x0 = hn::Min(x0, x);
      x1 = hn::Max(x1, x);
      y0 = hn::Min(y0, y);
      y1 = hn::Max(y1, y);
      z0 = hn::Min(z0, z);
      z1 = hn::Max(z1, z);
    }
    if (!fits) return false;
    const float spread = hn::GetLane(hn::MaxOfLanes(d, widest));
    const float widen = kParallel ? kBoxMargin * spread : kOutlineMargin;
    const float near = hn::GetLane(hn::MinOfLanes(d, z0));
    const float far = hn::GetLane(hn::MaxOfLanes(d, z1)) * kDepthScale;
    const FrameRectangle held = {.left = hn::GetLane(hn::MinOfLanes(d, x0)) - widen,
                                 .right = hn::GetLane(hn::MaxOfLanes(d, x1)) + widen,
                                 .below = hn::GetLane(hn::MinOfLanes(d, y0)) - widen,
                                 .above = hn::GetLane(hn::MaxOfLanes(d, y1)) + widen};
    MakeShaftSides<kParallel>(frame_, apex_, held, near, Segments() ? &far : nullptr, nullptr,
                              &sides_);
    margin_ =
        kBoxMargin * (FarthestNorm1(scene_.bvh.bounds) + Norm1(apex_) + spread) + kFloatUnderflow;
    if constexpr (kParallel) {
      MakeParallelWedges(frame_, packets_[0].direction, apex_, held, margin_, &wedges_);
    } else {
      MakeApexWedges(frame_, apex_, held, margin_, &wedges_);
    }
    for (int k = 0; k < 3; ++k) {
      if constexpr (kParallel) {
        const float direction = packets_[0].direction[k];
        caps_.CapRays(k, LeastIn(all, k, direction > 0), direction);
      } else if (Segments()) {
        const bool up = apex_[k] - all.lo[k] >= all.hi[k] - apex_[k];
        caps_.CapSegments(k, up, LeastIn(all, k, up), up ? apex_[k] : -apex_[k]);
      }
    }
    return true;
  }

  const IndexedGeometry& scene_;
  std::span<const Packet> packets_;
  ShaftFrame frame_;
  Vec3f apex_;
  ShaftSides sides_;
  ShaftWedges wedges_;
  AxisCaps caps_;
  float margin_ = 0;
};

template <bool kParallel>
bool CutShaft(const IndexedGeometry& scene,
              std::span<const typename CutMaker<kParallel>::Packet> packets, ShaftCut* cut) {
  if (packets.empty() || scene.bvh.empty()) return false;
  return CutMaker<kParallel>(scene, packets).Make(cut);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
