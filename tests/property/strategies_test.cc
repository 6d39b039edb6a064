// SPDX-License-Identifier: Apache-2.0
//
// One answer, bit for bit: tiles, shadows and segments by every strategy, instruction set, tile
// size, partition and number of threads give what brute force gives over the whole at once.
#include <algorithm>
#include <bit>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "core/base/parallel.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AllWays;
using testing_support::Bit;
using testing_support::InTurn;
using testing_support::MakeBuiltinQueryScenes;
using testing_support::MakeNastyQueryScenes;
using testing_support::MakePoints;
using testing_support::MakeSamples;
using testing_support::MakeSegments;
using testing_support::QueryScene;
using testing_support::Rebuilt;
using testing_support::SameBytes;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::Way;

constexpr TileOutputs kAllOutputs = {
    .hits = true, .ids = true, .depth = true, .uv = true, .lit = true, .points = true};

// A whole image as one result; tiles of w × h, traced by `pool`, are put together into it.
TileResult TraceImage(const IndexedGeometry& scene, const Camera& camera,
                      std::span<const LightSample> samples, const TileOutputs& outputs,
                      const QueryOptions& options, uint32_t w, uint32_t h, ThreadPool& pool) {
  std::vector<TileRect> tiles;
  for (uint32_t y = 0; y < camera.height; y += h) {
    for (uint32_t x = 0; x < camera.width; x += w) {
      tiles.push_back({x, y, std::min(w, camera.width - x), std::min(h, camera.height - y)});
    }
  }
  std::vector<TileResult> parts(tiles.size());
  std::vector<absl::Status> statuses(tiles.size());
  pool.ParallelFor(tiles.size(), 1, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      statuses[i] = TraceTile(scene, camera, tiles[i], samples, outputs, options, &parts[i]);
    }
  });
  const size_t n = size_t{camera.width} * camera.height, row = (n + 7) / 8;
  TileResult all;
  if (outputs.hits) all.hit_bits.assign(row, 0);
  if (outputs.ids) all.triangle.resize(n, 0);
  if (outputs.depth) all.depth.resize(n, 0);
  if (outputs.uv) all.u.resize(n, 0);
  if (outputs.uv) all.v.resize(n, 0);
  if (outputs.lit) all.lit_bits.assign(samples.size() * row, 0);
  std::vector<size_t> point_of(n, n);  // Into a list of (tile, index).
  std::vector<std::pair<size_t, size_t>> points;
  for (size_t t = 0; t < tiles.size(); ++t) {
    EXPECT_TRUE(statuses[t].ok()) << statuses[t];
    if (!statuses[t].ok()) return {};
    const TileRect& tile = tiles[t];
    const TileResult& part = parts[t];
    const size_t tile_n = size_t{tile.width} * tile.height, tile_row = (tile_n + 7) / 8;
    const auto whole = [&](size_t i) {
      return (tile.y + i / tile.width) * camera.width + tile.x + i % tile.width;
    };
    for (size_t i = 0; i < tile_n; ++i) {
      const size_t p = whole(i);
      if (outputs.hits) all.hit_bits[p / 8] |= uint8_t(Bit(part.hit_bits, i) << (p % 8));
      if (outputs.ids) all.triangle[p] = part.triangle[i];
      if (outputs.depth) all.depth[p] = part.depth[i];
      if (outputs.uv) all.u[p] = part.u[i];
      if (outputs.uv) all.v[p] = part.v[i];
      for (size_t s = 0; outputs.lit && s < samples.size(); ++s) {
        const bool lit = part.lit_bits[s * tile_row + i / 8] >> (i % 8) & 1;
        all.lit_bits[s * row + p / 8] |= uint8_t(lit << (p % 8));
      }
    }
    for (size_t i = 0; i < part.point_pixel.size(); ++i) {
      point_of[whole(part.point_pixel[i])] = points.size();
      points.emplace_back(t, i);
    }
  }
  for (size_t p = 0; p < n; ++p) {
    if (point_of[p] == n) continue;
    const auto [t, i] = points[point_of[p]];
    all.point_pixel.push_back(static_cast<uint32_t>(p));
    all.points.positions.push_back(parts[t].points.positions[i]);
    all.points.sources.push_back(parts[t].points.sources[i]);
    all.points.valid.push_back(parts[t].points.valid[i]);
  }
  return all;
}

