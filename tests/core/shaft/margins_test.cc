// SPDX-License-Identifier: Apache-2.0
//
// Every margin of core/shaft/margins.h against the error that it is there for: the float quantity
// as the shaft walk computes it (core/traverse/shaft_rays-inl.h, shaft_leaf-inl.h, shaft-inl.h),
// its exact value in 113-bit arithmetic (whose own error is 2^-80 of the margins), and a hill climb
// that hunts for the input at which they differ most.
//
// Each constant but one has a hunt that must come within a sixteenth of it, so one made sixteen
// times smaller fails (kOutlineMargin: within a thirty-second). How near each came is printed; over
// ten seeds, error over margin was
//
//   kSlopeMargin    0.31-0.34      kBoxMargin, planes and corners    0.28-0.33
//   kOutlineMargin  0.04-0.06                  planes and boxes      0.26-0.34
//   kCornerMargin   0.12-0.17                  depths                0.10-0.12
//   kDepthScale     0.16-0.19                  parallel offsets      0.05-0.06
//   kInverseMargin  0.22-0.25      kEdgeMargin, edges and planes     0.07-0.12
//   kCapMargin      0.72-0.76                   parallel, of a block 0.04-0.05
//   kParallelUnits  0.35-0.46
//
// What is far from its margin is so because derivations add up what cannot all be largest at once.
#include "core/shaft/margins.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/geometry/camera.h"
#include "core/intersect/hit.h"
#include "core/intersect/predicate-inl.h"
#include "core/shaft/frame.h"
#include "gtest/gtest.h"
#include "tests/core/shaft/margin_fixture.h"
#include "tests/core/shaft/margin_hunt.h"

