// SPDX-License-Identifier: Apache-2.0
//
// What tiles a picture has for relevant triangles tracing (paper 002, section 3): those of its own
// grid, whole wherever the picture has them whole, whatever else it is cut into on the way; and
// what tiles its lights have: those of its pixels' hits, and of points that follow one another.
#include <algorithm>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

#include "core/light/light.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using testing_support::MakeIcosphere;
using testing_support::MakeScene;
using testing_support::MakeTerrain;
using testing_support::OnKdTreeAlone;

constexpr uint32_t kRttSide = 256;

TileResult Trace(const IndexedGeometry& scene, const TileRect& rect, const QueryOptions& options,
                 const TileOutputs& outputs, std::span<const LightSample> samples = {}) {
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.4, kRttSide);
  TileResult result;
  const absl::Status status = TraceTile(scene, camera, rect, samples, outputs, options, &result);
  EXPECT_TRUE(status.ok()) << status;
  return result;
}

// In the picture's upper left corner.
TileResult Trace(const IndexedGeometry& scene, uint32_t width, uint32_t height,
                 const QueryOptions& options, const TileOutputs& outputs,
                 std::span<const LightSample> samples = {}) {
  return Trace(scene, {3, 5, width, height}, options, outputs, samples);
}

// All rays of which something is said.
uint64_t Sum(const QueryStats& stats) {
  return std::accumulate(stats.answered_by.begin(), stats.answered_by.end(), uint64_t{0});
}

TEST(RttTilesTest, APictureHasTheTilesOfItsGrid) {
  const IndexedGeometry scene = OnKdTreeAlone(
      MakeScene({MakeTerrain(12, 8, {-4, -4, -1}), MakeIcosphere(2, 1.5, Affine3d())}), {});
  for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
    for (const auto& [width, height] :
         {std::pair(240u, 120u), {128u, 64u}, {130u, 67u}, {61u, 50u}, {24u, 3u}, {1u, 9u}}) {
      SCOPED_TRACE(testing::Message() << width << "x" << height << ", n = " << n);
      const TileOutputs outputs = {.hits = true, .ids = true, .depth = true, .uv = true};
      const TileResult tile = Trace(
          scene, width, height,
          {.strategy = Strategy::kRtt, .rtt_antialiasing = n, .count_answers = true}, outputs);
      const uint32_t side = 4 * static_cast<uint32_t>(n);
      EXPECT_EQ(tile.primary.tiles,
                uint64_t{(width + side - 1) / side} * ((height + side - 1) / side));
      // Cut squares are filled up with rays that nobody asked about.
      EXPECT_EQ(tile.primary.rays, uint64_t{width} * height);
      EXPECT_EQ(Sum(tile.primary), uint64_t{width} * height);
      const TileResult truth =
          Trace(scene, width, height, {.strategy = Strategy::kBruteForce}, outputs);
      EXPECT_EQ(tile.hit_bits, truth.hit_bits);
      for (uint32_t i = 0; i < width * height; ++i) {
        ASSERT_EQ(tile.triangle[i], truth.triangle[i]) << i;
        ASSERT_EQ(tile.depth[i], truth.depth[i]) << i;
        ASSERT_EQ(tile.u[i], truth.u[i]) << i;
        ASSERT_EQ(tile.v[i], truth.v[i]) << i;
      }
    }
  }
}

// A picture whose sides four does not divide: before its last column of squares was filled up, its
// tiles ran on into the next row, across a whole block.
TEST(RttTilesTest, TilesAtTheBorderAreAsNarrowAsElsewhere) {
  const IndexedGeometry scene = OnKdTreeAlone(MakeScene({MakeTerrain(4, 8, {-4, -4, -1})}), {});
  const TileOutputs outputs = {.ids = true};
  const QueryStats whole = Trace(scene, 16, 16, {.strategy = Strategy::kRtt}, outputs).primary;
  ASSERT_EQ(whole.tiles_answered, 16u);
  for (uint32_t side = 13; side < 16; ++side) {
    const QueryStats cut = Trace(scene, side, side, {.strategy = Strategy::kRtt}, outputs).primary;
    EXPECT_EQ(cut.tiles_answered, 16u) << side;
    EXPECT_LE(cut.relevant_triangles, whole.relevant_triangles) << side;
  }
}