void ExpectSameTiles(const TileResult& a, const TileResult& b) {
  EXPECT_TRUE(SameBytes(a.hit_bits, b.hit_bits)) << "hits";
  EXPECT_TRUE(SameBytes(a.triangle, b.triangle)) << "ids";
  EXPECT_TRUE(SameBytes(a.depth, b.depth)) << "depth";
  EXPECT_TRUE(SameBytes(a.u, b.u)) << "u";
  EXPECT_TRUE(SameBytes(a.v, b.v)) << "v";
  EXPECT_TRUE(SameBytes(a.lit_bits, b.lit_bits)) << "lit";
  EXPECT_TRUE(SameBytes(a.point_pixel, b.point_pixel)) << "pixels of points";
  EXPECT_TRUE(SameBytes(a.points.positions, b.points.positions)) << "points";
  EXPECT_TRUE(SameBytes(a.points.sources, b.points.sources)) << "sources of points";
  EXPECT_TRUE(SameBytes(a.points.valid, b.points.valid)) << "validity of points";
}

void CheckTiles(const QueryScene& scene, TestRng& rng) {
  SCOPED_TRACE(scene.name);
  ThreadPool one(1), three(3);
  const std::vector<LightSample> samples = MakeSamples(scene.indexed, rng);
  constexpr uint32_t kSides[][2] = {{16, 16}, {45, 27}, {7, 5}, {1, 27}, {13, 3}, {32, 17}};
  int way_index = 0;
  for (const Camera& camera : scene.cameras) {
    const uint32_t mask = rng.Chance(0.7) ? 0xFFFFFFFFu : 1u;
    const TileResult truth =
        TraceImage(scene.indexed, camera, samples, kAllOutputs, AllWays().front().Options(mask),
                   camera.width, camera.height, one);
    size_t hits = 0;
    for (const uint32_t id : truth.triangle) hits += id != kNoTriangle;
    ASSERT_EQ(truth.point_pixel.size(), hits);
    for (const Way& way : InTurn(AllWays(scene.indexed.kd_tree.has_value()), rng)) {
      const auto [w, h] = kSides[way_index++ % std::size(kSides)];
      SCOPED_TRACE(way.Name() + ", tiles of " + std::to_string(w) + " x " + std::to_string(h));
      const QueryOptions options = way.Options(mask);
      ThreadPool& pool = way_index % 2 == 0 ? one : three;
      ExpectSameTiles(TraceImage(scene.indexed, camera, samples, kAllOutputs, options, w, h, pool),
                      truth);
      // Hits alone are answered by any hit.
      const TileResult hits_only =
          TraceImage(scene.indexed, camera, {}, {.hits = true}, options, w, h, pool);
      EXPECT_TRUE(SameBytes(hits_only.hit_bits, truth.hit_bits)) << "any hit against first hit";
      if (testing::Test::HasFailure()) return;
    }
  }
}

TEST(StrategiesTest, TilesOfNastyScenesAreBruteForces) {
  TestRng rng;
  for (const QueryScene& scene : MakeNastyQueryScenes(rng)) CheckTiles(scene, rng);
}

TEST(StrategiesTest, TilesOfBuiltinScenesAreBruteForces) {
  TestRng rng;
  for (const QueryScene& scene : MakeBuiltinQueryScenes()) CheckTiles(scene, rng);
}

