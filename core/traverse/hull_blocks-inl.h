// SPDX-License-Identifier: Apache-2.0
//
// What the blocks of a packet's points are together with an area light: for each, four planes that
// have the light and the block's points on their inner side, and the range of the points' inverse
// depths.
//
// A triangle's edges part it from a block's view of the light where the light is beside the
// triangle; where the triangle is beside the light, and smaller, edges of the light do: these
// planes. Along a frame at the light's centre, they lean as the light's and the block's extents
// do: x - lean·z <= side. With p a corner relative to the centre, x and z err by 4.1u|p|_1 each,
// the product and difference by 3.3u: at |lean| <= kMaxSlope below 17u|p|_1
// (core/shaft/margins.h), for corners, points and samples alike. kBoxMargin of each is added.
//
// Thread safety: plain values.

#if defined(SIGHTLINE_CORE_TRAVERSE_HULL_BLOCKS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_HULL_BLOCKS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_HULL_BLOCKS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_HULL_BLOCKS_INL_H_
#endif

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "core/shaft/margins.h"
#include "core/traverse/light_hull.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using HullRays = ShaftRays</*kAny=*/true, /*kParallel=*/false>;

struct HullBlocks {
  // By block. Sides: x - lean·z <= side, -x - lean·z <= side, and the same of y.
  alignas(64) float lean[4][kShaftBlocks], side[4][kShaftBlocks];
  // Inverse depths: middle, half extent and the largest; and of all points.
  alignas(64) float middle[kShaftBlocks], extent[kShaftBlocks], most[kShaftBlocks];
  float all_middle, all_extent, all_most;

  HullBlocks(const LightHull& light, const HullRays& rays, const ShaftBounds& bounds) {
    const ShaftD d;
    for (size_t b = 0; b < kShaftBlocks; b += hn::Lanes(d)) {
      const Range range(hn::Load(d, bounds.near + b), hn::Load(d, bounds.far + b));
      hn::Store(range.middle, d, middle + b);
      hn::Store(range.extent, d, extent + b);
      hn::Store(range.most, d, most + b);
    }
    const Range all(hn::Set(d, bounds.all_near), hn::Set(d, bounds.all_far));
    all_middle = hn::GetLane(all.middle);
    all_extent = hn::GetLane(all.extent);
    all_most = hn::GetLane(all.most);
    PlaceSides(light, rays, bounds);
  }

 private:
  // Of inverse depths, by lane.
  struct Range {
    ShaftV middle, extent, most;

    HWY_INLINE Range(ShaftV near, ShaftV far) {
      const ShaftD d;
      const ShaftV one = hn::Set(d, 1.0f), half = hn::Set(d, 0.5f);
      most = hn::Mul(hn::Div(one, near), hn::Set(d, kDepthScale));
      const ShaftV least = hn::Mul(hn::Div(one, far), hn::Set(d, 2.0f - kDepthScale));
      middle = hn::Mul(half, hn::Add(least, most));
      extent =
          hn::MulAdd(most, hn::Set(d, kDepthScale - 1.0f), hn::Mul(half, hn::Sub(most, least)));
    }
  };

  void PlaceSides(const LightHull& light, const HullRays& rays, const ShaftBounds& bounds) {
    const ShaftD d;
    // The light along an axis of the frame: what its samples reach to either side of its centre. An
    // axis is a unit vector, up to rounding, so that no |r|_inf comes to more than sqrt(3) of it
    // there; sums are rounded to floats thrice.
    constexpr float kNormShare = 1.75f;
    constexpr double kRoundUp = 1 + 0x1p-20;
    const ShaftFrame& frame = rays.frame();
    const auto reach = [&](Vec3f axis) {
      double sum = 0;
      for (const Vec3f& half : light.half) sum += std::abs(Dot(ToDouble(axis), ToDouble(half)));
      return static_cast<float>(sum * kRoundUp) + light.rest * kNormShare;
    };
    const float depth = reach(frame.w);
    // Points lie within kMostNorm1 times their depth.
    constexpr float kMostNorm1 = 4.4f;
    constexpr float kInfinity = std::numeric_limits<float>::infinity();
    for (int axis = 0; axis < 2; ++axis) {
      const Vec3f along = axis == 0 ? frame.u : frame.v;
      const float width = reach(along);
      const Vec3V<ShaftV> u = Broadcast(d, along.x, along.y, along.z);
      const Vec3V<ShaftV> w = Broadcast(d, frame.w.x, frame.w.y, frame.w.z);
      for (int end = 0; end < 2; ++end) {
        const float sign = end == 0 ? 1.0f : -1.0f;
        float* const leans = lean[2 * axis + end];
        float* const sides = side[2 * axis + end];
        const float* const slopes =
            axis == 0 ? (end == 0 ? bounds.x1 : bounds.x0) : (end == 0 ? bounds.y1 : bounds.y0);
        for (size_t b = 0; b < kShaftBlocks; b += hn::Lanes(d)) {
          // From the light's edge to the farthest slope, at the middle of the block's depths.
          const ShaftV z = hn::Load(d, middle + b);
          ShaftV slope = hn::NegMulAdd(hn::Set(d, width), z,
                                       hn::Mul(hn::Load(d, slopes + b), hn::Set(d, sign)));
          slope = hn::Min(hn::Max(slope, hn::Set(d, -kMaxSlope)), hn::Set(d, kMaxSlope));
          hn::Store(slope, d, leans + b);
        }
        HWY_ALIGN float points[kShaftBlocks];
        ReduceBlocks([](ShaftV a, ShaftV b) HWY_ATTR { return hn::Max(a, b); },
                     [&](size_t at) HWY_ATTR {
                       const Vec3V<ShaftV> q = rays.Own(at);
                       const ShaftV x = hn::Mul(DotV(u, q), hn::Set(ShaftD(), sign));
                       const ShaftV beside = hn::NegMulAdd(
                           hn::Set(ShaftD(), leans[at / kShaftBlockRays]), DotV(w, q), x);
                       // A block's second vector may hold nothing, not even numbers.
                       return hn::IfThenElse(LanesOf(bounds.open, at), beside,
                                             hn::Set(ShaftD(), -kInfinity));
                     },
                     points);
        for (size_t b = 0; b < kShaftBlocks; b += hn::Lanes(d)) {
          const ShaftV slope = hn::Load(d, leans + b);
          const ShaftV lights = hn::MulAdd(hn::Abs(slope), hn::Set(d, depth), hn::Set(d, width));
          const ShaftV margin =
              hn::MulAdd(hn::Load(d, bounds.far + b), hn::Set(d, kMostNorm1 * kBoxMargin),
                         hn::Set(d, kBoxMargin * (width + depth) + kFloatUnderflow));
          hn::Store(hn::Add(hn::Max(hn::Load(d, points + b), lights), margin), d, sides + b);
        }
      }
    }
  }
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
