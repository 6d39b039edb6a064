// SPDX-License-Identifier: Apache-2.0
//
// Every margin of core/shaft/margins.h against the error that it is there for: the float quantity
// as the shaft walk computes it (core/traverse/shaft_rays-inl.h, shaft_leaf-inl.h, shaft-inl.h),
// its exact value in 113-bit arithmetic (whose own error is 2^-80 of the margins), and a hill climb
// that hunts for the input at which they differ most.
//
// Each constant has a hunt that must come within a sixteenth of it, so one made sixteen times
// smaller fails. How near each came is printed; over ten seeds, error over margin was
//
//   kSlopeMargin    0.19-0.22      kBoxMargin, planes and corners    0.28-0.33
//   kCornerMargin   0.12-0.17                  planes and boxes      0.26-0.34
//   kDepthScale     0.16-0.19                  depths                0.10-0.12
//   kInverseMargin  0.22-0.25                  parallel offsets      0.05-0.06
//   kCapMargin      0.72-0.76      kEdgeMargin, edges and planes     0.07-0.12
//   kParallelUnits  0.35-0.46                   parallel, of a block 0.04-0.05
//
// What is far from its margin is so because derivations add up what cannot all be largest at once.
#include "core/shaft/margins.h"

#include <cmath>
#include <iostream>
#include <optional>
#include <string>

#include "core/intersect/hit.h"
#include "core/intersect/predicate-inl.h"
#include "core/shaft/frame.h"
#include "gtest/gtest.h"
#include "tests/core/shaft/margin_hunt.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using HWY_NAMESPACE::kFloatUnderflow;
using HWY_NAMESPACE::kFloatUnits;
using testing_support::Hex;
using testing_support::Hunt;
using testing_support::HuntInput;
using testing_support::ScaledCount;
using testing_support::TestRng;

using Quad = __float128;

constexpr int64_t kClimbs = 600;
// The error that a hunt must find, as a share of the margin: every constant has one that finds more
// than a sixteenth. Where the same constant also covers what errs less, half of that.
constexpr double kTight = 1.0 / 16, kLoose = 1.0 / 32;