// Points cut into ranges of `range`, each computed by itself, put together again.
ShadowResult Shade(const IndexedGeometry& scene, const PreparedPoints& points,
                   std::span<const LightSample> samples, std::span<const double> weights,
                   const ShadowOptions& shadow, const ShadowOutputs& outputs,
                   const QueryOptions& options, size_t range, ThreadPool& pool) {
  const size_t n = points.size(), row = (n + 7) / 8, parts = (n + range - 1) / range;
  std::vector<ShadowResult> results(parts);
  std::vector<absl::Status> statuses(parts);
  pool.ParallelFor(parts, 1, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const size_t first = i * range;
      statuses[i] =
          ComputeShadows(scene, PointRange::Slice(points, first, std::min(range, n - first)),
                         samples, outputs.weighted_sums ? weights : std::span<const double>(),
                         shadow, outputs, options, &results[i]);
    }
  });
  ShadowResult all;
  if (outputs.bits) all.lit_bits.assign(samples.size() * row, 0);
  if (outputs.blockers) {
    all.blocker.assign(samples.size() * n, 0);
    all.blocker_t.assign(samples.size() * n, 0);
  }
  for (size_t i = 0; i < parts; ++i) {
    EXPECT_TRUE(statuses[i].ok()) << statuses[i];
    if (!statuses[i].ok()) return {};
    const ShadowResult& part = results[i];
    const size_t first = i * range, count = std::min(range, n - first), part_row = (count + 7) / 8;
    all.lit_counts.insert(all.lit_counts.end(), part.lit_counts.begin(), part.lit_counts.end());
    all.weighted_sums.insert(all.weighted_sums.end(), part.weighted_sums.begin(),
                             part.weighted_sums.end());
    for (size_t s = 0; s < samples.size(); ++s) {
      for (size_t k = 0; k < count; ++k) {
        const size_t p = first + k;
        if (outputs.bits) {
          const bool lit = part.lit_bits[s * part_row + k / 8] >> (k % 8) & 1;
          all.lit_bits[s * row + p / 8] |= uint8_t(lit << (p % 8));
        }
        if (outputs.blockers) {
          all.blocker[s * n + p] = part.blocker[s * count + k];
          all.blocker_t[s * n + p] = part.blocker_t[s * count + k];
        }
      }
    }
  }
  return all;
}

void CheckShadows(const QueryScene& scene, TestRng& rng, size_t count) {
  SCOPED_TRACE(scene.name);
  ThreadPool one(1), three(3);
  const PreparedPoints points = MakePoints(scene.indexed, rng, count);
  const std::vector<LightSample> samples = MakeSamples(scene.indexed, rng);
  std::vector<double> weights;
  for (size_t s = 0; s < samples.size(); ++s) weights.push_back(rng.Uniform(-1, 3));
  const ShadowOptions shadow{.t_min = rng.Chance(0.7) ? 0 : 0x1p-10};
  constexpr ShadowOutputs kAll = {
      .bits = true, .counts = true, .weighted_sums = true, .blockers = true};
  const ShadowResult truth = Shade(scene.indexed, points, samples, weights, shadow, kAll,
                                   AllWays().front().Options(), count, one);
  // The reductions are those of the bits, in sample order.
  const size_t row = (count + 7) / 8;
  for (size_t p = 0; p < count; ++p) {
    uint32_t lit = 0;
    double sum = 0;
    for (size_t s = 0; s < samples.size(); ++s) {
      const bool bit = truth.lit_bits[s * row + p / 8] >> (p % 8) & 1;
      ASSERT_EQ(bit,
                points.valid[p] && samples[s].valid && truth.blocker[s * count + p] == kNoTriangle)
          << "any hit against first hit, point " << p << ", sample " << s;
      lit += bit;
      if (bit) sum += weights[s];
    }
    ASSERT_EQ(truth.lit_counts[p], lit);
    ASSERT_EQ(truth.weighted_sums[p], sum);
  }
  constexpr size_t kRanges[] = {1000, 256, 3, 255, 64, 17, 257, 1};
  int way_index = 0;
  for (const Way& way : InTurn(AllWays(scene.indexed.kd_tree.has_value()), rng)) {
    const size_t range = kRanges[way_index++ % std::size(kRanges)];
    SCOPED_TRACE(way.Name() + ", ranges of " + std::to_string(range));
    ThreadPool& pool = way_index % 2 == 0 ? one : three;
    const ShadowResult full =
        Shade(scene.indexed, points, samples, weights, shadow, kAll, way.Options(), range, pool);
    EXPECT_TRUE(SameBytes(full.lit_bits, truth.lit_bits));
    EXPECT_TRUE(SameBytes(full.lit_counts, truth.lit_counts));
    EXPECT_TRUE(SameBytes(full.weighted_sums, truth.weighted_sums));
    EXPECT_TRUE(SameBytes(full.blocker, truth.blocker));
    EXPECT_TRUE(SameBytes(full.blocker_t, truth.blocker_t));
    // Bits alone come from any hit.
    const ShadowResult bits = Shade(scene.indexed, points, samples, weights, shadow, {.bits = true},
                                    way.Options(), range, pool);
    EXPECT_TRUE(SameBytes(bits.lit_bits, truth.lit_bits)) << "any hit against first hit";
    if (testing::Test::HasFailure()) return;
  }
}