namespace sightline::testing_support {
namespace {

using HWY_NAMESPACE::kFloatUnderflow;
using HWY_NAMESPACE::kFloatUnits;

// ---- Rays with a common origin

// Of a ray or segment: its depth and slopes as ShaftRays::Project places it, and the true ones.
struct Placed {
  Vec3f own;
  float x, y, z, inverse;
  Quad true_x, true_y, true_z;
};
std::optional<Placed> Place(const ShaftFrame& frame, Vec3f origin, Vec3f end, bool segment) {
  Placed p;
  p.own = segment ? end - origin : end;
  p.z = DotF(frame.w, p.own);
  // FitsFrame.
  if (!(p.z >= kLeastDepth) ||
      !(p.z * p.z >= kMinDepthShare * kMinDepthShare * DotF(p.own, p.own))) {
    return std::nullopt;
  }
  p.inverse = 1.0f / p.z;
  p.x = DotF(frame.u, p.own) * p.inverse;
  p.y = DotF(frame.v, p.own) * p.inverse;
  const Vec3q d = segment ? ToQuad(end) - ToQuad(origin) : ToQuad(end);
  p.true_z = DotQ(ToQuad(frame.w), d);
  p.true_x = DotQ(ToQuad(frame.u), d) / p.true_z;
  p.true_y = DotQ(ToQuad(frame.v), d) / p.true_z;
  return p;
}

// How much of the way from the computed slope to the widened end the true slope is.
double SlopeRatio(float computed, Quad exact) {
  const float end = exact > computed ? computed + kSlopeMargin : computed - kSlopeMargin;
  return Ratio(exact - computed, AbsQ(Quad(end) - computed));
}

TEST_F(MarginsTest, WidenedSlopesHoldTheirRays) {
  for (const bool segment : {false, true}) {
    hunt_.Run(
        ScaledCount(kClimbs),
        [&] {
          const Vec3f axis = Random(1);
          const double scale = Scale(-55, 35);
          const Vec3f origin = Random(rng_.Chance(0.5) ? scale : Scale(0, 39));
          const Vec3f d = NearTheLimit(axis) * static_cast<float>(scale);
          HuntInput input;
          for (const Vec3f v : {axis, Random(1), origin, segment ? origin + d : d}) {
            Append(v, &input);
          }
          return input;
        },
        [&](const HuntInput& input) -> std::optional<double> {
          const auto frame = FrameOf(At(input, 0), At(input, 1));
          if (!frame) return std::nullopt;
          const auto p = Place(*frame, At(input, 2), At(input, 3), segment);
          if (!p) return std::nullopt;
          EXPECT_LE(std::abs(p->x), kMaxSlope) << Hex(input);
          EXPECT_LE(std::abs(p->y), kMaxSlope) << Hex(input);
          // With the quotient, and with reciprocals as far off as InverseOf's may be.
          double worst = 0;
          for (const double off : {0.0, 3.3 * 0x1p-24, -3.3 * 0x1p-24}) {
            const auto inverse = static_cast<float>((1 + off) / p->z);
            const float x = DotF(frame->u, p->own) * inverse, y = DotF(frame->v, p->own) * inverse;
            worst = std::max({worst, SlopeRatio(x, p->true_x), SlopeRatio(y, p->true_y)});
          }
          return worst;
        });
  }
  Report("kSlopeMargin", hunt_, kTight);
}

// The pixels of a group between those of its corners, of a camera that looks anywhere.
TEST_F(MarginsTest, OutlinesHoldTheirPixels) {
  hunt_.Run(
      ScaledCount(kClimbs),
      [&] {
        HuntInput input;
        for (const Vec3f v : {Random(1), Random(1)}) Append(v, &input);
        // Half of them as wide as a frame holds, the whole picture one group.
        const bool wide = rng_.Chance(0.5);
        input.push_back(static_cast<float>(wide ? rng_.Uniform(95, 113) : rng_.Uniform(5, 113)));
        // The group's place and size, the pixel's place in it, and the image's size, as shares.
        for (int k = 0; k < 6; ++k) input.push_back(static_cast<float>(rng_.Uniform(0, 1)));
        if (wide) input[9] = 0.999f, input[12] = 0.1f;
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        for (size_t k = 7; k < 13; ++k) {
          if (!(input[k] >= 0 && input[k] < 1)) return std::nullopt;
        }
        // The wider a pixel, the farther apart the corners' slopes.
        constexpr uint32_t kMost = 64;
        const uint32_t image = kMost << static_cast<int>(input[12] * 6);
        const auto camera = LookAt({0, 0, 0}, ToDouble(At(input, 0)), ToDouble(At(input, 1)),
                                   input[6], image, image);
        if (!camera.ok()) return std::nullopt;
        const uint32_t side = 1 + static_cast<uint32_t>(input[9] * kMost);
        const auto x0 = static_cast<uint32_t>(input[7] * (image - side));
        const auto y0 = static_cast<uint32_t>(input[8] * (image - side));
        const uint32_t x1 = x0 + side - 1, y1 = y0 + side - 1;
        const Vec3f corners[] = {PixelDirection(*camera, x0, y0), PixelDirection(*camera, x0, y1),
                                 PixelDirection(*camera, x1, y1), PixelDirection(*camera, x1, y0)};
        const auto frame =
            FrameOf((corners[0] + corners[2]) + (corners[1] + corners[3]), corners[3] - corners[0]);
        if (!frame) return std::nullopt;
        float lo[2] = {4, 4}, hi[2] = {-4, -4};
        for (const Vec3f corner : corners) {
          const auto p = Place(*frame, {}, corner, /*segment=*/false);
          if (!p) return std::nullopt;
          for (const auto& [axis, s] : {std::pair(0, p->x), std::pair(1, p->y)}) {
            lo[axis] = std::min(lo[axis], s);
            hi[axis] = std::max(hi[axis], s);
          }
        }
        const Vec3f d = PixelDirection(
            *camera, x0 + static_cast<uint32_t>(input[10] * static_cast<float>(side)),
            y0 + static_cast<uint32_t>(input[11] * static_cast<float>(side)));
        const Quad depth = DotQ(ToQuad(frame->w), ToQuad(d));
        double most = -1;
        for (const int axis : {0, 1}) {
          const Quad s = DotQ(ToQuad(axis == 0 ? frame->u : frame->v), ToQuad(d)) / depth;
          EXPECT_GE(s, Quad(lo[axis] - kOutlineMargin)) << Hex(input);
          EXPECT_LE(s, Quad(hi[axis] + kOutlineMargin)) << Hex(input);
          const Quad beyond = std::max(Quad(lo[axis]) - s, s - Quad(hi[axis]));
          most = std::max(most, static_cast<double>(beyond / kOutlineMargin));
        }
        return most;
      });
  Report("kOutlineMargin", hunt_, kLoose);
}

TEST_F(MarginsTest, WidenedCornerSlopesHoldTheirCorners) {
  hunt_.Run(
      ScaledCount(kClimbs),
      [&] {
        HuntInput input;
        const Vec3f axis = Random(1), origin = Random(Scale(-20, 39));
        for (const Vec3f v : {axis, Random(1), origin}) Append(v, &input);
        // Corners may lie farther out than rays: as far as kMinCornerShare of the 1-norm.
        Append(origin + (NearTheLimit(axis) + Random(1)) * static_cast<float>(Scale(-30, 35)),
               &input);
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        const auto frame = FrameOf(At(input, 0), At(input, 1));
        if (!frame) return std::nullopt;
        const Vec3f p = At(input, 3) - At(input, 2);
        const float z = DotF(frame->w, p);
        if (!(z >= std::max(Norm1(p) * kMinCornerShare, kLeastDepth))) return std::nullopt;
        const float inverse = 1.0f / z;
        const Vec3q exact = ToQuad(At(input, 3)) - ToQuad(At(input, 2));
        const Quad depth = DotQ(ToQuad(frame->w), exact);
        const auto ratio = [&](Vec3f axis) {
          const float s = DotF(axis, p) * inverse;
          const Quad truth = DotQ(ToQuad(axis), exact) / depth;
          const float end = truth > s ? s + kCornerMargin : s - kCornerMargin;
          return Ratio(truth - s, AbsQ(Quad(end) - s));
        };
        return std::max(ratio(frame->u), ratio(frame->v));
      });
  Report("kCornerMargin", hunt_, kTight);
}

// Corners and the faces of boxes against a plane through the apex, and their depths.
TEST_F(MarginsTest, PlanesThroughTheApex) {
  Hunt corners(rng_), boxes(rng_), depths(rng_);
  const auto start = [&] {
    HuntInput input;
    const double far = Scale(-20, 39);
    const Vec3f apex = Random(far);
    for (const Vec3f v : {Random(1), Random(1), apex}) Append(v, &input);
    Append(rng_.Chance(0.5) ? apex + Random(Scale(-30, 35)) : Random(far), &input);
    input.push_back(static_cast<float>(rng_.Uniform(-2.3, 2.3)));
    return input;
  };
  struct Plane {
    Vec3f n, apex, p;
    Quad truth;
  };
  const auto plane = [](const HuntInput& input, bool depth) -> std::optional<Plane> {
    const auto frame = FrameOf(At(input, 0), At(input, 1));
    const float slope = input[12];
    if (!frame || std::abs(slope) > kMaxSlope) return std::nullopt;
    const Vec3f apex = At(input, 2), p = At(input, 3);
    const Vec3q n = depth ? ToQuad(frame->w) : ToQuad(frame->u) - ToQuad(frame->w) * Quad(slope);
    return Plane{depth ? frame->w : frame->u - frame->w * slope, apex, p,
                 DotQ(n, ToQuad(p) - ToQuad(apex))};
  };
  const auto corner_ratio = [&](const HuntInput& input, bool depth) -> std::optional<double> {
    const auto at = plane(input, depth);
    if (!at) return std::nullopt;
    const Vec3f local = at->p - at->apex;
    return Ratio(at->truth - DotF(at->n, local),
                 std::fma(Norm1(local), kBoxMargin, kFloatUnderflow));
  };
  corners.Run(ScaledCount(kClimbs), start,
              [&](const HuntInput& input) { return corner_ratio(input, false); });
  depths.Run(ScaledCount(kClimbs), start,
             [&](const HuntInput& input) { return corner_ratio(input, true); });
  boxes.Run(ScaledCount(kClimbs), start, [&](const HuntInput& input) -> std::optional<double> {
    const auto at = plane(input, false);
    if (!at) return std::nullopt;
    // As SetSide and MeetsSides have it: the faces' sum, begun at the apex's, rounded once.
    const Vec3d n = ToDouble(at->n), o = ToDouble(at->apex);
    const auto world = static_cast<float>(n.x * o.x + n.y * o.y + n.z * o.z);
    float value = std::fma(at->n.x, at->p.x, -world);
    value = std::fma(at->n.y, at->p.y, value);
    value = std::fma(at->n.z, at->p.z, value);
    const float farthest = Norm1(at->p) + Norm1(at->apex);
    return Ratio(at->truth - value, kBoxMargin * farthest + kFloatUnderflow);
  });
  Report("kBoxMargin, corners", corners, kTight);
  Report("kBoxMargin, boxes", boxes, kTight);
  Report("kBoxMargin, depths", depths, kTight);
}

// The depth at which a segment ends, and that of a distance along a ray.
TEST_F(MarginsTest, ScaledDepthsHoldEndsAndDistances) {
  const auto start = [&](bool segment) {
    const Vec3f axis = Random(1);
    const double scale = Scale(-30, 30);
    const Vec3f origin = Random(rng_.Chance(0.5) ? scale : Scale(0, 39));
    const Vec3f d = NearTheLimit(axis) * static_cast<float>(scale);
    HuntInput input;
    for (const Vec3f v : {axis, Random(1), origin, segment ? origin + d : d}) Append(v, &input);
    input.push_back(static_cast<float>(rng_.Uniform(0.01, 100)));
    return input;
  };
  constexpr float kShare = kDepthScale - 1;
  for (const bool segment : {false, true}) {
    hunt_.Run(
        ScaledCount(kClimbs), [&] { return start(segment); },
        [&](const HuntInput& input) -> std::optional<double> {
          const auto frame = FrameOf(At(input, 0), At(input, 1));
          const float inverse_t = input[12];
          if (!frame || !(inverse_t > 0x1p-60f) || !(inverse_t < 0x1p60f)) return std::nullopt;
          const auto p = Place(*frame, At(input, 2), At(input, 3), segment);
          if (!p) return std::nullopt;
          // What the two ends of the walk make of it: bounds on both sides of an end, and beyond a
          // hit whose distance is 1 / inverse_t.
          const Quad end = Ratio(p->true_z - p->z, p->true_z * kShare);
          EXPECT_LE(p->true_z, Quad(p->z * kDepthScale)) << Hex(input);
          EXPECT_GE(p->true_z, Quad(p->z * (2.0f - kDepthScale))) << Hex(input);
          const float q = inverse_t * p->inverse, far = kDepthScale / q;
          const Quad depth = p->true_z / inverse_t;
          EXPECT_LE(depth, Quad(far)) << Hex(input);
          const double hit = Ratio(depth - Quad(1) / q, depth * kShare);
          return std::max(static_cast<double>(end), hit);
        });
  }
  Report("kDepthScale", hunt_, kTight);
}

// The point of a frame with these slopes and depth 1: not a float, since forms are linear in it.
std::optional<Vec3q> Dual(const ShaftFrame& frame, Quad x, Quad y) {
  const Vec3q u = ToQuad(frame.u), v = ToQuad(frame.v), w = ToQuad(frame.w);
  const Quad det = DotQ(u, CrossQ(v, w));
  const Vec3q d =
      (CrossQ(v, w) * x + CrossQ(w, u) * y + CrossQ(u, v)) * (det == 0 ? Quad(0) : 1 / det);
  // Rays whose depth is less than 0.4 of their length are in no shaft.
  if (det == 0 || DotQ(d, d) * Quad(kMinDepthShare * kMinDepthShare) > 1) return std::nullopt;
  return d;
}

// By how much the form c (exact: `exact`) at a corner of a rectangle lies beyond the range that the
// walk bounds it by without a margin (Range of shaft-inl.h).
std::optional<Quad> BeyondRange(const ShaftFrame& frame, Vec3f c, Vec3q exact, float x, float y,
                                float ex, float ey) {
  const float f0 = DotF(frame.u, c), f1 = DotF(frame.v, c), f2 = DotF(frame.w, c);
  const float middle = std::fma(f0, x, std::fma(f1, y, f2));
  const float radius = std::fma(std::abs(f0), ex, std::fma(std::abs(f1), ey, 0.0f));
  Quad most = 0;
  for (const int sx : {-1, 1}) {
    for (const int sy : {-1, 1}) {
      const auto d = Dual(frame, Quad(x) + Quad(ex) * sx, Quad(y) + Quad(ey) * sy);
      if (!d) return std::nullopt;
      const Quad truth = DotQ(exact, *d);
      const Quad over = truth - (middle + radius), under = (middle - radius) - truth;
      most = std::max(most, std::max(over, under));
    }
  }
  return most;
}

TEST_F(MarginsTest, FormsOverABlockOfRays) {
  Hunt edges(rng_), planes(rng_), tiny(rng_);
  const auto start = [&](double scale) {
    HuntInput input;
    const Vec3f origin = Random(scale), a = Random(scale);
    const double size = rng_.Chance(0.5) ? scale : scale * Scale(-16, 0);
    for (const Vec3f v : {Random(1), Random(1), origin, a, a + Random(size), a + Random(size)}) {
      Append(v, &input);
    }
    const bool point = rng_.Chance(0.5);
    for (int k = 0; k < 2; ++k) input.push_back(static_cast<float>(rng_.Uniform(-1.5, 1.5)));
    for (int k = 0; k < 2; ++k) {
      input.push_back(point ? 0.0f : static_cast<float>(rng_.Uniform(0, 0.5)));
    }
    return input;
  };
  const auto ratio = [](const HuntInput& input, bool plane) -> std::optional<double> {
    const auto frame = FrameOf(At(input, 0), At(input, 1));
    if (!frame) return std::nullopt;
    const Vec3f o = At(input, 2), a = At(input, 3), b = At(input, 4), c = At(input, 5);
    const float ex = std::abs(input[20]), ey = std::abs(input[21]);
    if (std::abs(input[18]) + ex > kMaxSlope || std::abs(input[19]) + ey > kMaxSlope) {
      return std::nullopt;
    }
    const Vec3f first = plane ? b - a : a - o, second = plane ? c - b : b - a;
    const Vec3q exact = plane ? CrossQ(ToQuad(b) - ToQuad(a), ToQuad(c) - ToQuad(b))
                              : CrossQ(ToQuad(a) - ToQuad(o), ToQuad(b) - ToQuad(a));
    const auto beyond =
        BeyondRange(*frame, CrossF(first, second), exact, input[18], input[19], ex, ey);
    if (!beyond) return std::nullopt;
    return Ratio(*beyond, std::fma(kEdgeMargin, Norm1(first) * Norm1(second), kEdgeUnderflow));
  };
  edges.Run(
      ScaledCount(kClimbs), [&] { return start(Scale(-20, 39)); },
      [&](const HuntInput& input) { return ratio(input, false); });
  planes.Run(
      ScaledCount(kClimbs), [&] { return start(Scale(-20, 39)); },
      [&](const HuntInput& input) { return ratio(input, true); });
  // Products that underflow leave kEdgeUnderflow alone, which is far from tight: 2^-80 against some
  // 2^-146.
  tiny.Run(
      ScaledCount(kClimbs),
      [&] { return start(std::ldexp(1.0, -148 + static_cast<int>(rng_.Below(80)))); },
      [&](const HuntInput& input) { return ratio(input, false); });
  Report("kEdgeMargin, edges", edges, kTight);
  Report("kEdgeMargin, planes", planes, kTight);
  EXPECT_LE(tiny.worst(), 1) << tiny;
}

// As CrossBound of predicate-inl.h.
Vec3f CrossBoundF(Vec3f x, Vec3f y) {
  const auto of = [&](int i, int j) {
    const float permanent =
        std::fma(std::abs(x[i]), std::abs(y[j]), std::abs(x[j]) * std::abs(y[i]));
    return std::fma(kFloatUnits, permanent, kFloatUnderflow);
  };
  return {of(1, 2), of(2, 0), of(0, 1)};
}

// Bounds of the inverse of a hit's distance, without what the float stage's own bounds add.
TEST_F(MarginsTest, InverseDistancesHoldTheHit) {
  hunt_.Run(
      ScaledCount(4 * kClimbs),
      [&] {
        const double scale = Scale(-20, 30);
        HuntInput input;
        // A triangle that the ray crosses, sometimes a thin one; the point between its corners.
        const Vec3f o = Random(scale);
        Vec3f corner[3];
        const double size = scale * Scale(-8, 0);
        const Vec3f middle = Random(scale);
        const Vec3f along = Random(size);
        for (Vec3f& c : corner) {
          c = middle + along * static_cast<float>(rng_.Uniform(-1, 1)) +
              Random(rng_.Chance(0.5) ? size : size * 0x1p-6);
        }
        const Vec3f aim = (corner[0] + corner[1] + corner[2]) * (1 / 3.0f);
        for (const Vec3f v : {o, corner[0], corner[1], corner[2], aim - o}) Append(v, &input);
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        const Vec3f o = At(input, 0), a = At(input, 1), b = At(input, 2), c = At(input, 3);
        const Vec3f d = At(input, 4);
        const PredicateRay ray = PredicateRay::Ray(o, d);
        const Vec3f ab = b - a, bc = c - b, oa = a - o;
        Vec3f n = CrossF(ab, bc);
        const Vec3f normal_bound = CrossBoundF(ab, bc);
        float depth = DotF(n, oa), rate = DotF(n, d);
        if (depth < 0) n = -n, depth = -depth, rate = -rate;
        const float depth_bound =
            std::fma(normal_bound.x, std::abs(oa.x),
                     std::fma(normal_bound.y, std::abs(oa.y),
                              std::fma(normal_bound.z, std::abs(oa.z), kFloatUnderflow)));
        const float rate_bound =
            std::fma(normal_bound.x + normal_bound.y + normal_bound.z, MaxAbs(d), kFloatUnderflow);
        // What the walk asks of a bound that it trusts (kTrustedDepth of shaft_leaf-inl.h, and
        // KeepCloser's `sound`).
        if (!(rate > 2 * rate_bound) || !(depth_bound <= 0x1p-8f * depth)) return std::nullopt;
        if (!Blocks(ray, a, b, c)) return std::nullopt;
        const float t = HitDistance(ray, a, b, c);
        if (!(t > 0x1p-60f) || !(t < 0x1p60f)) return std::nullopt;
        // The bounds as they are must hold.
        const float inverse = 1.0f / depth, share = depth_bound * inverse;
        const float off = std::fma(share, 2.0f, kInverseMargin);
        const float lo = (rate - rate_bound) * std::fma(-inverse, off, inverse);
        const float hi = (rate + rate_bound) * std::fma(inverse, off, inverse);
        EXPECT_LE(Quad(lo) * t, 1) << Hex(input);
        EXPECT_GE(Quad(hi) * t, 1) << Hex(input);
        // And kInverseMargin alone must, with N·D and N·(A-O) rounded once from their true values.
        const Vec3q normal = CrossQ(ToQuad(b) - ToQuad(a), ToQuad(c) - ToQuad(b));
        const auto true_rate = static_cast<float>(AbsQ(DotQ(normal, ToQuad(d))));
        const auto true_depth = static_cast<float>(AbsQ(DotQ(normal, ToQuad(a) - ToQuad(o))));
        if (!(true_depth > 0x1p-100f) || !(true_rate > 0x1p-100f)) return std::nullopt;
        const Quad computed = Quad(true_rate * (1.0f / true_depth));
        return Ratio(computed * t - 1, kInverseMargin);
      });
  Report("kInverseMargin", hunt_, kTight);
}

}  // namespace
}  // namespace sightline::testing_support