struct Vec3q {
  Quad x, y, z;
};
Vec3q ToQuad(Vec3f v) { return {v.x, v.y, v.z}; }
Vec3q operator-(Vec3q a, Vec3q b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vec3q operator+(Vec3q a, Vec3q b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vec3q operator*(Vec3q a, Quad s) { return {a.x * s, a.y * s, a.z * s}; }
Quad DotQ(Vec3q a, Vec3q b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Vec3q CrossQ(Vec3q a, Vec3q b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Quad AbsQ(Quad x) { return x < 0 ? -x : x; }

// One lane of DotV, CrossV and Norm1V (predicate-inl.h), operation by operation.
float DotF(Vec3f a, Vec3f b) { return std::fma(a.x, b.x, std::fma(a.y, b.y, a.z * b.z)); }
Vec3f CrossF(Vec3f a, Vec3f b) {
  return {std::fma(a.y, b.z, -(a.z * b.y)), std::fma(a.z, b.x, -(a.x * b.z)),
          std::fma(a.x, b.y, -(a.y * b.x))};
}
float Norm1(Vec3f a) { return std::abs(a.x) + std::abs(a.y) + std::abs(a.z); }
Vec3f Abs(Vec3f a) { return {std::abs(a.x), std::abs(a.y), std::abs(a.z)}; }

double Ratio(Quad error, Quad margin) { return static_cast<double>(AbsQ(error) / margin); }

// The k-th vector of an input.
Vec3f At(const HuntInput& input, size_t k) {
  return {input[3 * k], input[3 * k + 1], input[3 * k + 2]};
}
void Append(Vec3f v, HuntInput* input) { input->insert(input->end(), {v.x, v.y, v.z}); }

std::optional<ShaftFrame> FrameOf(Vec3f axis, Vec3f sideways) {
  ShaftFrame frame;
  if (!MakeShaftFrame(ToDouble(axis), ToDouble(sideways), &frame)) return std::nullopt;
  return frame;
}

class MarginsTest : public testing::Test {
 protected:
  // The margin held, and the hunt came near enough to tell.
  static void Report(const std::string& what, const Hunt& hunt, double least) {
    std::cout << what << ": " << hunt.worst() << "\n";
    EXPECT_LE(hunt.worst(), 1) << what << ": " << hunt;
    if (testing_support::kSanitizerBuild) return;  // Hunts less.
    EXPECT_GT(hunt.worst(), least) << what << ": the hunt is not hunting";
  }

  Vec3f Random(double scale) {
    return ToFloat(Vec3d{rng_.Uniform(-scale, scale), rng_.Uniform(-scale, scale),
                         rng_.Uniform(-scale, scale)});
  }
  // About one, or anywhere from `least` to `most` as powers of two.
  double Scale(int least, int most) {
    if (rng_.Chance(0.3)) return 1;
    return std::ldexp(
        1.0, least + static_cast<int>(rng_.Below(static_cast<uint64_t>(most - least + 1))));
  }
  // A direction that a frame along `axis` just holds, or anywhere within.
  Vec3f NearTheLimit(Vec3f axis) {
    const Vec3d w = ToDouble(axis) * (1 / Length(ToDouble(axis)));
    Vec3d side = ToDouble(Random(1));
    side = side - w * Dot(w, side);
    side = side * (1 / Length(side));
    const double depth = rng_.Chance(0.7) ? rng_.Uniform(0.4, 0.42) : rng_.Uniform(0.4, 1);
    return ToFloat(w * depth + side * std::sqrt(1 - depth * depth));
  }

  TestRng rng_;
  Hunt hunt_{rng_};
};

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
          return std::max(SlopeRatio(p->x, p->true_x), SlopeRatio(p->y, p->true_y));
        });
  }
  Report("kSlopeMargin", hunt_, kTight);
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
    // As SetSide and MeetsSides have it: the faces' own sum against the apex's, rounded once.
    const Vec3d n = ToDouble(at->n), o = ToDouble(at->apex);
    const auto world = static_cast<float>(n.x * o.x + n.y * o.y + n.z * o.z);
    float value = at->n.x * at->p.x;
    value = std::fma(at->n.y, at->p.y, value);
    value = std::fma(at->n.z, at->p.z, value);
    const float farthest = Norm1(at->p) + Norm1(at->apex);
    return Ratio(at->truth - (value - world), kBoxMargin * farthest + kFloatUnderflow);
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
        const float normal_bound = std::fma(kFloatUnits, Norm1(ab) * Norm1(bc), kFloatUnderflow);
        float depth = DotF(n, oa), rate = DotF(n, d);
        if (depth < 0) n = -n, depth = -depth, rate = -rate;
        const float depth_bound = std::fma(normal_bound, MaxAbs(oa), kFloatUnderflow);
        const float rate_bound = std::fma(normal_bound, MaxAbs(d), kFloatUnderflow);
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

// ---- Parallel rays

TEST_F(MarginsTest, FormsOfParallelRays) {
  Hunt edge_block(rng_), plane_block(rng_), edge_ray(rng_), plane_ray(rng_);
  const auto start = [&] {
    const double scale = Scale(-20, 30);
    HuntInput input;
    const Vec3f r = Random(rng_.Chance(0.5) ? scale : Scale(0, 39));
    const Vec3f a = r + Random(scale);
    const double size = rng_.Chance(0.5) ? scale : scale * Scale(-16, 0);
    const double spread = rng_.Chance(0.5) ? scale : scale * Scale(-8, 8);
    const Vec3f d = Random(Scale(-19, 19));
    // Origins anywhere, or far along the rays: there the basis' own rounding shows.
    const Vec3f away = rng_.Chance(0.5) ? Random(1) : d * (1 / MaxAbs(d));
    for (const Vec3f v : {d, Random(1), r, a, a + Random(size), a + Random(size),
                          r + away * static_cast<float>(spread)}) {
      Append(v, &input);
    }
    return input;
  };
  enum Form { kEdgeBlock, kPlaneBlock, kEdgeRay, kPlaneRay };
  const auto ratio = [](const HuntInput& input, Form form) -> std::optional<double> {
    const Vec3f direction = At(input, 0), r = At(input, 2), p = At(input, 6);
    const Vec3f a = At(input, 3), b = At(input, 4), c = At(input, 5);
    const float size = MaxAbs(direction);
    if (!(size >= 0x1p-20f) || !(size <= 0x1p20f)) return std::nullopt;
    const auto frame = FrameOf(direction, At(input, 1));
    if (!frame) return std::nullopt;
    const bool plane = form == kPlaneBlock || form == kPlaneRay;
    const Vec3f ab = b - a, bc = c - b, ra = a - r, own = p - r;
    // Both are (A-P)·m with m the normal, or the edge's product with D.
    const Vec3f m = plane ? CrossF(ab, bc) : CrossF(ab, direction);
    const Vec3q exact = plane ? CrossQ(ToQuad(b) - ToQuad(a), ToQuad(c) - ToQuad(b))
                              : CrossQ(ToQuad(b) - ToQuad(a), ToQuad(direction));
    const Quad truth = DotQ(exact, ToQuad(a) - ToQuad(p));
    const float k = Norm1(ab) * (plane ? Norm1(bc) : size) * (Norm1(ra) + Norm1(own));
    const float offset = DotF(m, ra);
    if (form == kEdgeRay || form == kPlaneRay) {
      return Ratio(truth - (offset - DotF(m, own)), std::fma(kParallelUnits, k, kFloatUnderflow));
    }
    const float x = DotF(frame->u, own), y = DotF(frame->v, own), z = DotF(frame->w, own);
    float value = std::fma(-DotF(frame->u, m), x, std::fma(-DotF(frame->v, m), y, offset));
    if (plane) value = std::fma(-DotF(frame->w, m), z, value);
    return Ratio(truth - value, std::fma(kEdgeMargin, k, kEdgeUnderflow));
  };
  const struct {
    const char* name;
    Hunt& hunt;
    Form form;
    double least;
  } hunts[] = {{"kEdgeMargin, parallel edges over a block", edge_block, kEdgeBlock, kLoose},
               {"kEdgeMargin, parallel planes over a block", plane_block, kPlaneBlock, kLoose},
               {"kParallelUnits, edges", edge_ray, kEdgeRay, kTight},
               {"kParallelUnits, planes", plane_ray, kPlaneRay, kTight}};
  for (const auto& [name, hunt, form, least] : hunts) {
    const Form which = form;
    hunt.Run(ScaledCount(kClimbs), start,
             [&ratio, which](const HuntInput& input) { return ratio(input, which); });
    Report(name, hunt, least);
  }
}

// A hit along a parallel ray keeps the offsets of its origin.
TEST_F(MarginsTest, OffsetsOfParallelRaysHoldTheirHits) {
  hunt_.Run(
      ScaledCount(kClimbs),
      [&] {
        const double scale = Scale(-20, 30);
        HuntInput input;
        const Vec3f r = Random(rng_.Chance(0.5) ? scale : Scale(0, 39));
        for (const Vec3f v :
             {Random(Scale(-19, 19)), Random(1), r, r + Random(rng_.Chance(0.5) ? scale : 1)}) {
          Append(v, &input);
        }
        input.push_back(static_cast<float>(scale * Scale(-8, 8)));
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        const Vec3f direction = At(input, 0), r = At(input, 2), p = At(input, 3);
        const float size = MaxAbs(direction);
        if (!(size >= 0x1p-20f) || !(size <= 0x1p20f)) return std::nullopt;
        const auto frame = FrameOf(direction, At(input, 1));
        if (!frame) return std::nullopt;
        const Vec3f own = p - r;
        const Vec3q hit =
            ToQuad(p) + ToQuad(direction) * (AbsQ(Quad(input[12])) / size) - ToQuad(r);
        const Quad reach = AbsQ(hit.x) + AbsQ(hit.y) + AbsQ(hit.z) + Norm1(own);
        const auto ratio = [&](Vec3f axis) {
          return Ratio(DotQ(ToQuad(axis), hit) - DotF(axis, own), kBoxMargin * reach);
        };
        return std::max(ratio(frame->u), ratio(frame->v));
      });
  Report("kBoxMargin, parallel offsets", hunt_, kLoose);
}

// ---- Receivers' cap

TEST_F(MarginsTest, CapsHoldTheirReceivers) {
  hunt_.Run(
      ScaledCount(kClimbs),
      [&] {
        HuntInput input;
        const Vec3f centre = Random(Scale(-20, 39));
        const Vec3f n = Random(1);
        Append(n * (1 / Length(n)), &input);
        Append(centre, &input);
        Append(rng_.Chance(0.5) ? centre + Random(Scale(-30, 30)) : Random(Scale(-20, 39)), &input);
        return input;
      },
      [&](const HuntInput& input) -> std::optional<double> {
        const Vec3f g = At(input, 0), c = At(input, 1), x = At(input, 2);
        if (MaxAbs(g) > 1.0f) return std::nullopt;
        const Vec3f p = x - c;
        const float value = DotF(g, p), sum = DotF(Abs(g), Abs(p));
        if (!(sum > 0x1p-60f)) return std::nullopt;
        const Quad truth = DotQ(ToQuad(g), ToQuad(x) - ToQuad(c));
        // As MakeCap (above) and WithinCap (below) widen it.
        EXPECT_LE(truth, Quad(std::fma(sum, kCapMargin, value))) << Hex(input);
        EXPECT_GE(truth, Quad(std::fma(-sum, kCapMargin, value))) << Hex(input);
        return Ratio(truth - value, Quad(kCapMargin) * sum);
      });
  Report("kCapMargin", hunt_, kTight);
}

}  // namespace
}  // namespace sightline
