// SPDX-License-Identifier: Apache-2.0
//
// Points under a ceiling, which are answered together where a triangle of it, or two, block all of
// them: every way of asking gives the bits of single rays, and most need no walk.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/query/shadows.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::MakeScene;
using testing_support::TestRng;

constexpr size_t kRowSide = 160;  // Points along a side of the floor.

// A ceiling at height 3 over a floor 8 by 8 in pieces, but for where x > 4, and a few crumbs
// below it that keep some blocks from being covered by the ceiling alone.
std::vector<ObjectInput> Room(TestRng& rng) {
  ObjectInput room;
  const auto quadrangle = [&](double x0, double y0, double x1, double y1, double z) {
    const auto first = static_cast<uint32_t>(room.vertices.size());
    for (const Vec3d& corner : {Vec3d{x0, y0, z}, {x1, y0, z}, {x1, y1, z}, {x0, y1, z}}) {
      room.vertices.push_back(corner);
    }
    for (const uint32_t corner : {0u, 1u, 2u, 0u, 2u, 3u}) room.indices.push_back(first + corner);
  };
  quadrangle(-4, -4, 4, 3, 3);
  quadrangle(-4, 3, 4, 12, 3);
  for (int i = 0; i < 8; ++i) {
    for (int j = 0; j < 8; ++j) quadrangle(i, j, i + 1, j + 1, 0);
  }
  for (int i = 0; i < 30; ++i) {
    const double x = rng.Uniform(0, 8), y = rng.Uniform(0, 8);
    quadrangle(x, y, x + 0.05, y + 0.05, rng.Uniform(0.1, 2));
  }
  return {room};
}

struct Floor {
  std::vector<Vec3f> positions;
  std::vector<uint32_t> sources;
  std::vector<uint8_t> valid;
};

// Squares of 16 by 16 points one after another, as a tile's are. Pieces of the floor name
// themselves: triangles come in the order of the indices.
Floor FloorPoints(const IndexedGeometry& scene, bool with_sources) {
  Floor floor;
  for (size_t square = 0; square < kRowSide * kRowSide / 256; ++square) {
    for (size_t i = 0; i < 256; ++i) {
      const size_t column = square % (kRowSide / 16) * 16 + i % 16;
      const size_t row = square / (kRowSide / 16) * 16 + i / 16;
      const auto x = static_cast<float>((static_cast<double>(column) + 0.37) * 8 / kRowSide);
      const auto y = static_cast<float>((static_cast<double>(row) + 0.41) * 8 / kRowSide);
      floor.positions.push_back({x, y, 0});
      const auto piece = static_cast<uint32_t>(x) * 8 + static_cast<uint32_t>(y);
      const bool below = y - static_cast<float>(static_cast<uint32_t>(y)) <
                         x - static_cast<float>(static_cast<uint32_t>(x));
      floor.sources.push_back(4 + 2 * piece + (below ? 0 : 1));
    }
  }
  EXPECT_GT(scene.geometry.triangles.size(), size_t{4 + 128});
  if (!with_sources) floor.sources.clear();
  floor.valid.assign(floor.positions.size(), 1);
  return floor;
}

std::vector<LightSample> Lights(int kind) {
  std::vector<LightSample> samples;
  const auto add = [&](const Light& light, uint32_t index) {
    EXPECT_TRUE(AppendSamples(light, index, {}, &samples).ok());
  };
  if (kind == 0) {
    add(Light::Point({2, 5, 9}), 0);
  } else if (kind == 1) {
    add(Light::Directional({0.2, -0.1, 1}), 0);
  } else if (kind == 2) {  // As an area light's samples: all of one light.
    for (int i = 0; i < 6; ++i) add(Light::Point({2 + 0.1 * i, 5, 9}), 0);
  } else {  // More samples than one walk takes together; behind them a sun, and a light of three.
    Light area{.kind = Light::Kind::kRectangle, .position = {2, 5, 9}};
    area.half_u = {0.8, 0, 0};
    area.half_v = {0, 0.8, 0.1};
    area.sample_count = 23;
    add(area, 0);
    add(Light::Directional({0.2, -0.1, 1}), 1);
    area.sample_count = 3;
    add(area, 2);
  }
  return samples;
}

