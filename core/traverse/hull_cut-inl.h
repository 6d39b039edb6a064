// SPDX-License-Identifier: Apache-2.0
//
// Makes a ShaftCut for segments from several origins, the samples of an area light, to the points
// of packets: all lie in one convex hull, and what the hull does not meet no sample sees. Where it
// meets no triangle, all samples of all its points are lit, and nothing is walked at all.
//
// The hull is held by planes: four lateral ones that lean as the light's and the points' extents do
// (shaft culling between two boxes), both ends, and the receivers' cap of shaft_rays-inl.h. Each is
// put at the outermost of all origins and points, so any lean is right and a good one is tight.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_HULL_CUT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_HULL_CUT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_HULL_CUT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_HULL_CUT_INL_H_
#endif

#include <algorithm>
#include <limits>
#include <span>

#include "core/traverse/cut_opener-inl.h"
#include "core/traverse/leaf_corners-inl.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/point_box-inl.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/shaft_rays-inl.h"
#include "core/traverse/surface_normal-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

class HullCutMaker {
 public:
  HullCutMaker(const IndexedGeometry& scene, std::span<const Vec3f> origins,
               std::span<const RayPacket> packets)
      : scene_(scene), origins_(origins), packets_(packets) {}

  // From `from`, a cut for a hull that holds this one, or from the root if it is null. False: the
  // hull has no axis (the points surround the light).
  bool Make(const ShaftCut* from, ShaftCut* cut) {
    if (!MakeFrame()) return false;
    MakeSides();
    PlaceCaps();
    margin_ = kBoxMargin * (FarthestNorm1(scene_.bvh.bounds) + Norm1(reference_) + spread_) +
              kFloatUnderflow;
    CutOpener opener(kFewCutChildren, sides_, nullptr, caps_, margin_, frame_.w);
    if (from == nullptr) {
      opener.Open(scene_.bvh.nodes[0]);
    } else {
      for (uint32_t i = 0; i < from->node_count; ++i) opener.Open(from->nodes[i]);
    }
    opener.OpenLargest(scene_.bvh);
    opener.FilterLeaves([this](ChildRef ref) HWY_ATTR { return MeetsLeaf(ref); });
    opener.Sort(/*descending=*/false);
    opener.Pack(cut);
    return true;
  }

  // A cut of these nodes and leaves, which the hull meets, once it was made. REQUIRES: there are no
  // more than a ShaftCut holds.
  void Pack(std::span<const ChildRef> children, ShaftCut* cut) const {
    CutOpener opener(ShaftCut::kMaxChildren, sides_, nullptr, caps_, margin_, frame_.w);
    for (const ChildRef child : children) opener.Take(child, BoxOf(child));
    opener.Sort(/*descending=*/false);
    opener.Pack(cut);
  }

  // What may reach into the hull, once it was made: a node's boxes,
  HWY_INLINE hn::Mask<hn::CappedTag<float, kBvhWidth>> Meeting(const BvhNode& node) const {
    return hn::And(MeetsSides(node, sides_, margin_),
                   BeyondCaps(hn::CappedTag<float, kBvhWidth>(), caps_, node.bounds));
  }
  // and of a leaf's triangles from `first` on, as many as a vector has lanes, by their vertices.
  HWY_INLINE ShaftM Meeting(const LeafView& leaf, uint32_t first) const {
    const ShaftD d;
    const V3 r = BroadcastV(reference_);
    V3 corner[3];
    V margin = hn::Zero(d);
    for (int c = 0; c < 3; ++c) {
      corner[c] = SubV(LeafCorner(leaf, c, first), r);
      margin = hn::Max(margin, Norm1V(corner[c]));
    }
    margin = hn::MulAdd(margin, hn::Set(d, kBoxMargin), hn::Set(d, kFloatUnderflow));
    ShaftM in = hn::FirstN(d, leaf.count - first);
    for (int i = 0; i < kCap; ++i) {
      const V3 n = BroadcastV(sides_.normal(i));
      const V most = hn::Max(hn::Max(DotV(n, corner[0]), DotV(n, corner[1])), DotV(n, corner[2]));
      in = hn::And(in, hn::Ge(hn::Add(most, margin), hn::Set(d, sides_.local[i])));
    }
    const V3 n = BroadcastV(sides_.normal(kCap));
    const V3 n_abs = {hn::Abs(n.x), hn::Abs(n.y), hn::Abs(n.z)};
    V most = hn::Set(d, -std::numeric_limits<float>::infinity());
    for (const V3& p : corner) {
      const V3 p_abs = {hn::Abs(p.x), hn::Abs(p.y), hn::Abs(p.z)};
      most = hn::Max(most, hn::MulAdd(DotV(n_abs, p_abs), hn::Set(d, kCapMargin), DotV(n, p)));
    }
    return hn::And(
        in, hn::Ge(hn::Add(most, hn::Set(d, kFloatUnderflow)), hn::Set(d, sides_.local[kCap])));
  }

