// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/deterministic_math.h"

#include <cmath>
#include <cstdint>

#include "core/base/mix_bits.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/prng.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(SinCosTurns, IsExactAtQuarterTurns) {
  for (int turn = -3; turn <= 3; ++turn) {
    EXPECT_EQ(SinCosTurns(turn).sin, 0);
    EXPECT_EQ(SinCosTurns(turn).cos, 1);
    EXPECT_EQ(SinCosTurns(turn + 0.25).sin, 1);
    EXPECT_EQ(SinCosTurns(turn + 0.25).cos, 0);
    EXPECT_EQ(SinCosTurns(turn + 0.5).sin, 0);
    EXPECT_EQ(SinCosTurns(turn + 0.5).cos, -1);
    EXPECT_EQ(SinCosTurns(turn + 0.75).sin, -1);
    EXPECT_EQ(SinCosTurns(turn + 0.75).cos, 0);
  }
}

TEST(SinCosTurns, AgreesWithLibm) {
  // A few roundings on each side, of values up to 1.
  constexpr double kTolerance = 4 * 0x1p-53;
  constexpr uint64_t kSeed = 11;
  SCOPED_TRACE(kSeed);
  Prng rng(kSeed, "turns");
  for (int i = 0; i < 100'000; ++i) {
    const double turns = rng.Uniform(-0.5, 0.5);
    const double angle = turns * 6.283185307179586476925;
    // The angle itself is rounded before libm sees it.
    const double slack = kTolerance + std::abs(angle) * 0x1p-52;
    const SinCos sc = SinCosTurns(turns);
    ASSERT_NEAR(sc.sin, std::sin(angle), slack) << turns;
    ASSERT_NEAR(sc.cos, std::cos(angle), slack) << turns;
    // Whole turns change nothing where adding them is exact.
    const double coarse = std::floor(turns * 1024) / 1024;
    ASSERT_EQ(SinCosTurns(coarse).sin, SinCosTurns(coarse + 37).sin);
  }
}

TEST(DirectionDegrees, IsAUnitVectorOfThatElevation) {
  for (double elevation : {8.0, 30.0, 60.0}) {
    const Vec3d d = DirectionDegrees(123, elevation);
    EXPECT_NEAR(Length(d), 1, 0x1p-51);
    EXPECT_NEAR(std::asin(d.z) * 57.29577951308232, elevation, 0x1p-40);
  }
}

TEST(Prng, KnowsItsStreams) {
  // Fixed for good: the scenes hang on them.
  Prng a(1, "chair", 0);
  EXPECT_EQ(a.Next(), Prng(1, "chair", 0).Next());
  EXPECT_NE(Prng(1, "chair", 0).Next(), Prng(1, "chair", 1).Next());
  EXPECT_NE(Prng(1, "chair", 0).Next(), Prng(2, "chair", 0).Next());
  EXPECT_NE(Prng(1, "chair", 0).Next(), Prng(1, "table", 0).Next());
  // splitmix64's own first output for state 0.
  EXPECT_EQ(MixBits(kGoldenStep), 0xE220A8397B1DCDAFu);
}

TEST(Prng, IsUniform) {
  Prng rng(5, "uniform");
  int bins[10] = {};
  for (int i = 0; i < 100'000; ++i) {
    const double x = rng.Uniform();
    ASSERT_GE(x, 0);
    ASSERT_LT(x, 1);
    ++bins[static_cast<int>(x * 10)];
    const int k = rng.Below(7);
    ASSERT_GE(k, 0);
    ASSERT_LT(k, 7);
  }
  for (int count : bins) EXPECT_NEAR(count, 10'000, 500);  // Five standard deviations.
}

TEST(Noise, IsContinuousAndVaried) {
  Prng rng(6, "noise");
  double low = 0, high = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Vec3d p{rng.Uniform(-50, 50), rng.Uniform(-50, 50), rng.Uniform(-50, 50)};
    const double a = GradientNoise(p, 3);
    low = std::min(low, a);
    high = std::max(high, a);
    // Slopes stay below 16, so a step of 2^-20 changes little.
    ASSERT_LT(std::abs(a - GradientNoise({p.x + 0x1p-20, p.y, p.z}, 3)), 0x1p-16);
    ASSERT_LT(std::abs(GradientNoise2(p.x, p.y, 3) - GradientNoise2(p.x, p.y + 0x1p-20, 3)),
              0x1p-16);
  }
  EXPECT_LT(low, -0.6);
  EXPECT_GT(high, 0.6);
  EXPECT_GT(low, -2);
  EXPECT_LT(high, 2);
}

}  // namespace
}  // namespace sightline