TEST(CoveredPointsTest, AllWaysOfAskingGiveTheBitsOfSingleRays) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene(Room(rng));
  for (int kind = 0; kind < 4; ++kind) {
    const std::vector<LightSample> samples = Lights(kind);
    for (const bool with_sources : {true, false}) {
      SCOPED_TRACE(testing::Message() << "lights " << kind << ", sources " << with_sources);
      const Floor floor = FloorPoints(scene, with_sources);
      const size_t n = floor.positions.size(), row = n / 8;
      const PointRange points{floor.positions, floor.sources, floor.valid};
      const ShadowOutputs outputs{.bits = true, .counts = true, .answered_by = true};
      ShadowResult truth;
      ASSERT_TRUE(ComputeShadows(scene, points, samples, {}, {}, outputs,
                                 {.strategy = Strategy::kSingle}, &truth)
                      .ok());
      for (const Strategy strategy : {Strategy::kAuto, Strategy::kShaft}) {
        ShadowHints hints;
        uint64_t covers = 0;
        // At once, then a tile of 4,096 points after another, which hand on their hints.
        for (const size_t size : {n, size_t{4096}, size_t{4096 - 8}}) {
          for (size_t first = 0; first < n; first += size) {
            const size_t count = std::min(size, n - first);
            PointRange some{
                points.positions.subspan(first, count), {}, points.valid.subspan(first, count)};
            if (with_sources) some.sources = points.sources.subspan(first, count);
            ShadowResult got;
            ASSERT_TRUE(ComputeShadows(scene, some, samples, {}, {.ordered = true, .hints = &hints},
                                       outputs, {.strategy = strategy}, &got)
                            .ok());
            covers += got.stats.shaft.covers;
            for (size_t s = 0; s < samples.size(); ++s) {
              for (size_t byte = 0; byte < count / 8; ++byte) {
                ASSERT_EQ(got.lit_bits[s * (count / 8) + byte],
                          truth.lit_bits[s * row + first / 8 + byte])
                    << "sample " << s << ", points from " << first + 8 * byte << " on";
              }
            }
            for (size_t i = 0; i < count; ++i) {
              ASSERT_EQ(got.lit_counts[i], truth.lit_counts[first + i]);
            }
            for (const AnsweredBy by : got.answered_by) ASSERT_NE(by, AnsweredBy::kNoRay);
          }
        }
        // Of three times as many vectors of sixteen rays.
        EXPECT_GT(covers, 3 * samples.size() * n / 16 / 4);
      }
      size_t lit = 0;
      for (const uint32_t count : truth.lit_counts) lit += count;
      EXPECT_GT(lit, samples.size() * n / 10);
      EXPECT_LT(lit, samples.size() * n * 3 / 4);
    }
  }
}

// What is covered costs no walk at all: neither a node, nor a test of a triangle and a ray.
TEST(CoveredPointsTest, ACeilingOverAllNeedsNoWalk) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene(Room(rng));
  const Floor floor = FloorPoints(scene, /*with_sources=*/true);
  const std::vector<LightSample> samples = Lights(0);
  // Squares under the ceiling, and behind one quadrangle of it alone.
  const size_t count = 3 * 256;
  const PointRange points{std::span(floor.positions).first(count),
                          std::span(floor.sources).first(count),
                          std::span(floor.valid).first(count)};
  ShadowHints hints;
  ShadowResult got;
  for (int round = 0; round < 2; ++round) {
    ASSERT_TRUE(
        ComputeShadows(scene, points, samples, {}, {.hints = &hints}, {.bits = true}, {}, &got)
            .ok());
    for (const uint8_t byte : got.lit_bits) EXPECT_EQ(byte, 0);
  }
  EXPECT_EQ(got.stats.nodes, 0u);
  EXPECT_EQ(got.stats.triangle_tests, 0u);
  EXPECT_EQ(got.stats.shaft.covers, count / 16);
}