 private:
  using V = ShaftV;
  using V3 = Vec3V<ShaftV>;
  static constexpr int kSides = 7;  // Four lateral ones, the light's end, the far end, the cap.
  static constexpr int kCap = kSides - 1;

  // fn(p - reference, origin) for all points and origins, in vectors.
  template <class Fn>
  void ForEachVector(const Fn& fn) const {
    const ShaftD d;
    const V3 r = Broadcast(d, reference_.x, reference_.y, reference_.z);
    for (const RayPacket& packet : packets_) {
      for (size_t i = 0; i < static_cast<size_t>(packet.count); i += hn::Lanes(d)) {
        const ShaftM in = hn::FirstN(d, static_cast<size_t>(packet.count) - i);
        // Lanes not in use stand at the reference, which is one of the points.
        const V3 p = SubV({hn::IfThenElse(in, hn::Load(d, packet.target_x + i), r.x),
                           hn::IfThenElse(in, hn::Load(d, packet.target_y + i), r.y),
                           hn::IfThenElse(in, hn::Load(d, packet.target_z + i), r.z)},
                          r);
        fn(p, /*origin=*/false);
      }
    }
    for (const Vec3f& origin : origins_) {
      fn(SubV(Broadcast(d, origin.x, origin.y, origin.z), r), /*origin=*/true);
    }
  }

  bool MakeFrame() {
    reference_ = packets_[0].target(packets_[0].count / 2);
    Vec3d light, points;
    for (const Vec3f& origin : origins_) light = light + ToDouble(origin);
    light = light * (1.0 / static_cast<double>(origins_.size()));
    for (const RayPacket& packet : packets_) {
      points = points + (ToDouble(packet.target(0)) + ToDouble(packet.target(packet.count / 2)) +
                         ToDouble(packet.target(packet.count - 1)));
    }
    points = points * (1.0 / (3.0 * static_cast<double>(packets_.size())));
    const RayPacket& first = packets_[0];
    const Vec3d sideways =
        ToDouble(first.target(std::min(3, first.count - 1))) - ToDouble(first.target(0));
    return MakeShaftFrame(points - light, sideways, &frame_);
  }

  static V3 BroadcastV(Vec3f v) { return Broadcast(ShaftD(), v.x, v.y, v.z); }

  void MakeSides() {
    const ShaftD d;
    const Vec3f u = frame_.u, v = frame_.v, w = frame_.w;
    // Extents of the light and of the points along the frame.
    const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    V least[2][3], most[2][3], widest = hn::Zero(d);
    for (int set = 0; set < 2; ++set) {
      for (int k = 0; k < 3; ++k) {
        least[set][k] = infinity;
        most[set][k] = hn::Neg(infinity);
      }
    }
    ForEachVector([&](const V3& p, bool origin) HWY_ATTR {
      const V at[3] = {DotV(BroadcastV(u), p), DotV(BroadcastV(v), p), DotV(BroadcastV(w), p)};
      for (int k = 0; k < 3; ++k) {
        least[origin][k] = hn::Min(least[origin][k], at[k]);
        most[origin][k] = hn::Max(most[origin][k], at[k]);
      }
      widest = hn::Max(widest, Norm1V(p));
    });
    spread_ = hn::GetLane(hn::MaxOfLanes(d, widest));
    const auto low = [&](int set, int k)
                         HWY_ATTR { return hn::GetLane(hn::MinOfLanes(d, least[set][k])); };
    const auto high = [&](int set, int k)
                          HWY_ATTR { return hn::GetLane(hn::MaxOfLanes(d, most[set][k])); };
    // How the sides lean: from the light's edge to the points', per unit of depth.
    const float depth = 0.5f * (low(0, 2) + high(0, 2) - low(1, 2) - high(1, 2));
    const auto lean = [&](float from, float to) {
      const float slope = (to - from) / depth;
      return slope > -kMaxSlope && slope < kMaxSlope ? slope : 0.0f;
    };
    const Vec3f normals[kSides] = {
        u - w * lean(low(1, 0), low(0, 0)),
        w * lean(high(1, 0), high(0, 0)) - u,
        v - w * lean(low(1, 1), low(0, 1)),
        w * lean(high(1, 1), high(0, 1)) - v,
        w,
        -w,
        -CapNormal(),
    };
    V local[kSides];
    std::fill_n(local, kSides, infinity);
    const V3 cap = BroadcastV(normals[kCap]);
    const V3 cap_abs = {hn::Abs(cap.x), hn::Abs(cap.y), hn::Abs(cap.z)};
    ForEachVector([&](const V3& p, bool) HWY_ATTR {
      for (int i = 0; i < kCap; ++i) {
        local[i] = hn::Min(local[i], DotV(BroadcastV(normals[i]), p));
      }
      // The cap's margin is a point's own, as in shaft_rays-inl.h: it is to lie close.
      const V3 p_abs = {hn::Abs(p.x), hn::Abs(p.y), hn::Abs(p.z)};
      local[kCap] = hn::Min(
          local[kCap], hn::NegMulAdd(DotV(cap_abs, p_abs), hn::Set(d, kCapMargin), DotV(cap, p)));
    });
    for (int i = 0; i < kSides; ++i) {
      float at = hn::GetLane(hn::MinOfLanes(d, local[i]));
      if (i != kCap) at -= kBoxMargin * spread_ + kFloatUnderflow;
      for (int k = 0; k < 3; ++k) sides_.n[k][i] = normals[i][k];
      sides_.local[i] = at;
    }
    sides_.count = kSides;
    PlaceSides(reference_, &sides_);
  }