TEST(StrategiesTest, ShadowsOfNastyScenesAreBruteForces) {
  TestRng rng;
  for (const QueryScene& scene : MakeNastyQueryScenes(rng)) {
    CheckShadows(scene, rng, static_cast<size_t>(ScaledCount(700, 4)));
  }
}

TEST(StrategiesTest, ShadowsOfBuiltinScenesAreBruteForces) {
  TestRng rng;
  for (const QueryScene& scene : MakeBuiltinQueryScenes()) {
    CheckShadows(scene, rng, static_cast<size_t>(ScaledCount(600, 8)));
  }
}

void CheckSegments(const QueryScene& scene, TestRng& rng, size_t count) {
  SCOPED_TRACE(scene.name);
  const PreparedSegments segments = MakeSegments(scene.indexed, rng, count);
  SegmentResult truth;
  ASSERT_TRUE(TestSegments(scene.indexed, segments, {.bits = true, .first_hits = true},
                           AllWays().front().Options(), &truth)
                  .ok());
  for (size_t i = 0; i < count; ++i) {
    ASSERT_EQ(Bit(truth.blocked_bits, i), truth.triangle[i] != kNoTriangle);
    if (!segments.valid[i]) {
      ASSERT_EQ(truth.triangle[i], kNoTriangle);
    }
    if (truth.triangle[i] != kNoTriangle) {
      ASSERT_GE(truth.t[i], 0);
      ASSERT_LE(truth.t[i], 1);
    }
  }
  for (const Way& way : InTurn(AllWays(scene.indexed.kd_tree.has_value()), rng)) {
    SCOPED_TRACE(way.Name());
    SegmentResult full, bits;
    ASSERT_TRUE(TestSegments(scene.indexed, segments, {.bits = true, .first_hits = true},
                             way.Options(), &full)
                    .ok());
    ASSERT_TRUE(TestSegments(scene.indexed, segments, {.bits = true}, way.Options(), &bits).ok());
    EXPECT_TRUE(SameBytes(full.blocked_bits, truth.blocked_bits));
    EXPECT_TRUE(SameBytes(full.triangle, truth.triangle));
    EXPECT_TRUE(SameBytes(full.t, truth.t));
    EXPECT_TRUE(SameBytes(bits.blocked_bits, truth.blocked_bits)) << "any hit against first hit";
    // Turned around, nothing changes where sides do not count.
    if (!std::any_of(scene.indexed.geometry.objects.begin(), scene.indexed.geometry.objects.end(),
                     [](const ObjectRecord& o) { return o.culling != Culling::kNone; })) {
      PreparedSegments turned = segments;
      std::swap(turned.from, turned.to);
      std::swap(turned.from_source, turned.to_source);
      SegmentResult back;
      ASSERT_TRUE(TestSegments(scene.indexed, turned, {.bits = true}, way.Options(), &back).ok());
      EXPECT_TRUE(SameBytes(back.blocked_bits, truth.blocked_bits)) << "ends swapped";
    }
    // One at a time.
    for (size_t i = 0; i < count; i += 37) {
      const PreparedSegments alone{.from = {segments.from[i]},
                                   .to = {segments.to[i]},
                                   .from_source = {segments.from_source[i]},
                                   .to_source = {segments.to_source[i]},
                                   .valid = {segments.valid[i]}};
      SegmentResult result;
      ASSERT_TRUE(TestSegments(scene.indexed, alone, {.bits = true, .first_hits = true},
                               way.Options(), &result)
                      .ok());
      EXPECT_EQ(result.triangle[0], truth.triangle[i]) << i;
      EXPECT_EQ(std::bit_cast<uint32_t>(result.t[0]), std::bit_cast<uint32_t>(truth.t[i])) << i;
    }
    if (testing::Test::HasFailure()) return;
  }
}

