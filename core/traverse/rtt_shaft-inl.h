// SPDX-License-Identifier: Apache-2.0
//
// The shaft of a tile's rays for relevant triangles tracing (paper 002): four corner rays from the
// common origin, between which every ray of the tile certainly runs.
//
// The corners are not rays of the tile: rays are rounded one by one, so that those on a tile's edge
// may stand an ulp outside of its outermost rays. They bound the tile's slopes in a frame along it,
// widened by a little (kWiden), and what is claimed is then verified with the stored numbers: with
// corners c_0 .. c_3 (directions, or ends relative to the origin), n_i = c_i × c_(i+1), and for
// every ray D and every two other corners, n_i·D > 0 beyond the float stage's bound (kFloatUnits,
// the same form as an edge of the predicate). So the cone of the corners is convex and holds all
// rays, exactly. Segments also end before the corners' ends do: the depth of every end along the
// frame's axis is less than that of each corner, by kEndMargin.
//
// Thread safety: plain values.

#if defined(SIGHTLINE_CORE_TRAVERSE_RTT_SHAFT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_RTT_SHAFT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_RTT_SHAFT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_RTT_SHAFT_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "core/geometry/box3.h"
#include "core/geometry/box_ray.h"
#include "core/intersect/predicate-inl.h"
#include "core/shaft/frame.h"
#include "core/traverse/trace_ray.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Lanes first .. first + count - 1 of a packet. REQUIRES: lanes up to the next multiple of a
// vector's hold some ray's target.
struct RttRays {
  const RayPacket* packet;
  int first, count;
};

class RttShaft {
 public:
  // Shares of the tile's own width, and of its depth, by which the shaft is larger. The first must
  // be well above the rounding of rays: an ulp is 2^-23 of a direction, a tile of a picture at
  // least a thousandth of one.
  static constexpr double kWiden = 1.0 / 32;
  static constexpr double kLeastWiden = 0x1p-18;
  // Depths are sums of three products of once rounded numbers, none less than 0.3 of their terms'
  // sum (kMaxSlope): good to 2^-19.
  static constexpr float kEndMargin = 1.0f + 0x1p-10f;

  // Bounds the rays. False: no shaft certainly holds them all. REQUIRES: all have one origin and
  // one kind of target, and there are some.
  bool Bound(std::span<const RttRays> rays) {
    const RayPacket& packet = *rays[0].packet;
    origin_ = packet.origin;
    segments_ = packet.segments;
    if (!MakeFrame(rays)) return false;
    const D d;
    V least_u = hn::Set(d, kMaxSlope), most_u = hn::Neg(least_u), least_v = least_u,
      most_v = most_u;
    V least_depth = hn::Set(d, std::numeric_limits<float>::infinity()), most_depth = hn::Zero(d);
    ForEachVector(rays, [&](const Vec3V<V>& dir) HWY_ATTR {
      const V depth = DotV(dir, Broadcast(d, frame_.w.x, frame_.w.y, frame_.w.z));
      const V u = hn::Div(DotV(dir, Broadcast(d, frame_.u.x, frame_.u.y, frame_.u.z)), depth);
      const V v = hn::Div(DotV(dir, Broadcast(d, frame_.v.x, frame_.v.y, frame_.v.z)), depth);
      least_u = hn::Min(least_u, u);
      most_u = hn::Max(most_u, u);
      least_v = hn::Min(least_v, v);
      most_v = hn::Max(most_v, v);
      least_depth = hn::Min(least_depth, depth);
      most_depth = hn::Max(most_depth, depth);
      return true;
    });
    const float u0 = hn::GetLane(hn::MinOfLanes(d, least_u)),
                u1 = hn::GetLane(hn::MaxOfLanes(d, most_u)),
                v0 = hn::GetLane(hn::MinOfLanes(d, least_v)),
                v1 = hn::GetLane(hn::MaxOfLanes(d, most_v)),
                depth = hn::GetLane(hn::MaxOfLanes(d, most_depth));
    const float limit = kMaxSlope;
    if (!(hn::GetLane(hn::MinOfLanes(d, least_depth)) > 0) || !std::isfinite(depth) ||
        !(u0 > -limit && u1 < limit && v0 > -limit && v1 < limit)) {
      return false;
    }
    const double wider_u = kWiden * (double{u1} - u0) + kLeastWiden;
    const double wider_v = kWiden * (double{v1} - v0) + kLeastWiden;
    const double us[2] = {u0 - wider_u, u1 + wider_u}, vs[2] = {v0 - wider_v, v1 + wider_v};
    for (int i = 0; i < 4; ++i) {
      const Vec3d c = ToDouble(frame_.w) + us[(i == 1 || i == 2)] * ToDouble(frame_.u) +
                      vs[i >= 2] * ToDouble(frame_.v);
      // Twice the margin: one is left after rounding.
      const double scale = double{depth} * (2 * double{kEndMargin} - 1);
      corner_[i] = segments_ ? ToFloat(ToDouble(origin_) + scale * c) : ToFloat(c);
      direction_[i] = segments_ ? corner_[i] - origin_ : corner_[i];
    }
    return Verify(rays, depth);
  }

