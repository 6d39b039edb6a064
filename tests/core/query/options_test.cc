// SPDX-License-Identifier: Apache-2.0
#include "core/query/options.h"

#include <numeric>
#include <string>
#include <vector>

#include "core/accel/kd_builder.h"
#include "core/light/light.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::MakeScene;

IndexedGeometry Terrain() { return MakeScene({testing_support::MakeTerrain(10, 10, {0, 0, 0})}); }

void AddKdTree(IndexedGeometry* scene) {
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(scene->geometry, {}, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  scene->kd_tree = *std::move(tree);
}

TEST(OptionsTest, NamesAreReadBack) {
  for (const Strategy strategy : {Strategy::kAuto, Strategy::kSingle, Strategy::kPacket,
                                  Strategy::kBruteForce, Strategy::kShaft, Strategy::kRtt}) {
    EXPECT_EQ(*ParseStrategy(StrategyName(strategy)), strategy);
  }
  for (const Structure structure :
       {Structure::kAuto, Structure::kBvh, Structure::kKdTree, Structure::kBinaryBvh}) {
    EXPECT_EQ(*ParseStructure(StructureName(structure)), structure);
  }
  EXPECT_EQ(*ParseStrategy("rtt"), Strategy::kRtt);
  const absl::Status strategy = ParseStrategy("fast").status();
  EXPECT_THAT(std::string(strategy.message()),
              HasSubstr("unknown strategy 'fast'; there are AUTO"));
  const absl::Status structure = ParseStructure("octree").status();
  EXPECT_EQ(structure.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(structure.message()),
              HasSubstr("unknown structure 'octree'; there are AUTO, BVH, KD_TREE, BINARY_BVH"));
}

TEST(OptionsTest, WhatASceneLacksIsNamed) {
  IndexedGeometry scene = Terrain();
  const auto expect = [&](const QueryOptions& options, absl::StatusCode code,
                          const std::string& part) {
    const absl::Status status = CheckOptions(scene, options);
    EXPECT_EQ(status.code(), code) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
    // Every query says so, and answers nothing.
    TileResult tile;
    const Camera camera = testing_support::LookingDown({5, 5, 9}, 1, 8);
    EXPECT_EQ(TraceTile(scene, camera, {0, 0, 8, 8}, {}, {}, options, &tile), status);
    EXPECT_TRUE(tile.hit_bits.empty());
    ShadowResult shadows;
    EXPECT_EQ(ComputeShadows(scene, {}, {}, {}, {}, {}, options, &shadows), status);
    SegmentResult segments;
    EXPECT_EQ(TestSegments(scene, {}, {}, options, &segments), status);
  };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  constexpr auto kMissing = absl::StatusCode::kFailedPrecondition;
  EXPECT_TRUE(CheckOptions(scene, {}).ok());
  EXPECT_TRUE(CheckOptions(scene, {.structure = Structure::kBvh}).ok());
  expect({.strategy = Strategy::kRtt}, kMissing, "strategy RTT needs a kd-tree");
  expect({.structure = Structure::kKdTree}, kMissing, "structure KD_TREE needs a kd-tree");
  expect({.structure = Structure::kBinaryBvh}, kMissing, "structure BINARY_BVH needs a binary BVH");
  expect({.strategy = Strategy::kRtt, .structure = Structure::kBinaryBvh}, kInvalid,
         "strategy RTT does not walk the binary BVH");
  expect({.strategy = Strategy::kRtt, .structure = Structure::kBvh}, kInvalid, "not the BVH");
  expect({.strategy = Strategy::kShaft, .structure = Structure::kKdTree}, kInvalid,
         "not the kd-tree");
  AddKdTree(&scene);
  EXPECT_TRUE(CheckOptions(scene, {.strategy = Strategy::kRtt}).ok());
  EXPECT_TRUE(CheckOptions(scene, {.structure = Structure::kKdTree}).ok());
  EXPECT_TRUE(CheckOptions(scene, {.strategy = Strategy::kPacket,
                                   .structure = Structure::kKdTree,
                                   .leaf_culling = LeafCulling{}})
                  .ok());
  EXPECT_TRUE(
      CheckOptions(scene, {.strategy = Strategy::kSingle, .leaf_culling = LeafCulling{}}).ok());
  expect({.structure = Structure::kKdTree, .leaf_culling = LeafCulling{}}, kInvalid,
         "leaf_culling is for strategies SINGLE and PACKET, not for AUTO");
  for (const Strategy strategy : {Strategy::kSingle, Strategy::kPacket, Strategy::kBruteForce}) {
    EXPECT_TRUE(
        CheckOptions(scene, {.strategy = strategy, .intersector = Intersector::kWald}).ok());
  }
  for (const Strategy strategy : {Strategy::kSingle, Strategy::kBruteForce}) {
    EXPECT_TRUE(CheckOptions(scene, {.strategy = strategy,
                                     .intersector = Intersector::kHavelHeroutDotProduct})
                    .ok());
  }
  expect({.strategy = Strategy::kPacket, .intersector = Intersector::kHavelHeroutDotProduct},
         kInvalid, "for strategies SINGLE and BRUTE_FORCE, not for PACKET");
  expect({.strategy = Strategy::kShaft, .intersector = Intersector::kWald}, kInvalid,
         "intersector WALD is for strategies SINGLE, PACKET and BRUTE_FORCE, not for SHAFT");
  expect({.strategy = Strategy::kPacket, .packet_side = 3}, kInvalid, "packet_side = 3");
  expect({.strategy = Strategy::kRtt, .rtt_antialiasing = 0}, kInvalid, "rtt_antialiasing = 0");
  expect({.strategy = Strategy::kRtt, .rtt_antialiasing = 7}, kInvalid, "rtt_antialiasing = 7");
  expect({.strategy = Strategy::kRtt, .rtt_side_by_side = 5}, kInvalid, "rtt_side_by_side = 5");
  expect({.strategy = Strategy::kRtt, .rtt_side_by_side = -1}, kInvalid, "rtt_side_by_side = -1");
}

TEST(OptionsTest, AKdTreeAloneIsWalkedAndNothingElse) {
  const IndexedGeometry scene = testing_support::OnKdTreeAlone(Terrain(), {});
  ASSERT_TRUE(scene.kd_tree_alone());
  for (const Strategy strategy : {Strategy::kAuto, Strategy::kSingle, Strategy::kPacket,
                                  Strategy::kRtt, Strategy::kBruteForce}) {
    for (const Structure structure : {Structure::kAuto, Structure::kKdTree}) {
      const QueryOptions options{.strategy = strategy, .structure = structure};
      EXPECT_TRUE(CheckOptions(scene, options).ok());
      EXPECT_TRUE(WalksKdTree(scene, options));
    }
  }
  const auto expect = [&](const QueryOptions& options, const std::string& part) {
    const absl::Status status = CheckOptions(scene, options);
    EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  };
  expect({.structure = Structure::kBvh}, "structure BVH needs a BVH");
  expect({.strategy = Strategy::kShaft}, "strategy SHAFT needs a BVH");
  expect({.strategy = Strategy::kShaft, .structure = Structure::kBvh}, "structure BVH needs a BVH");
  expect({.structure = Structure::kBinaryBvh}, "structure BINARY_BVH needs a binary BVH");
}

// A triangle with every structure, and a camera above it.
IndexedGeometry OneTriangle() {
  IndexedGeometry scene =
      MakeScene({{.vertices = {{-9, -9, 0}, {9, -9, 0}, {0, 18, 0}}, .indices = {0, 1, 2}}});
  AddKdTree(&scene);
  return scene;
}

Camera LookingAtIt(double tan_half_fov_y, uint32_t side) {
  return testing_support::LookingDown({0, 0, 10}, tan_half_fov_y, side);
}

// A tile's statistics say how far its lists went.
TEST(OptionsTest, TilesAreCounted) {
  const IndexedGeometry scene = OneTriangle();
  for (const int n : {1, 2, 3, 4, 5, 6}) {
    const uint32_t side = n == 5 ? 40 : 48;
    const Camera camera = LookingAtIt(0.2, side);
    TileResult tile;
    ASSERT_TRUE(TraceTile(scene, camera, {0, 0, side, side}, {}, {.ids = true},
                          {.strategy = Strategy::kRtt, .rtt_antialiasing = n}, &tile)
                    .ok());
    EXPECT_EQ(tile.primary.strategy, Strategy::kRtt);
    EXPECT_EQ(tile.primary.tiles, side * side / (16 * n * n)) << n;
    EXPECT_EQ(tile.primary.tiles_answered, tile.primary.tiles);
    EXPECT_EQ(tile.primary.relevant_triangles, tile.primary.tiles);
  }
}

// Every ray was answered by something, and where nobody asks nothing is counted.
TEST(OptionsTest, AnswersAreCounted) {
  const IndexedGeometry scene = OneTriangle();
  const Camera camera = LookingAtIt(0.7, 40);
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({1, 2, 9}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0, 0.1, 1}), 1, {}, &samples).ok());
  for (const Strategy strategy : {Strategy::kSingle, Strategy::kPacket, Strategy::kShaft,
                                  Strategy::kRtt, Strategy::kBruteForce}) {
    for (const bool count : {false, true}) {
      TileResult tile;
      ASSERT_TRUE(TraceTile(scene, camera, {0, 0, 40, 40}, samples, {.ids = true, .lit = true},
                            {.strategy = strategy, .count_answers = count}, &tile)
                      .ok());
      for (const QueryStats& stats : {tile.primary, tile.shadow}) {
        const uint64_t sum =
            std::accumulate(stats.answered_by.begin(), stats.answered_by.end(), uint64_t{0});
        EXPECT_EQ(sum, count ? stats.rays : 0) << StrategyName(strategy);
        EXPECT_EQ(stats.answered_by[0], 0u);
      }
      const auto by = [&](AnsweredBy what) {
        return tile.primary.answered_by[static_cast<size_t>(what)];
      };
      const uint64_t rays = count ? tile.primary.rays : 0;
      EXPECT_EQ(by(AnsweredBy::kPacket), strategy == Strategy::kPacket ? rays : 0);
      EXPECT_EQ(by(AnsweredBy::kShaft) > 0,
                count && (strategy == Strategy::kShaft || strategy == Strategy::kRtt))
          << StrategyName(strategy);
    }
  }
}

}  // namespace
}  // namespace sightline
