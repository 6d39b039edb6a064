// SPDX-License-Identifier: Apache-2.0
//
// Shadow packets of a tile by the pixels' own squares, and results past the caches: no answer hangs
// on them; what is counted of a tile's points. Tiles in every other way:
// tests/property/strategies_test.cc.
#include "core/query/tiles.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "core/accel/kd_builder.h"
#include "core/base/parallel.h"
#include "core/query/hit_source.h"
#include "core/query/placement.h"
#include "core/query/points.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::AvailableTargets;
using testing_support::MakeScene;
using testing_support::TestRng;

constexpr uint32_t kTileSide = 80;  // More than a group, and no multiple of one.

// A V of half a degree along y, 40 deep, where a float's step is 2^-7: near its bottom no place is
// strictly in front of both walls.
IndexedGeometry MakeGroove() {
  const double x = 1e5, y = 1e5, z = 1e5, half = 40 * std::tan(0.25 * std::numbers::pi / 180);
  return MakeScene({{.vertices = {{x, y - 9, z},
                                  {x, y + 9, z},
                                  {x - half, y + 9, z + 40},
                                  {x - half, y - 9, z + 40},
                                  {x + half, y + 9, z + 40},
                                  {x + half, y - 9, z + 40}},
                     .indices = {0, 1, 2, 0, 2, 3, 1, 0, 5, 1, 5, 4}}});
}

// Small squares above each other, so that pixels that hit something and others lie mixed.
IndexedGeometry MakeConfetti(TestRng& rng) {
  ObjectInput object;
  for (int i = 0; i < 300; ++i) {
    const Vec3d at{rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(0, 2)};
    const auto first = static_cast<uint32_t>(object.vertices.size());
    for (const Vec3d corner : {Vec3d{0, 0, 0}, Vec3d{0.2, 0, 0.1}, Vec3d{0, 0.2, 0}}) {
      object.vertices.push_back(at + corner);
    }
    for (uint32_t k = 0; k < 3; ++k) object.indices.push_back(first + k);
  }
  return MakeScene({object});
}

// The pixels of squares of so many pixels with a hit, those beyond the tile's edge among them.
uint64_t PixelsOfSquaresWithHits(const TileResult& tile, const TileRect& rect, uint32_t side) {
  uint64_t pixels = 0;
  for (uint32_t y = 0; y < rect.height; y += side) {
    for (uint32_t x = 0; x < rect.width; x += side) {
      bool hit = false;
      for (uint32_t i = 0; i < side * side; ++i) {
        const uint32_t px = x + i % side, py = y + i / side;
        hit |= px < rect.width && py < rect.height &&
               tile.triangle[py * rect.width + px] != kNoTriangle;
      }
      if (hit) pixels += uint64_t{side} * side;
    }
  }
  return pixels;
}

TEST(TilesTest, PixelShadowPacketsAreWholeSquaresAndChangeNoAnswer) {
  TestRng rng;
  const IndexedGeometry scene = MakeConfetti(rng);
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.25, kTileSide);
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({1, 0.5, 5}), 0, {}, &samples).ok());
  // A sun's packets are of hits alone.
  ASSERT_TRUE(AppendSamples(Light::Directional({0.3, 0.2, 1}), 1, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Point({-2, 1, 4}), 2, {}, &samples).ok());
  ASSERT_EQ(samples.size(), 3u);
  for (const TileRect rect : {TileRect{0, 0, kTileSide, kTileSide}, TileRect{3, 5, 67, 41}}) {
    for (const int side : kPacketSides) {
      const auto trace = [&](bool by_pixels) {
        TileResult tile;
        const absl::Status status = TraceTile(
            scene, camera, rect, samples,
            {.ids = true, .lit = true, .points = true, .lit_answered_by = true},
            {.strategy = Strategy::kPacket, .packet_side = side, .pixel_shadow_packets = by_pixels},
            &tile);
        EXPECT_TRUE(status.ok()) << status;
        return tile;
      };
      const TileResult hits = trace(false), squares = trace(true);
      EXPECT_EQ(squares.triangle, hits.triangle);
      EXPECT_EQ(squares.lit_bits, hits.lit_bits);
      EXPECT_EQ(squares.lit_answered_by, hits.lit_answered_by);
      EXPECT_EQ(squares.point_pixel, hits.point_pixel);
      EXPECT_EQ(squares.points.positions, hits.points.positions);
      EXPECT_EQ(squares.points.sources, hits.points.sources);
      EXPECT_EQ(squares.points.valid, hits.points.valid);
      const uint64_t pixels = PixelsOfSquaresWithHits(hits, rect, static_cast<uint32_t>(side));
      ASSERT_GT(pixels, hits.point_pixel.size()) << "every pixel hits";
      EXPECT_EQ(hits.shadow.rays, samples.size() * hits.point_pixel.size());
      EXPECT_EQ(squares.shadow.rays, 2 * pixels + hits.point_pixel.size()) << "side " << side;
    }
  }
}

