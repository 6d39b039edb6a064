// SPDX-License-Identifier: Apache-2.0
//
// The short form of the soak: the same code, bounded by rounds instead of time, and a check that it
// would see a wrong answer.
#include "tests/bench/verify.h"

#include "core/accel/bvh_builder.h"
#include "core/mesh/builtin/builtin.h"
#include "gtest/gtest.h"
#include "tests/bench/independent_walk.h"
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

// A tree that lost a child: what hangs there is never found by a walk, but by brute force.
TEST(VerifyTest, ADamagedTreeIsNoticed) {
  auto sphere = MakeBuiltin({.name = "sphere", .target_triangles = 3000});
  ASSERT_TRUE(sphere.ok()) << sphere.status();
  auto geometry = CompileScene(sphere->objects, std::nullopt, MeshLimits{});
  ASSERT_TRUE(geometry.ok()) << geometry.status();
  ThreadPool pool(1);
  auto bvh = BuildBvh(*geometry, {}, pool);
  ASSERT_TRUE(bvh.ok()) << bvh.status();
  std::vector<VerifyScene> scenes;
  scenes.push_back({"sphere", {*std::move(geometry), *std::move(bvh)}});
  BvhNode& root = scenes[0].indexed.bvh.nodes[0];
  for (auto& faces : root.bounds) faces[0] = faces[1];
  const VerifyReport report =
      Verify(scenes, {.seed = 1, .batches = 1, .rounds_per_batch = 40, .threads = 2});
  EXPECT_GT(report.different, 0u);
  ASSERT_FALSE(report.differences.empty());
  EXPECT_NE(report.differences[0].find("seed 1, batch 0, round "), std::string::npos);
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
      const Hit hit = WalkIndependently(
          scene.indexed, {.ray = PredicateRay::Segment(segments.from[i], segments.to[i]),
                          .from_source = segments.from_source[i],
                          .to_source = segments.to_source[i]});
      ASSERT_EQ(hit.triangle, truth.triangle[i])
          << scene.name << ", segment " << i << ", SIGHTLINE_SEED=" << seed;
    }
  }
}

}  // namespace
}  // namespace sightline::bench