std::vector<LightSample> Lights() {
  std::vector<LightSample> samples;
  uint32_t light = 0;
  for (const Vec3d at : {Vec3d{3, -2, 6}, Vec3d{-1, 1, 4}}) {
    EXPECT_TRUE(AppendSamples(Light::Point(at), light++, {}, &samples).ok());
  }
  return samples;
}

// Balls over a strip of ground: tiles that hit nothing, some that do in part, and shadows.
IndexedGeometry MakeStrip(int cells) {
  const auto at = [](Vec3d p) { return Affine3d{{1, 0, 0, p.x, 0, 1, 0, p.y, 0, 0, 1, p.z}}; };
  ObjectInput small = MakeIcosphere(1, 0.3, at({-2.4, 1, 1}));
  small.name = "small sphere";
  return OnKdTreeAlone(MakeScene({MakeTerrain(cells, 5, {-3.5, -1.4, -1}),
                                  MakeIcosphere(2, 0.4, at({-1.5, 0.3, 0.5})), small}),
                       {});
}

// Paper 002, section 3.2: a tile's shadows are those of its pixels' hits, whichever of its pixels
// hit nothing, whatever stands in the tiles beside it.
TEST(RttTilesTest, LightsHaveTheTilesOfTheirPixels) {
  const IndexedGeometry scene = MakeStrip(12);
  const std::vector<LightSample> samples = Lights();
  const TileOutputs outputs = {.hits = true, .lit = true, .lit_answered_by = true};
  for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
    for (const auto& [width, height] :
         {std::pair(240u, 240u), {128u, 64u}, {130u, 67u}, {61u, 50u}, {24u, 3u}, {1u, 9u}}) {
      SCOPED_TRACE(testing::Message() << width << "x" << height << ", n = " << n);
      const TileResult tile =
          Trace(scene, width, height,
                {.strategy = Strategy::kRtt, .rtt_antialiasing = n, .count_answers = true}, outputs,
                samples);
      const TileResult truth =
          Trace(scene, width, height, {.strategy = Strategy::kBruteForce}, outputs, samples);
      EXPECT_EQ(tile.hit_bits, truth.hit_bits);
      EXPECT_EQ(tile.lit_bits, truth.lit_bits);
      // Of the grid's tiles, those that hit something.
      const uint32_t side = 4 * static_cast<uint32_t>(n);
      const uint32_t across = (width + side - 1) / side, down = (height + side - 1) / side;
      std::vector<bool> hit(size_t{across} * down);
      uint64_t hits = 0;
      for (uint32_t i = 0; i < width * height; ++i) {
        if ((truth.hit_bits[i / 8] >> (i % 8) & 1) == 0) continue;
        hit[i / width / side * across + i % width / side] = true;
        ++hits;
      }
      const auto tiles = static_cast<uint64_t>(std::count(hit.begin(), hit.end(), true));
      EXPECT_EQ(tile.shadow.tiles, tiles * samples.size());
      EXPECT_EQ(tile.shadow.rays, hits * samples.size());
      EXPECT_EQ(Sum(tile.shadow), hits * samples.size());
      for (size_t i = 0; i < samples.size() * width * height; ++i) {
        const size_t pixel = i % (width * height);
        ASSERT_EQ(tile.lit_answered_by[i] != AnsweredBy::kNoRay,
                  (truth.hit_bits[pixel / 8] >> (pixel % 8) & 1) != 0)
            << i;
      }
      if (width < 240) continue;
      EXPECT_GT(tiles, 0u);
      EXPECT_LT(tiles, size_t{across} * down);  // Some hit nothing,
      EXPECT_LT(hits, tiles * side * side);     // and some in part.
      EXPECT_GT(tile.shadow.tiles_answered, 0u);
    }
  }
}

