// SPDX-License-Identifier: Apache-2.0
//
// A shaft's wedges, for every target of this machine: a hunt for the point of a shaft that comes
// nearest to being left out (core/shaft/margins.h), and boxes that a shaft's own
// sides do not tell from it.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/shaft/wedge_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/geometry/box3.h"
#include "core/intersect/predicate-inl.h"
#include "core/shaft/frame.h"
#include "core/shaft/wedge-inl.h"
#include "hwy/highway.h"

#ifndef SIGHTLINE_TESTS_WEDGE_TYPES_
#define SIGHTLINE_TESTS_WEDGE_TYPES_
#include <algorithm>
#include <cmath>

namespace sightline {

// A shaft of rays from `from`, or along `direction`.
struct WedgeCase {
  ShaftFrame frame;
  bool parallel;
  Vec3f direction, from;
  float left, right, below, above;
};

}  // namespace sightline
#endif

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// How far the box reaches to the inner side of all lines, these without a margin, in units of each
// line's |n|_1.
double ReachWithinWedges(const WedgeCase& c, const Box3f& box) {
  const FrameRectangle rectangle = {c.left, c.right, c.below, c.above};
  ShaftWedges wedges;
  if (c.parallel) {
    MakeParallelWedges(c.frame, c.direction, c.from, rectangle, 0, &wedges);
  } else {
    MakeApexWedges(c.frame, c.from, rectangle, 0, &wedges);
  }
  const hn::CappedTag<float, 8> d;
  HWY_ALIGN float faces[6][hn::MaxLanes(d)];
  for (int k = 0; k < 3; ++k) {
    hn::Store(hn::Set(d, box.lo[k]), d, faces[k]);
    hn::Store(hn::Set(d, box.hi[k]), d, faces[k + 3]);
  }
  double least = INFINITY;
  for (const int line : ShaftWedges::kLines) {
    ShaftWedges alone;
    for (const int same : ShaftWedges::kLines) {
      for (int i = 0; i < 2; ++i) {
        alone.n[i][same] = wedges.n[i][line];
        alone.face[i][same] = wedges.face[i][line];
      }
      alone.world[same] = wedges.world[line];
    }
    const float size = std::abs(wedges.n[0][line]) + std::abs(wedges.n[1][line]);
    if (size > 0)
      least = std::min(least, hn::GetLane(WithinWedges(d, alone, faces)) / double{size});
  }
  return least;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <optional>
#include <string>
#include <vector>

#include "core/shaft/margins.h"
#include "gtest/gtest.h"
#include "tests/core/shaft/margin_fixture.h"
#include "tests/core/shaft/margin_hunt.h"

namespace sightline::testing_support {
namespace {

using HWY_NAMESPACE::kFloatUnderflow;

struct Target {
  std::string name;
  double (*reach)(const WedgeCase&, const Box3f&);
};

std::vector<Target> Targets() {
  std::vector<Target> targets = {{"AVX2", &N_AVX2::ReachWithinWedges}};
  if ((hwy::SupportedTargets() & HWY_AVX3) != 0) {
    targets.push_back({"AVX-512", &N_AVX3::ReachWithinWedges});
  }
  return targets;
}

class WedgeTest : public MarginsTest {};

// The nearest floats on either side.
float Below(Quad x) {
  const auto near = static_cast<float>(x);
  return Quad(near) <= x ? near : std::nextafter(near, -INFINITY);
}
float Above(Quad x) {
  const auto near = static_cast<float>(x);
  return Quad(near) >= x ? near : std::nextafter(near, INFINITY);
}

// A rectangle that holds x and y in one of its corners, or within.
void HoldTightly(Quad x, Quad y, float wide, float high, WedgeCase* c) {
  c->left = Below(wide < 0 ? x + wide : x);
  c->right = Above(wide > 0 ? x + wide : x);
  c->below = Below(high < 0 ? y + high : y);
  c->above = Above(high > 0 ? y + high : y);
}

// The shaft of a hunt's input, tightly around the ray through its point. The slopes are exact: what
// the walk's own err by is kSlopeMargin's.
std::optional<WedgeCase> ApexCase(const HuntInput& input) {
  const auto frame = FrameOf(At(input, 0), At(input, 1));
  if (!frame) return std::nullopt;
  WedgeCase c = {.frame = *frame, .parallel = false, .direction = {}, .from = At(input, 2)};
  const Vec3q own = ToQuad(At(input, 3)) - ToQuad(c.from);
  const Quad z = DotQ(ToQuad(frame->w), own);
  if (!(z >= Quad(kLeastDepth)) || z * z < Quad(kMinDepthShare * kMinDepthShare) * DotQ(own, own)) {
    return std::nullopt;
  }
  HoldTightly(DotQ(ToQuad(frame->u), own) / z, DotQ(ToQuad(frame->v), own) / z, input[12],
              input[13], &c);
  const float widest = std::max({-c.left, c.right, -c.below, c.above});
  if (widest > kMaxSlope) return std::nullopt;
  return c;
}

TEST_F(WedgeTest, HoldWhatRaysFromAnApexPass) {
  for (const Target& target : Targets()) {
    Hunt hunt(rng_);
    hunt.Run(
        ScaledCount(4 * kClimbs),
        [&] {
          HuntInput input;
          const double far = Scale(-20, 39);
          const Vec3f axis = Random(1), apex = Random(rng_.Chance(0.5) ? far : Scale(0, 39));
          for (const Vec3f v : {axis, Random(1), apex}) Append(v, &input);
          Append(apex + NearTheLimit(axis) * static_cast<float>(far), &input);
          for (int k = 0; k < 2; ++k) {
            input.push_back(static_cast<float>(rng_.Uniform(-1, 1) * Scale(-24, 0)));
          }
          return input;
        },
        [&](const HuntInput& input) -> std::optional<double> {
          const auto c = ApexCase(input);
          if (!c) return std::nullopt;
          const Vec3f p = At(input, 3);
          const float margin = std::fma(kBoxMargin, Norm1(p) + Norm1(c->from), kFloatUnderflow);
          return -target.reach(*c, {p, p}) / margin;
        });
    Report("kBoxMargin, wedges, " + target.name, hunt, kLoose);
  }
}

TEST_F(WedgeTest, HoldWhatParallelRaysPass) {
  // The rays' origin, P, is seen through their offsets; the point is anywhere along its ray: P
  // itself, moved along D and rounded, which is up to a rounding of the point's own.
  for (const Target& target : Targets()) {
    Hunt hunt(rng_);
    hunt.Run(
        ScaledCount(4 * kClimbs),
        [&] {
          HuntInput input;
          const double far = Scale(-20, 39);
          const Vec3f reference = Random(rng_.Chance(0.5) ? far : Scale(0, 39));
          for (const Vec3f v : {Random(Scale(-19, 19)), Random(1), reference}) Append(v, &input);
          Append(reference + Random(far), &input);
          for (int k = 0; k < 2; ++k) {
            input.push_back(static_cast<float>(rng_.Uniform(-1, 1) * far * Scale(-24, 0)));
          }
          input.push_back(static_cast<float>(rng_.Uniform(0, 1) * far));
          return input;
        },
        [&](const HuntInput& input) -> std::optional<double> {
          const Vec3f direction = At(input, 0);
          const float size = MaxAbs(direction);
          if (!(size >= 0x1p-20f) || !(size <= 0x1p20f)) return std::nullopt;
          const auto frame = FrameOf(direction, At(input, 1));
          if (!frame) return std::nullopt;
          WedgeCase c = {
              .frame = *frame, .parallel = true, .direction = direction, .from = At(input, 2)};
          const Vec3f origin = At(input, 3);
          const Vec3q own = ToQuad(origin) - ToQuad(c.from);
          HoldTightly(DotQ(ToQuad(frame->u), own), DotQ(ToQuad(frame->v), own), input[12],
                      input[13], &c);
          const Vec3f p = origin + direction * (std::abs(input[14]) / size);
          if (!(MaxAbs(p) < 0x1p40f)) return std::nullopt;
          const float margin = std::fma(
              kBoxMargin, Norm1(p) + Norm1(c.from) + Norm1(origin - c.from), kFloatUnderflow);
          return -target.reach(c, {p, p}) / margin;
        });
    Report("kBoxMargin, strips, " + target.name, hunt, kLoose);
  }
}

// A thin shaft from the origin along the diagonal, and a large box that it passes: corners of the
// box lie within each of the shaft's sides, whichever way those are turned.
TEST_F(WedgeTest, TellBoxesThatAreWiderThanTheShaft) {
  const auto frame = FrameOf({1, 1, 1}, {1, -1, 0});
  ASSERT_TRUE(frame);
  for (const bool parallel : {false, true}) {
    const float half = 0x1p-10f;
    const WedgeCase c = {.frame = *frame,
                         .parallel = parallel,
                         .direction = {1, 1, 1},
                         .from = {0, 0, 0},
                         .left = -half,
                         .right = half,
                         .below = -half,
                         .above = half};
    for (const Target& target : Targets()) {
      SCOPED_TRACE(testing::Message() << target.name << ", parallel " << parallel);
      // x in [4, 8], y in [1, 3]: wherever the diagonal has such an x it has no such y.
      EXPECT_LT(target.reach(c, {{4, 1, 1}, {8, 3, 8}}), 0);
      EXPECT_LT(target.reach(c, {{1, 4, 1}, {8, 8, 3}}), 0);
      EXPECT_LT(target.reach(c, {{1, 1, 4}, {3, 8, 8}}), 0);
      EXPECT_GT(target.reach(c, {{4, 3, 1}, {8, 5, 8}}), 0);
    }
  }
}

// Seen along its own rays a shaft has no wedge: there all pass, and so they do where the wedge
// would be wider than a half plane.
TEST_F(WedgeTest, LetAllPassWhereTheShaftSpreadsTooFar) {
  const auto frame = FrameOf({0, 0, 1}, {1, 0, 0});
  ASSERT_TRUE(frame);
  for (const bool parallel : {false, true}) {
    const WedgeCase c = {.frame = *frame,
                         .parallel = parallel,
                         .direction = {0, 0, 1},
                         .from = {0, 0, 0},
                         .left = -1,
                         .right = 1,
                         .below = -1,
                         .above = 1};
    for (const Target& target : Targets()) {
      EXPECT_GT(target.reach(c, {{-0.5f, -0.5f, 0.9f}, {0.5f, 0.5f, 1}}), 0);
      EXPECT_LT(target.reach(c, {{3, -0.5f, 0.9f}, {4, 0.5f, 1}}), 0);
    }
  }
}

}  // namespace
}  // namespace sightline::testing_support
#endif  // HWY_ONCE