// Where nothing came near the points before, one walk for all of a tile says that nothing does, and
// nobody is laid out or walked for; where something does come near, all is asked about again.
TEST(CoveredPointsTest, WhatNothingComesNearIsLitByOneWalk) {
  TestRng rng;
  ObjectInput room;  // Floor and ceiling in so many pieces that leaves hold one of them alone.
  for (int piece = 0; piece < 200; ++piece) {
    const auto first = static_cast<uint32_t>(room.vertices.size());
    const double x = piece % 10 - 1, y = piece / 10 % 10 - 1, z = piece < 100 ? 0 : 3;
    for (const Vec3d& corner : {Vec3d{x, y, z}, {x + 1, y, z}, {x + 1, y + 1, z}, {x, y + 1, z}}) {
      room.vertices.push_back(corner);
    }
    for (const uint32_t corner : {0u, 1u, 2u, 0u, 2u, 3u}) room.indices.push_back(first + corner);
  }
  for (int i = 0; i < 40; ++i) {  // Above the last points alone.
    const double x = rng.Uniform(0, 8), y = rng.Uniform(6, 8), z = rng.Uniform(0.2, 1);
    const auto first = static_cast<uint32_t>(room.vertices.size());
    for (const Vec3d& corner : {Vec3d{x, y, z}, {x + 0.3, y, z}, {x, y + 0.3, z}}) {
      room.vertices.push_back(corner);
    }
    for (const uint32_t corner : {0u, 1u, 2u}) room.indices.push_back(first + corner);
  }
  const IndexedGeometry scene = MakeScene({room});
  constexpr size_t kTile = 4096, kTiles = 16;
  std::vector<Vec3f> positions;
  for (size_t i = 0; i < kTile * kTiles; ++i) {  // A tile is half a unit of y deep.
    const size_t square = i % kTile / 256, row = i / kTile * 2 + square / 8, line = i % 256 / 16;
    positions.push_back({static_cast<float>(square % 8) + static_cast<float>(i % 16) / 16 + 0.03f,
                         static_cast<float>(row) / 4 + static_cast<float>(line) / 64, 0});
  }
  // One light; and one that reaches whole tiles before and behind one that does not, and a sun, so
  // that whoever left off early for one has all there for the next.
  const Light high = Light::Point({4, 4, 2.5}), low = Light::Point({3, 8.2, 0.5});
  const std::vector<std::vector<Light>> cases = {
      {high}, {high, low}, {low, high, Light::Directional({0.2, 0.1, 1}), high}};
  for (const std::vector<Light>& lights : cases) {
    std::vector<LightSample> samples;
    for (uint32_t k = 0; k < lights.size(); ++k) {
      ASSERT_TRUE(AppendSamples(lights[k], k, {}, &samples).ok());
    }
    for (const SimdTarget simd : {SimdTarget::kAvx2, SimdTarget::kBest}) {
      ShadowHints hints;
      size_t by_one_walk = 0, blocked = 0;
      for (size_t tile = 0; tile < kTiles; ++tile) {
        // The last one's last packet is not full.
        const size_t count = tile + 1 < kTiles ? kTile : kTile - 104;
        const PointRange points{std::span(positions).subspan(tile * kTile, count), {}, {}};
        ShadowResult got, truth;
        const ShadowOutputs outputs{.bits = true, .answered_by = true};
        ASSERT_TRUE(ComputeShadows(scene, points, samples, {}, {.ordered = true, .hints = &hints},
                                   outputs, {.simd = simd}, &got)
                        .ok());
        ASSERT_TRUE(ComputeShadows(scene, points, samples, {}, {}, outputs,
                                   {.strategy = Strategy::kBruteForce}, &truth)
                        .ok());
        EXPECT_EQ(got.lit_bits, truth.lit_bits) << lights.size() << " lights, tile " << tile;
        for (const AnsweredBy by : got.answered_by) ASSERT_NE(by, AnsweredBy::kNoRay);
        for (const uint8_t byte : truth.lit_bits) blocked += byte != 0xFF ? 1 : 0;
        // The root and next to nothing else for all sixteen packets: where each walks it is no
        // node, if nothing is in reach of the tile, or sixteen and more.
        if (lights.size() > 1) continue;
        const bool one =
            got.stats.nodes > 0 && got.stats.nodes < 16 && got.stats.triangle_tests == 0;
        if (tile == 0) {
          EXPECT_FALSE(one);  // Nothing is known of what was before.
        } else if (tile < kTiles - 4) {
          EXPECT_TRUE(one) << "tile " << tile;
        }
        by_one_walk += one;
      }
      EXPECT_GT(blocked, size_t{100});
      if (lights.size() > 1) continue;
      EXPECT_LT(by_one_walk, kTiles - 1);
    }
  }
}

}  // namespace
}  // namespace sightline
