// SPDX-License-Identifier: Apache-2.0
//
// Pictures of leaves before leaves are layered, others are not; and layers hold each valid point
// once, whatever the others are. What shadows are found in layers is what they are without.
#include "core/query/depth_layers.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/geometry/box3.h"
#include "core/query/point_order.h"
#include "core/query/shadows.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

constexpr int kPictureSide = 64;  // Of a picture's tile, in pixels.

// A tile's pixels as pictures have them, by squares of four in squares of sixteen. Each has a point
// at depth(x, y) of a view from above that leans by `lean`.
template <class Depth>
std::vector<Vec3f> Picture(const Depth& depth, double lean = 0.3) {
  std::vector<Vec3f> points;
  for (int i = 0; i < kPictureSide * kPictureSide; ++i) {
    const int block = i / 256, square = i / 16 % 16, pixel = i % 16;
    const int x = block % 4 * 16 + square % 4 * 4 + pixel % 4;
    const int y = block / 4 * 16 + square / 4 * 4 + pixel / 4;
    const double z = depth(x, y);
    points.push_back({static_cast<float>(x * 0.01 + lean * z), static_cast<float>(y * 0.01),
                      static_cast<float>(z)});
  }
  return points;
}

// Each pixel shows one of twelve leaves, whichever.
std::vector<Vec3f> Foliage(TestRng& rng) {
  return Picture([&](int, int) { return 0.06 * rng.Below(12) + rng.Uniform(0, 0.01); });
}

double MeanWidth(std::span<const Vec3f> points) {
  double sum = 0;
  size_t blocks = 0;
  for (size_t first = 0; first + kSmallestPart <= points.size(); first += kSmallestPart, ++blocks) {
    Box3f box;
    for (size_t i = 0; i < kSmallestPart; ++i) box.Extend(points[first + i]);
    const Vec3f extent = box.Extent();
    sum += extent.x + extent.y + extent.z;
  }
  return sum / static_cast<double>(blocks);
}

// Each valid point once, with its place and its number; all ranks accounted for.
void ExpectWhole(const PartedPoints& order, std::span<const Vec3f> positions,
                 std::span<const uint8_t> valid) {
  const size_t n = positions.size();
  ASSERT_EQ(order.numbers.size(), order.positions.size());
  ASSERT_EQ(order.ranks.size(), (n + 7) / 8 * 8);
  for (size_t k = 0; k < order.numbers.size(); ++k) {
    const uint32_t p = order.numbers[k];
    ASSERT_LT(p, n);
    EXPECT_TRUE(valid[p]);
    EXPECT_EQ(order.ranks[p], k);
    EXPECT_EQ(order.positions[k], positions[p]);
  }
  size_t there = 0;
  for (size_t p = 0; p < order.ranks.size(); ++p) {
    if (p < n && valid[p]) {
      ++there;
    } else {
      EXPECT_EQ(order.ranks[p], n) << p;
    }
  }
  EXPECT_EQ(order.numbers.size(), there);
}

TEST(DepthLayersTest, NarrowBlocksOfLeavesBeforeLeaves) {
  TestRng rng;
  const std::vector<Vec3f> points = Foliage(rng);
  const std::vector<uint8_t> valid(points.size(), 1);
  const DepthLayers layers(points, valid);
  EXPECT_GT(layers.gain(), 2);
  const PartedPoints order = layers.Order();
  ExpectWhole(order, points, valid);
  const double gained = MeanWidth(points) / MeanWidth(order.positions);
  EXPECT_GT(gained, 2);
  // What was foretold of a sample is about what came out.
  EXPECT_LT(std::abs(std::log(layers.gain() / gained)), std::log(1.5));
}

