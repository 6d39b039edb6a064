// SPDX-License-Identifier: Apache-2.0
//
// A relit picture is what asking about all its lights at once gives, bit for bit, whichever light
// is chosen and wherever it went; packets hold every hit once, and nothing else.
#include "core/query/relighting.h"

#include <cstdint>
#include <vector>

#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::MakeScene;
using testing_support::TestRng;

constexpr uint32_t kWidth = 37, kHeight = 22;

// Boxes over a floor that leaves part of the picture empty.
IndexedGeometry MakeYard(TestRng& rng) {
  ObjectInput object;
  object.name = "yard";
  const auto quad = [&](Vec3d a, Vec3d u, Vec3d v) {
    const auto first = static_cast<uint32_t>(object.vertices.size());
    for (const Vec3d p : {a, a + u, a + u + v, a + v}) object.vertices.push_back(p);
    for (const uint32_t i : {0, 1, 2, 0, 2, 3}) object.indices.push_back(first + i);
  };
  quad({-4, -4, 0}, {8, 0, 0}, {0, 8, 0});
  for (int i = 0; i < 12; ++i) {
    const Vec3d at{rng.Uniform(-3, 3), rng.Uniform(-3, 3), rng.Uniform(0.2, 2)};
    quad(at, {rng.Uniform(0.2, 1), 0, rng.Uniform(-0.2, 0.2)}, {0, rng.Uniform(0.2, 1), 0.1});
  }
  return MakeScene({object});
}

std::vector<LightSample> SamplesOf(uint32_t light, int count, TestRng& rng) {
  std::vector<LightSample> samples;
  for (int i = 0; i < count; ++i) {
    LightSample sample;
    sample.light = light;
    sample.value = ToFloat(Vec3d{rng.Uniform(-4, 4), rng.Uniform(-4, 4), rng.Uniform(2.5, 5)});
    samples.push_back(sample);
  }
  return samples;
}

std::vector<double> WeightsFor(size_t count, TestRng& rng) {
  std::vector<double> weights;
  for (size_t i = 0; i < count; ++i) weights.push_back(rng.Uniform(-1, 3));
  return weights;
}

class RelightingTest : public ::testing::Test {
 protected:
  RelightingTest() : scene_(MakeYard(rng_)) {
    const auto camera = LookAt({0.3, -7, 4}, {0, 0, 0.5}, {0, 0, 1}, 50, kWidth, kHeight);
    EXPECT_TRUE(camera.ok()) << camera.status();
    const absl::Status traced =
        TraceTile(scene_, *camera, {0, 0, kWidth, kHeight}, {}, {.points = true}, {}, &tile_);
    EXPECT_TRUE(traced.ok()) << traced;
  }

  // The picture by asking about everything at once, in this order.
  std::vector<double> Whole(const std::vector<std::vector<LightSample>>& lights,
                            const std::vector<std::vector<double>>& weights) const {
    std::vector<LightSample> samples;
    std::vector<double> all_weights;
    for (size_t i = 0; i < lights.size(); ++i) {
      samples.insert(samples.end(), lights[i].begin(), lights[i].end());
      all_weights.insert(all_weights.end(), weights[i].begin(), weights[i].end());
    }
    ShadowResult result;
    const absl::Status status = ComputeShadows(
        scene_, PointRange::Slice(tile_.points, 0, tile_.points.size()), samples, all_weights, {},
        {.bits = false, .weighted_sums = true}, {.strategy = Strategy::kBruteForce}, &result);
    EXPECT_TRUE(status.ok()) << status;
    std::vector<double> picture(kWidth * kHeight, 0.0);
    for (size_t i = 0; i < tile_.point_pixel.size(); ++i) {
      picture[tile_.point_pixel[i]] = result.weighted_sums[i];
    }
    return picture;
  }

  TestRng rng_;
  const IndexedGeometry scene_;
  TileResult tile_;
};

TEST_F(RelightingTest, PacketsHoldEveryHitOnce) {
  ASSERT_GT(tile_.points.size(), 100u);
  ASSERT_LT(tile_.points.size(), size_t{kWidth} * kHeight) << "no ray misses";
  for (const int side : kPacketSides) {
    const HitPackets packets =
        PacketsOfHits(tile_.points, tile_.point_pixel, kWidth, kHeight, side);
    ASSERT_EQ(packets.points.size() % (side * side), 0u);
    ASSERT_EQ(packets.pixel.size(), packets.points.size());
    ASSERT_EQ(packets.pixel_count, size_t{kWidth} * kHeight);
    std::vector<int> seen(kWidth * kHeight, 0);
    std::vector<size_t> hit_of(kWidth * kHeight, 0);
    for (size_t i = 0; i < tile_.point_pixel.size(); ++i) hit_of[tile_.point_pixel[i]] = i;
    for (size_t first = 0; first < packets.pixel.size(); first += size_t(side) * side) {
      uint32_t corner = kNoPixel, filler = kNoPixel;
      for (size_t i = first; i < first + size_t(side) * side; ++i) {
        const uint32_t pixel = packets.pixel[i];
        if (pixel == kNoPixel) continue;
        if (filler == kNoPixel) filler = pixel;
        ++seen[pixel];
        const uint32_t x = pixel % kWidth / side, y = pixel / kWidth / side;
        if (corner == kNoPixel) corner = y * kWidth + x;
        EXPECT_EQ(y * kWidth + x, corner) << "of another square";
        EXPECT_EQ(packets.points.positions[i], tile_.points.positions[hit_of[pixel]]);
        EXPECT_EQ(packets.points.sources[i], tile_.points.sources[hit_of[pixel]]);
      }
      ASSERT_NE(filler, kNoPixel) << "a packet without a hit";
      for (size_t i = first; i < first + size_t(side) * side; ++i) {
        if (packets.pixel[i] != kNoPixel) continue;
        EXPECT_EQ(packets.points.positions[i], tile_.points.positions[hit_of[filler]]);
      }
    }
    for (uint32_t p = 0; p < kWidth * kHeight; ++p) {
      const bool hit = std::find(tile_.point_pixel.begin(), tile_.point_pixel.end(), p) !=
                       tile_.point_pixel.end();
      EXPECT_EQ(seen[p], hit ? 1 : 0) << p;
    }
  }
}

