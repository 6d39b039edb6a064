// SPDX-License-Identifier: Apache-2.0
#include "core/light/light.h"

#include <pmmintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

std::vector<LightSample> Samples(const Light& light, Vec3d origin = {}) {
  std::vector<LightSample> samples;
  EXPECT_TRUE(AppendSamples(light, 0, origin, &samples).ok());
  return samples;
}

Light Square(uint32_t count) {
  return {.kind = Light::Kind::kRectangle,
          .half_u = {1, 0, 0},
          .half_v = {0, 1, 0},
          .sample_count = count};
}

TEST(LightTest, PointIsRebasedInDoubleAndRoundedOnce) {
  // 4194304.3 is no float; its difference to the origin is near one.
  const auto s = Samples(Light::Point({4194304.3, 10, -5}), {4194304, 10, 5});
  ASSERT_EQ(s.size(), 1u);
  EXPECT_TRUE(s[0].valid);
  EXPECT_FALSE(s[0].directional);
  EXPECT_EQ(s[0].value, (Vec3f{static_cast<float>(4194304.3 - 4194304.0), 0, -10}));
}

TEST(LightTest, SamplesCarryIndexMaskAndSource) {
  Light light = Square(3);
  light.mask = 6;
  light.source_triangle = 17;
  std::vector<LightSample> samples = Samples(Light::Directional({0, 0, 1}));
  ASSERT_TRUE(AppendSamples(light, 9, {}, &samples).ok());
  ASSERT_EQ(samples.size(), 4u);  // Appended behind what was there.
  EXPECT_TRUE(samples[0].directional);
  EXPECT_EQ(samples[0].light, 0u);
  for (size_t k = 1; k < 4; ++k) {
    EXPECT_EQ(samples[k].light, 9u);
    EXPECT_EQ(samples[k].mask, 6u);
    EXPECT_EQ(samples[k].source_triangle, 17u);
  }
}

TEST(LightTest, DirectionIsRoundedAndNotRebased) {
  const auto s = Samples(Light::Directional({0.1, -0.0, 0.3}), {1e6, 1e6, 1e6});
  ASSERT_TRUE(s[0].valid);
  EXPECT_EQ(s[0].value, (Vec3f{0.1f, 0, 0.3f}));
  EXPECT_FALSE(std::signbit(s[0].value.y));
}

TEST(LightTest, DirectionsOutOfRangeAreInvalid) {
  const double small = 0x1p-20, large = 0x1p20;
  EXPECT_TRUE(Samples(Light::Directional({0, small, 0}))[0].valid);
  EXPECT_TRUE(Samples(Light::Directional({0, 0, -large}))[0].valid);
  const std::vector<Vec3d> bad = {{0, 0, 0},
                                  {std::nextafter(small, 0.0), 0, 0},
                                  {0, std::nextafter(large, kInf), 0},
                                  {kNan, 0, 1},
                                  {1, kNan, 0},
                                  {1, 0, kNan},
                                  {0, -kInf, 0}};
  for (Vec3d d : bad) {
    const auto s = Samples(Light::Directional(d));
    EXPECT_FALSE(s[0].valid) << d.x << " " << d.y << " " << d.z;
    EXPECT_EQ(s[0].value, Vec3f{});
  }
}

// The largest component counts, not the length.
TEST(LightTest, DiagonalsAreMeasuredByTheirLargestComponent) {
  const double small = 0x1p-20, large = 0x1p20, below = std::nextafter(small, 0.0);
  EXPECT_TRUE(Samples(Light::Directional({large, -large, large}))[0].valid);
  EXPECT_TRUE(Samples(Light::Directional({small, small, -small}))[0].valid);
  EXPECT_FALSE(Samples(Light::Directional({below, below, below}))[0].valid);
  EXPECT_FALSE(Samples(Light::Directional({large, large, std::nextafter(large, kInf)}))[0].valid);
}

TEST(LightTest, PositionsOutOfRangeAreInvalid) {
  const double limit = kMaxCoordinate;
  EXPECT_TRUE(Samples(Light::Point({limit, -limit, 0}))[0].valid);
  EXPECT_FALSE(Samples(Light::Point({std::nextafter(limit, kInf), 0, 0}))[0].valid);
  EXPECT_FALSE(Samples(Light::Point({limit, 0, 0}), {-1, 0, 0})[0].valid);
  EXPECT_FALSE(Samples(Light::Point({0, kNan, 0}))[0].valid);
  EXPECT_FALSE(Samples(Light::Point({0, 0, kInf}))[0].valid);
}

TEST(LightTest, RectangleSamplesFollowTheR2Sequence) {
  // The first elements of frac(½ + k/g), frac(½ + k/g²), worked out with 60 decimal digits.
  const double expected[5][2] = {{0.5, 0.5},
                                 {0.25487766624669276, 0.06984029099805327},
                                 {0.0097553324933855, 0.6396805819961065},
                                 {0.7646329987400783, 0.2095208729941598},
                                 {0.5195106649867710, 0.7793611639922131}};
  const auto s = Samples(Square(5));
  ASSERT_EQ(s.size(), 5u);
  for (int k = 0; k < 5; ++k) {
    EXPECT_FLOAT_EQ(s[k].value.x, static_cast<float>(2 * expected[k][0] - 1)) << k;
    EXPECT_FLOAT_EQ(s[k].value.y, static_cast<float>(2 * expected[k][1] - 1)) << k;
    EXPECT_EQ(s[k].value.z, 0);
  }
}