TEST(DepthLayersTest, SurfacesGainNothing) {
  for (const double slope : {0.0, 0.3, 3.0}) {
    const std::vector<Vec3f> plane =
        Picture([slope](int x, int y) { return slope * 0.01 * (x + y); });
    EXPECT_LT(DepthLayers(plane, std::vector<uint8_t>(plane.size(), 1)).gain(), 1) << slope;
  }
  // Nor do two walls, one before the other, but for the blocks along the edge.
  const std::vector<Vec3f> walls = Picture([](int x, int) { return x < 30 ? 0.0 : 5.0; });
  const DepthLayers layers(walls, std::vector<uint8_t>(walls.size(), 1));
  EXPECT_LT(layers.gain(), 1.5);
}

TEST(DepthLayersTest, NothingIsSaidOfOnePointOrOfNone) {
  const std::vector<Vec3f> same(2000, Vec3f{1, 2, 3});
  EXPECT_EQ(DepthLayers(same, std::vector<uint8_t>(2000, 1)).gain(), 0);
  EXPECT_EQ(DepthLayers(same, std::vector<uint8_t>(2000, 0)).gain(), 0);
  // Differences whose squares are none, and too great a one.
  for (const float far : {1e-30f, 1e25f}) {
    std::vector<Vec3f> apart(2000);
    for (size_t i = 0; i < apart.size(); ++i) apart[i].x = i % 3 == 0 ? far : 0;
    const DepthLayers layers(apart, std::vector<uint8_t>(2000, 1));
    EXPECT_TRUE(std::isfinite(layers.gain())) << far;
    EXPECT_EQ(layers.gain(), 0) << far;
  }
}

TEST(DepthLayersTest, HoldEachValidPointOnceWhateverTheOthersAre) {
  TestRng rng;
  const std::vector<Vec3f> foliage = Foliage(rng);
  constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
  for (const size_t count : {4096u, 4095u, 4089u, 4081u, 2050u, 1031u, 531u, 513u}) {
    for (const uint32_t one_invalid_of : {0u, 100u, 3000u}) {
      std::vector<Vec3f> points(foliage.begin(), foliage.begin() + static_cast<ptrdiff_t>(count));
      std::vector<uint8_t> valid(count, 1);
      for (size_t p = 0; p < count && one_invalid_of > 0; ++p) {
        if (rng.Below(one_invalid_of) > 0) continue;
        valid[p] = 0;
        points[p] = rng.Below(2) > 0 ? Vec3f{kNoNumber, kNoNumber, kNoNumber}
                                     : Vec3f{-std::numeric_limits<float>::infinity(), 0, 1e38f};
      }
      const DepthLayers layers(points, valid);
      ASSERT_GT(layers.gain(), 1) << count;
      ExpectWhole(layers.Order(), points, valid);
    }
  }
}

// Tokens that fire before, and amid: no machine orders two million points in the time of a look.
TEST(DepthLayersTest, EndWhenCancelled) {
  TestRng rng;
  const std::vector<Vec3f> foliage = Foliage(rng);
  std::vector<Vec3f> points;
  while (points.size() < 2'000'000) points.insert(points.end(), foliage.begin(), foliage.end());
  const std::vector<uint8_t> valid(points.size(), 1);
  const DepthLayers layers(points, valid);
  ASSERT_GT(layers.gain(), 1);
  for (const int microseconds : {0, 1, 1000}) {
    CancelToken late;
    late.set_deadline(CancelToken::Clock::now() + std::chrono::microseconds(microseconds));
    EXPECT_TRUE(layers.Order(&late).numbers.empty());
    EXPECT_TRUE(late.cancelled());
  }
  const CancelToken live;
  ExpectWhole(layers.Order(&live), points, valid);
}