  void PlaceCaps() {
    Box3f box;
    for (const RayPacket& packet : packets_) box.Extend(BoxAround(packet));
    for (int k = 0; k < 3; ++k) {
      const auto [least, most] = std::minmax_element(origins_.begin(), origins_.end(),
                                                     [k](Vec3f a, Vec3f b) { return a[k] < b[k]; });
      const bool up = (*least)[k] >= reference_[k];
      caps_.CapSegments(k, up, LeastIn(box, k, up), up ? (*least)[k] : -(*most)[k]);
    }
  }

  // Around a node's children, or a leaf's triangles.
  Box3f BoxOf(ChildRef ref) const {
    Box3f box;
    if (ref.is_inner()) {
      const hn::CappedTag<float, kBvhWidth> d8;
      const BvhNode& node = scene_.bvh.nodes[ref.node()];
      for (int k = 0; k < 3; ++k) {
        box.lo[k] = hn::GetLane(hn::MinOfLanes(d8, hn::Load(d8, node.bounds[k])));
        box.hi[k] = hn::GetLane(hn::MaxOfLanes(d8, hn::Load(d8, node.bounds[k + 3])));
      }
      return box;
    }
    const LeafView leaf(scene_, ref);
    for (uint32_t i = 0; i < leaf.count; ++i) {
      for (int c = 0; c < 3; ++c) box.Extend(leaf.corner(c, i));
    }
    return box;
  }

  // Whether a triangle of the leaf may reach into the hull.
  bool MeetsLeaf(ChildRef ref) const {
    const LeafView leaf(scene_, ref);
    for (uint32_t first = 0; first < leaf.count;
         first += static_cast<uint32_t>(hn::Lanes(ShaftD()))) {
      if (!hn::AllFalse(ShaftD(), Meeting(leaf, first))) return true;
    }
    return false;
  }

  // Along the receivers' surface where it is flat and known, else along the axis.
  Vec3f CapNormal() const {
    Vec3d sum;
    const size_t step = (packets_.size() + 3) / 4;
    for (size_t p = 0; p < packets_.size(); p += step) {
      const RayPacket& packet = packets_[p];
      const float* const rows[3] = {packet.target_x, packet.target_y, packet.target_z};
      const uint32_t* const sources = packet.sourceless ? nullptr : packet.target_source;
      sum = sum + SumOfNormals(scene_.geometry, sources, rows, packet.count, ToDouble(frame_.w));
    }
    const double size = MaxAbs(sum);
    return size > kFlat ? ToFloat(sum * (1.0 / size)) : frame_.w;
  }

  const IndexedGeometry& scene_;
  const std::span<const Vec3f> origins_;
  const std::span<const RayPacket> packets_;
  ShaftFrame frame_;
  Vec3f reference_;   // One of the points: all is taken relative to it.
  float spread_ = 0;  // Bounds |x - reference|_1 over points and origins.
  float margin_ = 0;  // Of a node's boxes.
  ShaftSides sides_{};
  AxisCaps caps_;
};

// `packets` are segments; their own origins are not looked at. REQUIRES: origins and packets are
// not empty, and no packet is.
inline bool CutHull(const IndexedGeometry& scene, std::span<const Vec3f> origins,
                    std::span<const RayPacket> packets, const ShaftCut* from, ShaftCut* cut) {
  if (scene.bvh.empty()) return false;
  return HullCutMaker(scene, origins, packets).Make(from, cut);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