// Whole blocks and what is left over, where rows begin on lines of memory and where they do not.
TEST(TilesTest, ResultsPastTheCachesAreTheSame) {
  TestRng rng;
  const IndexedGeometry scene = MakeConfetti(rng);
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.25, kTileSide);
  for (const SimdTarget simd : AvailableTargets()) {
    for (const TileRect rect : {TileRect{0, 0, 80, 72}, TileRect{3, 5, 64, 41},
                                TileRect{1, 2, 61, 64}, TileRect{0, 0, kTileSide, kTileSide}}) {
      for (const Strategy strategy : {Strategy::kAuto, Strategy::kPacket}) {
        TileOutputs outputs = {.hits = false, .ids = true, .depth = true, .uv = true};
        TileResult usual, past;
        const QueryOptions options = {.strategy = strategy, .simd = simd};
        ASSERT_TRUE(TraceTile(scene, camera, rect, {}, outputs, options, &usual).ok());
        outputs.past_caches = true;
        ASSERT_TRUE(TraceTile(scene, camera, rect, {}, outputs, options, &past).ok());
        EXPECT_EQ(past.triangle, usual.triangle);
        EXPECT_EQ(past.depth, usual.depth);
        EXPECT_EQ(past.u, usual.u);
        EXPECT_EQ(past.v, usual.v);
      }
    }
  }
}

// Other strategies have no packets.
// Hits that are placed, but not on the right side of all they touch, are counted as those of points
// that come without a camera (points.h), however they were traced and the picture was cut.
TEST(TilesTest, PointsThatCannotBeClearedAreCounted) {
  IndexedGeometry scene = MakeGroove();
  ThreadPool pool(1);
  scene.kd_tree = *BuildKdTree(scene.geometry, {}, pool);
  const Camera camera = testing_support::LookingDown({1e5, 1e5, 1e5 + 90}, 0x1p-9, kTileSide);
  const TileOutputs outputs = {.ids = true, .depth = true, .points = true};
  TileResult whole;
  ASSERT_TRUE(TraceTile(scene, camera, {0, 0, kTileSide, kTileSide}, {}, outputs, {}, &whole).ok());
  uint64_t hits = 0, expected = 0;
  const Vec3f eye = ToFloat(camera.eye);
  for (uint32_t i = 0; i < kTileSide * kTileSide; ++i) {
    const uint32_t triangle = whole.triangle[i];
    if (triangle == kNoTriangle) continue;
    ++hits;
    const HitSource source(scene, eye, triangle);
    const Placement placement = source.PlacementOf(
        eye, PixelDirection(camera, i % kTileSide, i / kTileSide), whole.depth[i]);
    std::vector<uint32_t> touched;
    FindTouching(scene, placement.at, placement.radius, triangle, &touched);
    expected += !PlaceTouching(scene, placement, source.plane, touched).clear;
  }
  EXPECT_GT(expected, 100u);
  EXPECT_LT(expected, hits);
  std::vector<Vec3d> placed;
  for (const Vec3f p : whole.points.positions) placed.push_back(ToDouble(p));
  const auto prepared = PreparePoints(scene, {placed, {}, whole.points.sources}, {});
  ASSERT_TRUE(prepared.ok()) << prepared.status();
  EXPECT_GT(prepared->near_surface, 100u);
  for (const Strategy strategy : {Strategy::kAuto, Strategy::kSingle, Strategy::kPacket,
                                  Strategy::kShaft, Strategy::kRtt, Strategy::kBruteForce}) {
    for (const uint32_t side : {kTileSide, 23u}) {
      SCOPED_TRACE(std::string(StrategyName(strategy)) + ", " + std::to_string(side));
      uint64_t attached = 0, near_surface = 0;
      for (uint32_t y = 0; y < kTileSide; y += side) {
        for (uint32_t x = 0; x < kTileSide; x += side) {
          const TileRect rect = {x, y, std::min(side, kTileSide - x),
                                 std::min(side, kTileSide - y)};
          TileResult tile;
          QueryOptions options{.strategy = strategy, .rtt_antialiasing = 3};
          ASSERT_TRUE(TraceTile(scene, camera, rect, {}, outputs, options, &tile).ok());
          EXPECT_EQ(tile.points.attached, tile.points.size());
          attached += tile.points.attached;
          near_surface += tile.points.near_surface;
        }
      }
      EXPECT_EQ(attached, hits);
      EXPECT_EQ(near_surface, expected);
    }
  }
}

TEST(TilesTest, PixelShadowPacketsArePacketsOption) {
  TestRng rng;
  const IndexedGeometry scene = MakeConfetti(rng);
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.25, kTileSide);
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({1, 0.5, 5}), 0, {}, &samples).ok());
  for (const Strategy strategy : {Strategy::kAuto, Strategy::kSingle, Strategy::kShaft}) {
    TileResult tile;
    ASSERT_TRUE(TraceTile(scene, camera, {0, 0, kTileSide, kTileSide}, samples,
                          {.ids = true, .lit = true},
                          {.strategy = strategy, .pixel_shadow_packets = true}, &tile)
                    .ok());
    uint64_t hits = 0;
    for (const uint32_t id : tile.triangle) hits += id != kNoTriangle;
    EXPECT_EQ(tile.shadow.rays, hits);
  }
}

TEST(TilesTest, ATileOfMorePixelsThanHaveNumbersIsRefused) {
  TestRng rng(7);
  const IndexedGeometry scene = MakeConfetti(rng);
  const Camera camera = *LookAt({0, 0, 9}, {0, 0, 0}, {0, 1, 0}, 40, 1 << 16, 1 << 16);
  TileResult result;
  const absl::Status status =
      TraceTile(scene, camera, {0, 0, 1 << 16, 1 << 16}, {}, {}, {}, &result);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(status.message().find("tile.height = 65536"), std::string::npos) << status;
}

}  // namespace
}  // namespace sightline