TEST(DepthLayersTest, AreTakenForOneLightWhoseRaysAreDear) {
  TestRng rng;
  const std::vector<Vec3f> points = Foliage(rng);
  const std::vector<uint8_t> valid(points.size(), 1);
  const auto order = [&](size_t samples, float ray_cost) {
    return OrderThatPays(points, valid, samples, ray_cost);
  };
  EXPECT_FALSE(order(1, 0).has_value()) << "what rays cost is not known";
  EXPECT_FALSE(order(1, 20).has_value()) << "they cost little";
  const std::optional<OwnOrder> one = order(1, 100), many = order(100, 100);
  ASSERT_TRUE(one.has_value() && many.has_value());
  EXPECT_FALSE(one->points.ranks.empty()) << "layers";
  EXPECT_GT(one->gain, 1.2f);
  EXPECT_LT(one->gain, 1.8f);
  EXPECT_TRUE(many->points.ranks.empty()) << "parted";
  // Few points are a few blocks in any order.
  EXPECT_FALSE(OrderThatPays(std::span(points).first(512), std::span(valid).first(512), 1, 100));
  const std::vector<Vec3f> plane = Picture([](int x, int y) { return 0.01 * (x + y); });
  EXPECT_FALSE(OrderThatPays(plane, valid, 1, 100).has_value());
  // Strangers are parted, unless their rays cost little all the same.
  std::vector<Vec3f> strangers = plane;
  for (size_t i = strangers.size(); i > 1; --i)
    std::swap(strangers[i - 1], strangers[rng.Below(i)]);
  EXPECT_TRUE(OrderThatPays(strangers, valid, 1, 0).has_value());
  EXPECT_TRUE(OrderThatPays(strangers, valid, 1, 100).has_value());
  EXPECT_FALSE(OrderThatPays(strangers, valid, 1, 20).has_value());
  EXPECT_TRUE(OrderThatPays(strangers, valid, 64, 20).has_value());
}

TEST(DepthLayersTest, ShadowsAreThoseOfPointsAsTheyCame) {
  TestRng rng;
  const IndexedGeometry scene =
      IndexObjects({MakeClosedSphere(16, 24, 0.3, {0.5, 0.3, 2})}, Vec3d{});
  std::vector<Vec3f> points = Foliage(rng);
  std::vector<uint8_t> valid(points.size(), 1);
  std::vector<uint32_t> sources(points.size());
  for (size_t p = 0; p < points.size(); ++p) {
    valid[p] = rng.Below(500) > 0;
    sources[p] = rng.Below(4) > 0 ? kNoTriangle : rng.Below(16);
  }
  const PointRange range{points, sources, valid};
  for (const Light& light : {Light::Point({0.4, 0.3, 9}), Light::Directional({0.1, 0.2, 1})}) {
    std::vector<LightSample> samples;
    ASSERT_TRUE(AppendSamples(light, 0, {}, &samples).ok());
    for (const bool blockers : {false, true}) {
      const ShadowOutputs outputs = {
          .bits = true, .counts = true, .weighted_sums = true, .blockers = blockers};
      ASSERT_TRUE(OrderThatPays(points, valid, 1, 200).has_value());
      ShadowHints cheap = {.ray_cost = 1}, dear = {.ray_cost = 200};
      const std::vector<double> weights = {0.25};
      ShadowResult as_given, layered;
      ASSERT_TRUE(
          ComputeShadows(scene, range, samples, weights, {.hints = &cheap}, outputs, {}, &as_given)
              .ok());
      ASSERT_TRUE(
          ComputeShadows(scene, range, samples, weights, {.hints = &dear}, outputs, {}, &layered)
              .ok());
      EXPECT_EQ(layered.lit_bits, as_given.lit_bits);
      EXPECT_EQ(layered.lit_counts, as_given.lit_counts);
      EXPECT_EQ(layered.weighted_sums, as_given.weighted_sums);
      EXPECT_EQ(layered.blocker, as_given.blocker);
      EXPECT_EQ(layered.blocker_t, as_given.blocker_t);
      const auto lit = std::count(as_given.lit_counts.begin(), as_given.lit_counts.end(), 1u);
      EXPECT_GT(lit, 400);
      EXPECT_LT(lit, 3700);
    }
  }
}

}  // namespace
}  // namespace sightline
