// SPDX-License-Identifier: Apache-2.0
//
// The judge of answers by the papers' tests: each of its verdicts, on rays made for it.
#include "tests/core/intersect/intersector_answers.h"

#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "core/intersect/intersector_check.h"
#include "core/mesh/scene_geometry.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::testing_support {
namespace {

constexpr Intersector kKind = Intersector::kHavelHerout;

SceneGeometry Triangles(const std::vector<Vec3d>& corners) {
  ObjectInput object;
  object.name = "triangles";
  object.vertices = corners;
  for (uint32_t i = 0; i < corners.size(); ++i) object.indices.push_back(i);
  absl::StatusOr<SceneGeometry> geometry =
      CompileScene(std::span(&object, 1), Vec3d{}, MeshLimits{});
  EXPECT_TRUE(geometry.ok()) << geometry.status();
  return *std::move(geometry);
}

// 0: at z = 1; 1: at z = 2; 2: a sliver at z = 3, thinner than 1 in 1000.
SceneGeometry Three() {
  return Triangles({{0, 0, 1},
                    {1, 0, 1},
                    {0, 1, 1},
                    {0, 0, 2},
                    {1, 0, 2},
                    {0, 1, 2},
                    {0, 0, 3},
                    {1, 0, 3},
                    {0.5, 1e-4, 3}});
}

// Up, from below all of them.
PredicateRay Up(float x, float y) { return PredicateRay::Ray({x, y, 0}, {0, 0, 1}); }
const PredicateRay kMiddle = Up(0.25f, 0.25f);
const Hit kNone;

TEST(CompareHitsTest, TheSameBitsAreNoDifference) {
  const SceneGeometry geometry = Three();
  EXPECT_EQ(CompareHits(geometry, kKind, kMiddle, {1, 0}, {1, 0}), Difference::kNone);
  EXPECT_EQ(CompareHits(geometry, kKind, kMiddle, kNone, kNone), Difference::kNone);
}

TEST(CompareHitsTest, NothingExcusesWhatIsCertain) {
  const SceneGeometry geometry = Three();
  const std::pair<Hit, Hit> kCases[] = {
      {{2, 1}, {1, 0}},            // Lost.
      {{1, 0}, {2, 1}},            // Nearer than what all triangles give.
      {kNone, {1, 0}},             // Lost, and nothing found.
      {{1, 0}, kNone},             // Found where there is nothing.
      {{3, kNoTriangle}, kNone}};  // Nothing, at another distance.
  for (const auto& [hit, truth] : kCases) {
    EXPECT_EQ(CompareHits(geometry, kKind, kMiddle, hit, truth), Difference::kBeyondBound)
        << hit.triangle << " at " << hit.t << " for " << truth.triangle << " at " << truth.t;
  }
}

// In doubt, but nearer than the truth: a walk asks about no triangle that brute force leaves out.
TEST(CompareHitsTest, NothingNearerIsExcused) {
  const SceneGeometry geometry = Three();
  const PredicateRay edge = Up(0.5f, 0);
  ASSERT_FALSE(CheckIntersector(kKind, edge, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}).certain);
  EXPECT_EQ(CompareHits(geometry, kKind, edge, {1, 0}, {2, 1}), Difference::kBeyondBound);
  EXPECT_EQ(CompareHits(geometry, kKind, edge, {1, 0}, kNone), Difference::kBeyondBound);
}

TEST(CompareHitsTest, HitsInDoubtMayBeLostForAReason) {
  const SceneGeometry geometry = Three();
  EXPECT_EQ(CompareHits(geometry, kKind, Up(0.5f, 0), {2, 1}, {1, 0}), Difference::kEdge);
  EXPECT_EQ(CompareHits(geometry, kKind, Up(0.5f, 0), kNone, {1, 0}), Difference::kEdge);
  EXPECT_EQ(CompareHits(geometry, kKind, Up(0.25f, 0), kNone, {3, 2}), Difference::kSliver);
  const PredicateRay ends = PredicateRay::Segment({0.25f, 0.25f, 0}, {0.25f, 0.25f, 1});
  EXPECT_EQ(CompareHits(geometry, kKind, ends, kNone, {1, 0}), Difference::kEnd);
}

TEST(CompareHitsTest, OneOfTwoThatAreAsNearMayBeLost) {
  // The same triangle twice.
  const SceneGeometry geometry =
      Triangles({{0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}});
  EXPECT_EQ(CompareHits(geometry, kKind, kMiddle, {1, 1}, {1, 0}), Difference::kTie);
  EXPECT_EQ(CompareHits(geometry, kKind, kMiddle, {1, 0}, {1, 1}), Difference::kTie);
}

// Far from the origin of coordinates planes lose their digits: a ray may pass well within a
// triangle's edges, and the bound still not tell. Nothing else excuses such a hit.
TEST(CompareHitsTest, WhatTheBoundAloneExcusesIsPlain) {
  TestRng rng;
  constexpr double kFar = 1e5;
  const SceneGeometry geometry = Triangles({{kFar, 0, 0}, {kFar + 1, 0, 0}, {kFar, 1, 0}});
  int64_t plain = 0;
  for (int i = 0; i < 2000; ++i) {
    const Vec3f from{static_cast<float>(kFar + rng.Uniform(0, 1)),
                     static_cast<float>(rng.Uniform(0, 1)), -10};
    const PredicateRay ray = PredicateRay::Ray(from, {0, 0, 1});
    const auto [a, b, c] = geometry.Corners(0);
    const IntersectorCheck check = CheckIntersector(kKind, ray, a, b, c);
    if (!check.hit) continue;
    const Difference difference = CompareHits(geometry, kKind, ray, kNone, {check.at.t, 0});
    EXPECT_EQ(difference == Difference::kBeyondBound, check.certain);
    plain += difference == Difference::kPlain;
  }
  EXPECT_GT(plain, 0);
}

TEST(DifferenceTallyTest, CountsByKindAndPrintsWhatThereIs) {
  DifferenceTally tally;
  for (const Difference d : {Difference::kNone, Difference::kNone, Difference::kTie}) tally.Add(d);
  EXPECT_EQ(tally.compared(), 3);
  EXPECT_EQ(tally.of(Difference::kNone), 2);
  EXPECT_EQ(tally.of(Difference::kPlain), 0);
  std::ostringstream text;
  text << tally;
  EXPECT_EQ(text.str(), "3 compared, 2 same, 1 in ties");
}

TEST(AspectRatioTest, IsTheLongestEdgeOverItsHeight) {
  EXPECT_DOUBLE_EQ(AspectRatio({0, 0, 0}, {4, 0, 0}, {1, 2, 0}), 2);
  EXPECT_EQ(AspectRatio({0, 0, 0}, {1, 0, 0}, {2, 0, 0}), std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace sightline::testing_support
