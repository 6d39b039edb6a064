// SPDX-License-Identifier: Apache-2.0
//
// Points on surfaces, put to so many lights that what they lie on is looked for first: every way of
// asking gives the bits of single rays, what lies below a point's horizon takes no walk, and what
// leads up from there does not visit what they lie on.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/query/shadows.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::MakeBox;
using testing_support::MakeIcosphere;
using testing_support::MakeScene;
using testing_support::MakeTerrain;
using testing_support::RandomPlacement;
using testing_support::ScaledCount;
using testing_support::TestRng;

struct SurfacePoints {
  std::vector<Vec3f> positions;
  std::vector<uint32_t> sources;
  std::vector<uint8_t> valid;

  PointRange Slice(size_t first, size_t count) const {
    PointRange range{
        std::span(positions).subspan(first, count), {}, std::span(valid).subspan(first, count)};
    if (!sources.empty()) range.sources = std::span(sources).subspan(first, count);
    return range;
  }
};

// Points `height` above triangles, or, for a share of `astray`, anywhere; neighbours mostly on one
// triangle.
SurfacePoints SomePoints(const SceneGeometry& geometry, size_t count, double height, double astray,
                         bool with_sources, TestRng& rng) {
  SurfacePoints points;
  for (size_t i = 0; i < count; ++i) {
    const auto id = static_cast<uint32_t>(i * geometry.triangles.size() / count);
    const auto [a, b, c] = geometry.Corners(id);
    const Vec3d ad = ToDouble(a), ab = ToDouble(b) - ad, ac = ToDouble(c) - ad;
    const Vec3d normal = Cross(ab, ac);
    const double v = rng.Uniform(0.01, 0.95), w = rng.Uniform(0.01, 0.98 - v);
    Vec3d p = ad + ab * v + ac * w + normal * (height / Length(normal));
    if (rng.Chance(astray)) {
      for (int k = 0; k < 3; ++k) p[k] += rng.Uniform(-2, 2);
    }
    points.positions.push_back(ToFloat(p));
    if (with_sources) points.sources.push_back(rng.Chance(0.8) ? id : kNoTriangle);
    points.valid.push_back(rng.Chance(0.97));
  }
  return points;
}

// `count` points and directions all around; and an area light, which has a walk of its own.
std::vector<LightSample> Lights(uint32_t count, TestRng& rng) {
  std::vector<LightSample> samples;
  const auto add = [&](const Light& light, uint32_t index) {
    EXPECT_TRUE(AppendSamples(light, index, {}, &samples).ok());
  };
  for (uint32_t i = 0; i < count; ++i) {
    Vec3d at;
    for (int k = 0; k < 3; ++k) at[k] = rng.Uniform(-1, 1);
    add(i % 2 == 0 ? Light::Point(at * rng.Uniform(0.5, 30)) : Light::Directional(at), i);
  }
  add({.kind = Light::Kind::kRectangle,
       .position = {1, 9, 2},
       .half_u = {0.5, 0, 0},
       .half_v = {0, 0.2, 0.5},
       .sample_count = 5},
      count);
  return samples;
}

TEST(GroundPointsTest, AllWaysOfAskingGiveTheBitsOfSingleRays) {
  TestRng rng;
  for (int64_t round = 0, n = ScaledCount(6, 3); round < n; ++round) {
    const IndexedGeometry scene = MakeScene({MakeIcosphere(3, 2, RandomPlacement(rng, {0, 0, 0})),
                                             MakeBox({1, 2, 0.5}, RandomPlacement(rng, {3, 1, 0})),
                                             MakeTerrain(16, 8, {-4, -3, -4})});
    const bool with_sources = round % 3 == 2;
    const SurfacePoints points =
        SomePoints(scene.geometry, 9001, /*height=*/rng.Chance(0.5) ? 1e-6 : 1e-3,
                   /*astray=*/round % 2 == 0 ? 0.1 : 0.0, with_sources, rng);
    // With as many, leaves are looked for that are clear of the points.
    const std::vector<LightSample> samples = Lights(round % 2 == 0 ? 14 : 40, rng);
    SCOPED_TRACE(testing::Message() << "round " << round << ", sources " << with_sources);
    const ShadowOutputs outputs{.bits = true, .counts = true, .answered_by = true};
    ShadowResult truth;
    ASSERT_TRUE(ComputeShadows(scene, points.Slice(0, 9001), samples, {}, {}, outputs,
                               {.strategy = Strategy::kSingle}, &truth)
                    .ok());
    for (const Strategy strategy : {Strategy::kAuto, Strategy::kShaft}) {
      ShadowHints hints;
      // At once; then bit by bit, which hands on hints.
      for (const size_t size : {size_t{9001}, size_t{4096}, size_t{999}}) {
        for (size_t first = 0; first < 9001; first += size) {
          const size_t count = std::min(size, 9001 - first);
          ShadowOptions shadow{.ordered = rng.Chance(0.5), .hints = &hints};
          if (first + count < 9001) {
            shadow.next = points.Slice(first + count, std::min(size, 9001 - first - count));
          }
          ShadowResult got;
          ASSERT_TRUE(ComputeShadows(scene, points.Slice(first, count), samples, {}, shadow,
                                     outputs, {.strategy = strategy}, &got)
                          .ok());
          for (size_t s = 0; s < samples.size(); ++s) {
            for (size_t i = 0; i < count; ++i) {
              const auto bit = [s](const ShadowResult& of, size_t points, size_t at) {
                return of.lit_bits[s * ((points + 7) / 8) + at / 8] >> (at % 8) & 1;
              };
              ASSERT_EQ(bit(got, count, i), bit(truth, 9001, first + i))
                  << "sample " << s << ", point " << first + i << ", in parts of " << size;
              ASSERT_EQ(got.answered_by[s * count + i] == AnsweredBy::kNoRay,
                        points.valid[first + i] == 0);
            }
          }
          for (size_t i = 0; i < count; ++i) {
            ASSERT_EQ(got.lit_counts[i], truth.lit_counts[first + i]);
          }
        }
      }
    }
  }
}