TEST(LightTest, SampleDoesNotDependOnTheCount) {
  Light light = Square(kMaxLightSamples);
  light.position = {3.7, 1e5, -2};
  light.half_u = {0.3, 0.1, 0.7};
  light.half_v = {-0.2, 1.1, 0.4};
  const auto all = Samples(light, {0, 1e5, 0});
  ASSERT_EQ(all.size(), kMaxLightSamples);
  for (uint32_t count : {1u, 7u, 1000u}) {
    light.sample_count = count;
    const auto some = Samples(light, {0, 1e5, 0});
    ASSERT_EQ(some.size(), count);
    for (uint32_t k = 0; k < count; ++k) EXPECT_EQ(some[k].value, all[k].value);
  }
}

// The reason for this sequence: any prefix covers the square evenly. Independent samples leave
// cells of a 16 × 16 grid with 256 samples empty at a share of 1/e.
TEST(LightTest, SamplesCoverTheRectangle) {
  std::vector<int> cells(256);
  for (const LightSample& s : Samples(Square(1024))) {
    EXPECT_GE(s.value.x, -1);
    EXPECT_LE(s.value.x, 1);
    EXPECT_GE(s.value.y, -1);
    EXPECT_LE(s.value.y, 1);
    const int i = std::min(15, static_cast<int>((s.value.x + 1) * 8));
    const int j = std::min(15, static_cast<int>((s.value.y + 1) * 8));
    ++cells[16 * j + i];
  }
  EXPECT_GE(*std::min_element(cells.begin(), cells.end()), 1);
  EXPECT_LE(*std::max_element(cells.begin(), cells.end()), 8);
}

TEST(LightTest, RectangleIsRebasedAfterItsSamplesAreFormed) {
  Light light = Square(1);
  light.position = {1e6 + 0.25, 0, 0};
  const auto s = Samples(light, {1e6, 0, 0});
  EXPECT_EQ(s[0].value, (Vec3f{0.25f, 0, 0}));  // Sample 0 is the centre.
}

TEST(LightTest, NonFiniteRectangleGivesInvalidSamples) {
  for (int which = 0; which < 3; ++which) {
    Light light = Square(4);
    (which == 0 ? light.position : which == 1 ? light.half_u : light.half_v).y = kNan;
    const auto s = Samples(light);
    ASSERT_EQ(s.size(), 4u);
    for (const LightSample& sample : s) {
      EXPECT_FALSE(sample.valid);
      EXPECT_EQ(sample.value, Vec3f{});
    }
  }
}

// Whatever state the host program's thread is in: the same bits.
TEST(LightTest, SamplesDoNotDependOnTheStateOfTheCaller) {
  Light rectangle = Square(1000);
  rectangle.position = {3.7, 1e5 + 0.1, -2.3};
  rectangle.half_u = {0.3, 0.1, 0.7};
  rectangle.half_v = {-0.2, 1.1, 1e-42};
  const std::vector<Light> lights = {rectangle, Light::Point({3.7, 1e5 + 0.1, 1e-41}),
                                     Light::Directional({0.1, 0.3, 1e-42})};
  for (const Light& light : lights) {
    const std::vector<LightSample> expected = Samples(light, {0.1, 1e5, 0});
    for (const unsigned state : {unsigned{_MM_ROUND_UP}, unsigned{_MM_ROUND_DOWN},
                                 unsigned{_MM_FLUSH_ZERO_ON | _MM_DENORMALS_ZERO_ON}}) {
      const unsigned saved = _mm_getcsr();
      _mm_setcsr(saved | state);
      const std::vector<LightSample> samples = Samples(light, {0.1, 1e5, 0});
      _mm_setcsr(saved);
      ASSERT_EQ(samples.size(), expected.size());
      for (size_t k = 0; k < samples.size(); ++k) {
        for (int axis = 0; axis < 3; ++axis) {
          ASSERT_EQ(std::bit_cast<uint32_t>(samples[k].value[axis]),
                    std::bit_cast<uint32_t>(expected[k].value[axis]))
              << "sample " << k << ", axis " << axis << ", state " << state;
        }
      }
    }
  }
}

TEST(LightTest, BadArgumentsAreNamed) {
  std::vector<LightSample> samples;
  const auto message = [&](const Light& light) {
    const absl::Status s = AppendSamples(light, 3, {}, &samples);
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(s.message()), HasSubstr("light 3"));
    return std::string(s.message());
  };
  EXPECT_THAT(message(Square(0)), HasSubstr("sample_count = 0"));
  EXPECT_THAT(message(Square(kMaxLightSamples + 1)), HasSubstr("sample_count = 65537"));
  Light point = Light::Point({});
  point.sample_count = 2;
  EXPECT_THAT(message(point), HasSubstr("sample_count = 2"));
  point.sample_count = 1;
  point.weight = kInf;
  EXPECT_THAT(message(point), HasSubstr("weight = inf"));
  Light unknown;
  unknown.kind = static_cast<Light::Kind>(7);
  EXPECT_THAT(message(unknown), HasSubstr("kind = 7"));
  EXPECT_TRUE(samples.empty());
}

}  // namespace
}  // namespace sightline