TEST(StrategiesTest, SegmentsInNastyScenesAreBruteForces) {
  TestRng rng;
  for (const QueryScene& scene : MakeNastyQueryScenes(rng)) {
    CheckSegments(scene, rng, static_cast<size_t>(ScaledCount(3000, 20)));
  }
}

TEST(StrategiesTest, SegmentsInBuiltinScenesAreBruteForces) {
  TestRng rng;
  for (const QueryScene& scene : MakeBuiltinQueryScenes()) {
    CheckSegments(scene, rng, static_cast<size_t>(ScaledCount(2000, 20)));
  }
}

// Trees of the other presets, and leaves that are fetched: what is asked above is the default's.
class PresetsTest : public ::testing::TestWithParam<BvhPreset> {};

TEST_P(PresetsTest, AnswersAreBruteForces) {
  TestRng rng;
  std::vector<QueryScene> scenes = Rebuilt(MakeNastyQueryScenes(rng), GetParam());
  for (QueryScene& scene : Rebuilt(MakeBuiltinQueryScenes(), GetParam())) {
    scenes.push_back(std::move(scene));
  }
  for (const QueryScene& scene : scenes) {
    CheckTiles(scene, rng);
    CheckShadows(scene, rng, static_cast<size_t>(ScaledCount(200, 8)));
    CheckSegments(scene, rng, static_cast<size_t>(ScaledCount(500, 20)));
  }
}

// Deep, shallow and perfect kd-trees.
TEST(KdTreesTest, AnswersAreBruteForces) {
  const KdBuildOptions kBuilds[] = {
      {.traversal_cost = 0.01f, .max_depth = 62, .max_references = 64},
      {.traversal_cost = 10, .min_leaf_triangles = 40},
      {.traversal_cost = 0.3f, .perfect_splits = true}};
  TestRng rng;
  int build = 0;
  std::vector<QueryScene> scenes = MakeNastyQueryScenes(rng);
  for (QueryScene& scene : MakeBuiltinQueryScenes()) scenes.push_back(std::move(scene));
  for (QueryScene& scene : scenes) {
    std::vector<QueryScene> one;
    one.push_back(std::move(scene));
    for (const QueryScene& rebuilt :
         Rebuilt(std::move(one), kBuilds[build++ % std::size(kBuilds)])) {
      CheckTiles(rebuilt, rng);
      CheckShadows(rebuilt, rng, static_cast<size_t>(ScaledCount(200, 8)));
      CheckSegments(rebuilt, rng, static_cast<size_t>(ScaledCount(300, 20)));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Presets, PresetsTest,
                         ::testing::Values(BvhPreset::kDynamic, BvhPreset::kCompact),
                         [](const auto& info) {
                           return info.param == BvhPreset::kDynamic ? "Dynamic" : "Compact";
                         });

}  // namespace
}  // namespace sightline