  Vec3f origin() const { return origin_; }
  bool segments() const { return segments_; }
  // Of a corner ray: its direction, for segments fl(end - origin).
  Vec3f direction(int corner) const { return direction_[corner]; }

  // The corners' parameter at which everything in `box` that lies between them has been passed.
  float EndOf(const Box3f& box) const {
    double deepest = 0;
    for (int i = 0; i < 8; ++i) {
      const Vec3d p = {i & 1 ? box.hi.x : box.lo.x, i & 2 ? box.hi.y : box.lo.y,
                       i & 4 ? box.hi.z : box.lo.z};
      deepest = std::max(deepest, Dot(p - ToDouble(origin_), ToDouble(frame_.w)));
    }
    double least = std::numeric_limits<double>::infinity();
    for (const Vec3f& c : direction_) least = std::min(least, Dot(ToDouble(c), ToDouble(frame_.w)));
    return static_cast<float>(deepest / least * kEndMargin);
  }

  // fn(directions) for each vector of rays, as long as it returns true.
  template <class Fn>
  HWY_INLINE bool ForEachVector(std::span<const RttRays> rays, const Fn& fn) const {
    const D d;
    const Vec3V<hn::Vec<D>> o = Broadcast(d, origin_.x, origin_.y, origin_.z);
    for (const RttRays& some : rays) {
      const int end = some.first + some.count;
      for (int i = some.first; i < end; i += static_cast<int>(hn::Lanes(d))) {
        Vec3V<hn::Vec<D>> dir = Targets(*some.packet, i);
        if (segments_) dir = SubV(dir, o);
        if (!fn(dir)) return false;
      }
    }
    return true;
  }

 private:
  using D = hn::CappedTag<float, 16>;
  using V = hn::Vec<D>;

  static HWY_INLINE Vec3V<V> Targets(const RayPacket& packet, int lane) {
    const D d;
    return {hn::Load(d, packet.target_x + lane), hn::Load(d, packet.target_y + lane),
            hn::Load(d, packet.target_z + lane)};
  }

  Vec3d UnitDirection(const RttRays& rays, int lane) const {
    const Vec3d target = ToDouble(rays.packet->target(rays.first + lane));
    const Vec3d direction = segments_ ? target - ToDouble(origin_) : target;
    return direction * (1.0 / Length(direction));
  }

  // Along the first and the last ray, turned so that rows of pixels are sides.
  bool MakeFrame(std::span<const RttRays> rays) {
    const Vec3d first = UnitDirection(rays.front(), 0);
    const Vec3d last = UnitDirection(rays.back(), rays.back().count - 1);
    const Vec3d beside = UnitDirection(rays.front(), std::min(3, rays.front().count - 1));
    return MakeShaftFrame(first + last, beside - first, &frame_);
  }

  HWY_INLINE bool Verify(std::span<const RttRays> rays, float depth) const {
    const D d;
    const V underflow = hn::Set(d, kFloatUnderflow);
    for (const Vec3f& c : direction_) {
      const Vec3d w = ToDouble(frame_.w);
      if (segments_ && !(Dot(ToDouble(c), w) > double{depth} * kEndMargin)) return false;
      // Subnormal components have no reciprocal.
      for (int axis = 0; axis < 3; ++axis) {
        if (std::isnan(SlabReciprocal(c[axis]))) return false;
      }
    }
    Vec3f normal[4];
    float bound[4];
    for (int i = 0; i < 4; ++i) {
      const Vec3f a = direction_[i], ab = corner_[(i + 1) % 4] - corner_[i];
      normal[i] = Cross(a, ab);
      bound[i] = kFloatUnits * (Norm1(a) * Norm1(ab)) + kFloatUnderflow;
    }
    // The corners run the same way around for any frame: u × v = w.
    for (int i = 0; i < 4; ++i) {
      for (int other = 2; other < 4; ++other) {
        const Vec3f c = direction_[(i + other) % 4];
        if (!(Dot(normal[i], c) > bound[i] * MaxAbs(c) + kFloatUnderflow)) return false;
      }
    }
    return ForEachVector(rays, [&](const Vec3V<V>& dir) HWY_ATTR {
      const V inf = NormInfV(dir);
      auto inside = hn::Gt(inf, hn::Zero(d));
      for (int i = 0; i < 4; ++i) {
        const V value = DotV(Broadcast(d, normal[i].x, normal[i].y, normal[i].z), dir);
        inside = hn::And(inside, hn::Gt(value, hn::MulAdd(hn::Set(d, bound[i]), inf, underflow)));
      }
      return hn::AllTrue(d, inside);
    });
  }

  static float Norm1(const Vec3f& a) { return std::abs(a.x) + std::abs(a.y) + std::abs(a.z); }

  Vec3f origin_;
  bool segments_ = false;
  ShaftFrame frame_;
  Vec3f corner_[4];     // Targets, as a ray's.
  Vec3f direction_[4];  // Rounded.
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