// A sun under the horizon of all points takes no walk but the one that finds what they lie on.
TEST(GroundPointsTest, WhatLiesBelowTheHorizonTakesNoWalk) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene({MakeTerrain(12, 8, {-4, -3, -4})});
  SurfacePoints points = SomePoints(scene.geometry, 4096, /*height=*/1e-6, /*astray=*/0,
                                    /*with_sources=*/false, rng);
  std::fill(points.valid.begin(), points.valid.end(), 1);
  std::vector<LightSample> samples;
  const auto nodes = [&] {
    ShadowResult got;
    EXPECT_TRUE(ComputeShadows(scene, points.Slice(0, 4096), samples, {}, {}, {}, {}, &got).ok());
    return got.stats.nodes;
  };
  for (uint32_t i = 0; i < 16; ++i) {
    const Light below = Light::Directional({0.01 * i, 0.1, -1});
    ASSERT_TRUE(AppendSamples(below, i, {}, &samples).ok());
  }
  const uint64_t sixteen = nodes();
  EXPECT_GT(sixteen, 0u);
  for (uint32_t i = 16; i < 64; ++i) {
    const Light below = Light::Point({0.1 * i - 4, -0.1, -20});
    ASSERT_TRUE(AppendSamples(below, i, {}, &samples).ok());
  }
  EXPECT_EQ(nodes(), sixteen);
}

// What leads straight up from gentle hills visits less than half of the leaves that it visits where
// too few lights ask to look for clear ones: what is left lies above points, by its box.
TEST(GroundPointsTest, WhatLeadsUpDoesNotVisitWhatPointsLieOn) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene({MakeTerrain(12, 8, {-4, -3, -4})});
  SurfacePoints points = SomePoints(scene.geometry, 4096, /*height=*/1e-6, /*astray=*/0,
                                    /*with_sources=*/false, rng);
  std::fill(points.valid.begin(), points.valid.end(), 1);
  std::vector<LightSample> samples;
  const auto leaves = [&] {
    ShadowResult got;
    EXPECT_TRUE(ComputeShadows(scene, points.Slice(0, 4096), samples, {}, {}, {},
                               {.strategy = Strategy::kShaft}, &got)
                    .ok());
    return got.stats.leaves;
  };
  const auto add_until = [&](uint32_t count) {
    for (auto i = static_cast<uint32_t>(samples.size()); i < count; ++i) {
      const Light above = i % 2 == 0 ? Light::Directional({1e-3, 1e-4 * i, 1})
                                     : Light::Point({0.1 * i - 4, 1, 1000});
      ASSERT_TRUE(AppendSamples(above, i, {}, &samples).ok());
    }
  };
  uint64_t few[2], many[2];
  for (const int k : {0, 1}) {
    add_until(16 + 8 * k);
    few[k] = leaves();
  }
  for (const int k : {0, 1}) {
    add_until(40 + 64 * k);
    many[k] = leaves();
  }
  EXPECT_GT(few[1], few[0]);
  EXPECT_LT(2 * (many[1] - many[0]), 8 * (few[1] - few[0]));
}

}  // namespace
}  // namespace sightline
