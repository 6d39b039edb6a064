// SPDX-License-Identifier: Apache-2.0
//
// What a LightHull says of its samples holds, for any samples, and is tight for a rectangle's.
#include "core/traverse/light_hull.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

// That each sample lies where the hull says.
void ExpectHolds(const LightHull& light, const std::vector<Vec3f>& samples) {
  ASSERT_EQ(light.count, samples.size());
  for (uint32_t k = 0; k < light.count; ++k) {
    EXPECT_EQ(light.samples[k], samples[k]);
    long double left[3];
    for (int axis = 0; axis < 3; ++axis) {
      left[axis] = static_cast<long double>(samples[k][axis]) - light.centre[axis];
      for (int h = 0; h < 2; ++h) {
        EXPECT_LE(std::abs(light.along[h][k]), 1.0f);
        left[axis] -= static_cast<long double>(light.half[h][axis]) * light.along[h][k];
      }
      EXPECT_LE(std::abs(left[axis]), static_cast<long double>(light.rest));
    }
  }
  for (size_t k = light.count; k < LightHull::kMostSamples; ++k) {
    EXPECT_EQ(light.along[0][k], 0.0f);
    EXPECT_EQ(light.along[1][k], 0.0f);
  }
  for (size_t k = 0; k < LightHull::kMostSamples; ++k) {
    const Vec3f at = {light.rows[0][k], light.rows[1][k], light.rows[2][k]};
    EXPECT_EQ(at, samples[k < samples.size() ? k : 0]);
  }
}

TEST(LightHullTest, HoldsItsSamples) {
  TestRng rng;
  for (int64_t i = 0, n = ScaledCount(2000, 200); i < n; ++i) {
    const double far = std::exp2(rng.Uniform(-40, 40)), size = far * std::exp2(rng.Uniform(-30, 1));
    const auto anywhere = [&](double scale) {
      return Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)} * scale;
    };
    const Vec3d middle = anywhere(far);
    std::vector<Vec3f> samples(1 + rng.Below(LightHull::kMostSamples));
    for (Vec3f& sample : samples) sample = ToFloat(middle + anywhere(size));
    ExpectHolds(FitLightHull(samples), samples);
  }
}

TEST(LightHullTest, IsFlatAndNoLargerForARectangle) {
  TestRng rng;
  for (int64_t i = 0, n = ScaledCount(500, 50); i < n; ++i) {
    const Vec3d middle = {rng.Uniform(-9, 9), rng.Uniform(-9, 9), rng.Uniform(-9, 9)};
    const double angle = rng.Uniform(0, 6.3), tilt = rng.Uniform(-1, 1);
    const Vec3d u = Vec3d{std::cos(angle), tilt, std::sin(angle)} * rng.Uniform(0.1, 1);
    const Vec3d v = Vec3d{-std::sin(angle), 0, std::cos(angle)} * rng.Uniform(0.1, 1);
    std::vector<Vec3f> samples;
    for (int k = 0; k < 16; ++k) {
      samples.push_back(ToFloat(middle + u * ((k % 4) / 1.5 - 1.0) + v * ((k / 4) / 1.5 - 1.0)));
    }
    const LightHull light = FitLightHull(samples);
    ExpectHolds(light, samples);
    EXPECT_TRUE(light.flat());
    const double area = Length(Cross(ToDouble(light.half[0]), ToDouble(light.half[1])));
    EXPECT_LE(area, Length(Cross(u, v)) * (1 + 1e-5));
  }
}

TEST(LightHullTest, LinesAndPointsAreFlat) {
  for (const double step : {0.0, 0.25}) {
    std::vector<Vec3f> samples;
    for (int k = 0; k < 7; ++k) samples.push_back(ToFloat(Vec3d{1 + step * k, 2 - step * k, 3}));
    const LightHull light = FitLightHull(samples);
    ExpectHolds(light, samples);
    EXPECT_TRUE(light.flat());
    const double lengths[2] = {Length(ToDouble(light.half[0])), Length(ToDouble(light.half[1]))};
    EXPECT_LE(std::min(lengths[0], lengths[1]), 1e-6);
    EXPECT_NEAR(std::max(lengths[0], lengths[1]), step * 3 * std::sqrt(2.0), 1e-6);
  }
}

TEST(LightHullTest, WhatFillsSpaceIsNot) {
  const LightHull light =
      FitLightHull(std::vector<Vec3f>{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}});
  EXPECT_FALSE(light.flat());
}

}  // namespace
}  // namespace sightline::testing_support