// A tile's rays, and none beside them, say what becomes of it and of its lights: it fares in a
// picture as it does alone.
TEST(RttTilesTest, TilesOfAPictureFareAsTheyDoAlone) {
  const IndexedGeometry scene = MakeStrip(2);
  const std::vector<LightSample> samples = Lights();
  constexpr TileRect kPicture = {3, 21, 210, 217};
  for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
    SCOPED_TRACE(n);
    const QueryOptions options = {.strategy = Strategy::kRtt, .rtt_antialiasing = n};
    const TileOutputs outputs = {.hits = true, .lit = true};
    const TileResult picture = Trace(scene, kPicture, options, outputs, samples);
    QueryStats primary, shadow;
    const uint32_t side = 4 * static_cast<uint32_t>(n);
    for (uint32_t y = 0; y < kPicture.height; y += side) {
      for (uint32_t x = 0; x < kPicture.width; x += side) {
        const TileRect alone = {kPicture.x + x, kPicture.y + y, std::min(side, kPicture.width - x),
                                std::min(side, kPicture.height - y)};
        const TileResult tile = Trace(scene, alone, options, outputs, samples);
        primary.Add(tile.primary);
        shadow.Add(tile.shadow);
      }
    }
    for (const auto& [together, apart] :
         {std::pair(picture.primary, primary), {picture.shadow, shadow}}) {
      EXPECT_GT(apart.tiles_answered, 0u);
      EXPECT_LT(apart.tiles_answered, apart.tiles);
      EXPECT_EQ(together.tiles, apart.tiles);
      EXPECT_EQ(together.tiles_answered, apart.tiles_answered);
      EXPECT_EQ(together.relevant_triangles, apart.relevant_triangles);
      EXPECT_EQ(together.rays, apart.rays);
    }
  }
}

// Points that nobody has put to pixels are tiles as they follow one another; where a group of them
// ends is no matter.
TEST(RttTilesTest, PointsThatFollowOneAnotherAreTiles) {
  const IndexedGeometry scene = MakeStrip(12);
  const std::vector<LightSample> samples = Lights();
  TileResult seen = Trace(scene, 200, 200, {}, {.points = true});
  for (const bool some_invalid : {false, true}) {
    PreparedPoints& points = seen.points;
    ASSERT_GT(points.size(), size_t{3} * 4096);
    if (some_invalid) {
      for (size_t i = 0; i < points.size(); i += 7) points.valid[i] = 0;
    }
    const auto valid =
        static_cast<size_t>(std::count(points.valid.begin(), points.valid.end(), uint8_t{1}));
    const auto shade = [&](const QueryOptions& options) {
      ShadowResult result;
      const absl::Status status =
          ComputeShadows(scene, PointRange::All(points), samples, {}, {.ordered = true},
                         {.bits = true, .blockers = true, .answered_by = true}, options, &result);
      EXPECT_TRUE(status.ok()) << status;
      return result;
    };
    const ShadowResult truth = shade({.strategy = Strategy::kBruteForce});
    for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
      SCOPED_TRACE(n);
      const ShadowResult result =
          shade({.strategy = Strategy::kRtt, .rtt_antialiasing = n, .count_answers = true});
      EXPECT_EQ(result.lit_bits, truth.lit_bits);
      EXPECT_EQ(result.blocker, truth.blocker);
      EXPECT_EQ(result.blocker_t, truth.blocker_t);
      const auto tile = static_cast<size_t>(RttTileRays(n));
      EXPECT_EQ(result.stats.tiles, (valid + tile - 1) / tile * samples.size());
      EXPECT_EQ(result.stats.rays, valid * samples.size());
      EXPECT_EQ(Sum(result.stats), valid * samples.size());
      for (size_t i = 0; i < samples.size() * points.size(); ++i) {
        ASSERT_EQ(result.answered_by[i] != AnsweredBy::kNoRay, points.valid[i % points.size()] != 0)
            << i;
      }
    }
  }
}

}  // namespace
}  // namespace sightline
