// SPDX-License-Identifier: Apache-2.0
//
// The short form of the soak: the same code, bounded by rounds instead of time, and a check that it
// would see a wrong answer.
#include "tests/bench/verify.h"

#include <algorithm>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "core/accel/binary_bvh_builder.h"
#include "core/accel/bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/base/check.h"
#include "core/mesh/builtin/builtin.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::bench {
namespace {

TEST(VerifyTest, AllWaysAgreeOnRandomScenes) {
  const uint64_t seed = testing_support::TestSeed();
  const VerifyReport report =
      Verify({}, {.seed = seed,
                  .batches = static_cast<uint64_t>(testing_support::ScaledCount(10)),
                  .rounds_per_batch = 16,
                  .max_random_triangles = 10'000,
                  .threads = 2});
  EXPECT_EQ(report.different, 0u) << "SIGHTLINE_SEED=" << seed;
  for (const std::string& difference : report.differences) ADD_FAILURE() << difference;
  EXPECT_GT(report.auto_rays, 0u);
  EXPECT_GT(report.brute_force_rays, 0u);
  RecordProperty("auto_rays", std::to_string(report.auto_rays));
  RecordProperty("brute_force_rays", std::to_string(report.brute_force_rays));
}

// A tile of four hits under an area light: with AVX2, hulls took what fills a block's second vector
// for points.
TEST(VerifyTest, HullsOfAFewPointsHoldThemAll) {
  const VerifyReport report =
      Verify({}, {.seed = 20261128, .first_batch = 68, .batches = 1, .threads = 1});
  for (const std::string& difference : report.differences) ADD_FAILURE() << difference;
  EXPECT_EQ(report.different, 0u);
}

TEST(VerifyTest, TheNumberOfThreadsChangesNothing) {
  VerifyOptions options{
      .seed = 5, .batches = 2, .rounds_per_batch = 6, .max_random_triangles = 3000, .threads = 1};
  const VerifyReport one = Verify({}, options);
  options.threads = 3;
  const VerifyReport three = Verify({}, options);
  EXPECT_EQ(one.auto_rays, three.auto_rays);
  EXPECT_EQ(one.brute_force_rays, three.brute_force_rays);
  EXPECT_EQ(one.places, three.places);
}

IndexedGeometry Sphere(ThreadPool& pool) {
  IndexedGeometry scene;
  auto sphere = MakeBuiltin({.name = "sphere", .target_triangles = 3000});
  SIGHTLINE_CHECK(sphere.ok()) << sphere.status();
  auto geometry = CompileScene(sphere->objects, std::nullopt, MeshLimits{});
  SIGHTLINE_CHECK(geometry.ok()) << geometry.status();
  scene.geometry = *std::move(geometry);
  auto bvh = BuildBvh(scene.geometry, {}, pool);
  SIGHTLINE_CHECK(bvh.ok()) << bvh.status();
  scene.bvh = *std::move(bvh);
  return scene;
}

VerifyReport VerifyAlone(IndexedGeometry scene, uint64_t rounds) {
  std::vector<VerifyScene> scenes;
  scenes.emplace_back("sphere", std::move(scene));
  return Verify(scenes, {.seed = 1, .batches = 1, .rounds_per_batch = rounds, .threads = 2});
}

// Ways whose answers differed: those on the structure alone, which nobody else walks.
void ExpectNoticedOn(const VerifyReport& report, const std::vector<std::string>& names) {
  EXPECT_GT(report.different, 0u);
  for (const auto& [key, tally] : report.tallies) {
    if (tally.different == 0) continue;
    const std::string& way = std::get<1>(key);
    EXPECT_TRUE(std::any_of(names.begin(), names.end(), [&way](const std::string& name) {
      return way.find(name) != std::string::npos;
    })) << way;
  }
}

// A tree that lost a child: what hangs there is never found by a walk over it, but by the others.
TEST(VerifyTest, ADamagedTreeIsNoticed) {
  ThreadPool pool(1);
  IndexedGeometry scene = Sphere(pool);
  BvhNode& root = scene.bvh.nodes[0];
  for (auto& faces : root.bounds) faces[0] = faces[1];
  const VerifyReport report = VerifyAlone(std::move(scene), /*rounds=*/40);
  EXPECT_GT(report.different, 0u);
  ASSERT_FALSE(report.differences.empty());
  EXPECT_NE(report.differences[0].find("seed 1, batch 0, round "), std::string::npos);
  // Every way over it is as blind as the others: the walk of its own is not.
  uint64_t by_walk = 0;
  for (const auto& [key, tally] : report.tallies) {
    if (std::get<2>(key) == "independent walk") by_walk += tally.different;
  }
  EXPECT_GT(by_walk, 0u);
}

TEST(VerifyTest, ADamagedKdTreeIsNoticed) {
  ThreadPool pool(1);
  IndexedGeometry scene = Sphere(pool);
  auto tree = BuildKdTree(scene.geometry, {}, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  for (KdLeaf& leaf : tree->leaves) leaf.count = 1;  // All but the first of its triangles are lost.
  scene.kd_tree = *std::move(tree);
  ExpectNoticedOn(VerifyAlone(std::move(scene), /*rounds=*/60), {"KD_TREE", "RTT"});
}

TEST(VerifyTest, ADamagedBinaryBvhIsNoticed) {
  ThreadPool pool(1);
  IndexedGeometry scene = Sphere(pool);
  auto tree = BuildBinaryBvh(scene.geometry, {}, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  // Rows of zeros: triangles that no ray meets.
  std::fill(tree->leaves.rows.begin(), tree->leaves.rows.end(), 0.0f);
  scene.binary_bvh = *std::move(tree);
  ExpectNoticedOn(VerifyAlone(std::move(scene), /*rounds=*/60), {"BINARY_BVH"});
}

// The walk is what others are held against where brute force would take too long.
TEST(VerifyTest, TheIndependentWalkIsBruteForce) {
  const uint64_t seed = testing_support::TestSeed();
  Random random(seed, 77);
  ThreadPool pool(1);
  for (int64_t s = 0; s < testing_support::ScaledCount(10); ++s) {
    const VerifyScene scene = MakeRandomScene(2000, random, pool);
    Placer placer(scene.indexed, random);
    const PreparedSegments segments = MakeVerifySegments(placer, random);
    SegmentResult truth;
    ASSERT_TRUE(TestSegments(scene.indexed, segments, {.bits = true, .first_hits = true},
                             {.strategy = Strategy::kBruteForce}, &truth)
                    .ok());
    for (size_t i = 0; i < segments.size(); ++i) {
      const Hit hit = scene.walk.Closest(
          scene.indexed.geometry, {.ray = PredicateRay::Segment(segments.from[i], segments.to[i]),
                                   .from_source = segments.from_source[i],
                                   .to_source = segments.to_source[i]});
      ASSERT_EQ(hit.triangle, truth.triangle[i])
          << scene.name << ", segment " << i << ", SIGHTLINE_SEED=" << seed;
    }
  }
}

}  // namespace
}  // namespace sightline::bench