TEST_F(RelightingTest, APictureWithMovedLightsIsTheWholePicture) {
  for (const Strategy strategy : {Strategy::kPacket, Strategy::kSingle, Strategy::kShaft}) {
    std::vector<std::vector<LightSample>> lights;
    std::vector<std::vector<double>> weights;
    std::vector<LightSample> samples;
    std::vector<double> all_weights;
    for (uint32_t light = 0; light < 3; ++light) {
      lights.push_back(SamplesOf(light, 1 + static_cast<int>(rng_.Below(4)), rng_));
      weights.push_back(WeightsFor(lights.back().size(), rng_));
      samples.insert(samples.end(), lights.back().begin(), lights.back().end());
      all_weights.insert(all_weights.end(), weights.back().begin(), weights.back().end());
    }
    const QueryOptions options{.strategy = strategy};
    absl::StatusOr<Relighting> picture =
        Relighting::Make(scene_, PacketsOfHits(tile_.points, tile_.point_pixel, kWidth, kHeight, 8),
                         samples, all_weights, options);
    ASSERT_TRUE(picture.ok()) << picture.status();
    EXPECT_EQ(picture->color(), Whole(lights, weights));
    for (int step = 0; step < 6; ++step) {
      const auto light = static_cast<uint32_t>(rng_.Below(3));
      ASSERT_TRUE(picture->Choose(light).ok());
      lights[light] = SamplesOf(light, 1 + static_cast<int>(rng_.Below(4)), rng_);
      weights[light] = WeightsFor(lights[light].size(), rng_);
      ASSERT_TRUE(picture->Move(lights[light], weights[light], options).ok());
      EXPECT_EQ(picture->stats().rays % 64, 0u);
      std::vector<std::vector<LightSample>> others = lights;
      std::vector<std::vector<double>> other_weights = weights;
      others.erase(others.begin() + light);
      other_weights.erase(other_weights.begin() + light);
      EXPECT_EQ(picture->base(), Whole(others, other_weights));
      others.push_back(lights[light]);
      other_weights.push_back(weights[light]);
      EXPECT_EQ(picture->color(), Whole(others, other_weights)) << "step " << step;
    }
  }
}

// Packets are what was given, for lights of many samples, too, and where another order would pay.
TEST_F(RelightingTest, PacketsKeepTheirPoints) {
  HitPackets packets;
  packets.side = 8;
  for (int i = 0; i < 2048; ++i) {
    const size_t from = rng_.Below(tile_.points.size());
    packets.points.positions.push_back(tile_.points.positions[from]);
    packets.points.sources.push_back(tile_.points.sources[from]);
    packets.points.valid.push_back(1);
    packets.pixel.push_back(kNoPixel);
  }
  const std::vector<LightSample> samples = SamplesOf(0, 16, rng_);
  const QueryOptions options{.strategy = Strategy::kPacket, .packet_side = packets.side};
  const auto tests = [&](bool ordered) {
    ShadowResult result;
    const absl::Status status =
        ComputeShadows(scene_, PointRange::All(packets.points), samples, {}, {.ordered = ordered},
                       {.bits = true}, options, &result);
    EXPECT_TRUE(status.ok()) << status;
    return result.stats.triangle_tests;
  };
  ASSERT_NE(tests(true), tests(false)) << "no other order pays";
  const absl::StatusOr<Relighting> picture =
      Relighting::Make(scene_, packets, samples, WeightsFor(samples.size(), rng_), options);
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_EQ(picture->stats().triangle_tests, tests(true));
}

TEST_F(RelightingTest, WhatDoesNotFitIsNamed) {
  const HitPackets packets = PacketsOfHits(tile_.points, tile_.point_pixel, kWidth, kHeight, 4);
  std::vector<LightSample> samples = SamplesOf(0, 2, rng_);
  const auto make = [&](const std::vector<double>& weights) {
    return Relighting::Make(scene_, packets, samples, weights, {});
  };
  EXPECT_NE(make({1}).status().message().find("2 samples and 1 weights"), std::string::npos);
  samples[1].light = 2;
  EXPECT_NE(make({1, 1}).status().message().find("samples[1].light = 2"), std::string::npos);
  samples[1].light = 0;
  absl::StatusOr<Relighting> picture = make({1, 1});
  ASSERT_TRUE(picture.ok()) << picture.status();
  EXPECT_NE(picture->Choose(1).message().find("light 1"), std::string::npos);
  const std::vector<double> before = picture->color();
  EXPECT_EQ(picture->Move(samples, std::vector<double>{1}, {}).code(),
            absl::StatusCode::kInvalidArgument);
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(picture
                ->Move(samples, std::vector<double>{5, 5},
                       {.strategy = Strategy::kSingle, .cancel = &cancel})
                .code(),
            absl::StatusCode::kCancelled);
  EXPECT_EQ(picture->color(), before);
}

}  // namespace
}  // namespace sightline
