// SPDX-License-Identifier: Apache-2.0
//
// The papers' tests as a query's intersector: walks that leave triangles out against brute force by
// the same test. Every disagreement is counted and listed, and lies within that test's own bound
// for that triangle; where no triangle has an aspect ratio of 1000, no edge is near and no other
// surface is as near, there is none. Camera rays and their shadows, over built-in and nasty scenes.
#include <cstdint>
#include <iostream>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/parallel.h"
#include "core/mesh/rebase.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/intersector_answers.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/property/paper_answers.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AspectRatio;
using testing_support::CompareHits;
using testing_support::Difference;
using testing_support::DifferenceTally;
using testing_support::kSanitizerBuild;
using testing_support::LeavesEdgesOut;
using testing_support::MakeBuiltinQueryScenes;
using testing_support::MakeNastyQueryScenes;
using testing_support::MakePoints;
using testing_support::MakeSamples;
using testing_support::QueryScene;
using testing_support::TestRng;
using testing_support::WaysBy;

constexpr int kListed = 4;  // Of an intersector's disagreements in one scene.

constexpr Structure kStructures[] = {Structure::kBvh, Structure::kKdTree};

// One scene's disagreements by one intersector.
class Disagreements {
 public:
  Disagreements(const SceneGeometry& geometry, Intersector kind)
      : geometry_(geometry), kind_(kind) {}

  void Compare(const PredicateRay& ray, const Hit& hit, const Hit& truth, const QueryOptions& way) {
    const Difference difference =
        CompareHits(geometry_, kind_, ray, hit, truth, LeavesEdgesOut(way));
    tally_.Add(difference);
    if (difference == Difference::kNone) return;
    EXPECT_NE(difference, Difference::kBeyondBound) << Text(hit) << " instead of " << Text(truth);
    if (++listed_ > kListed) return;
    std::cout << "  " << IntersectorName(kind_) << ": " << Text(hit) << " instead of "
              << Text(truth) << '\n';
  }
  const DifferenceTally& tally() const { return tally_; }

 private:
  std::string Text(const Hit& hit) const {
    if (hit.triangle == kNoTriangle) return "none";
    const auto [a, b, c] = geometry_.Corners(hit.triangle);
    return absl::StrCat("triangle ", hit.triangle, " (aspect ratio ", AspectRatio(a, b, c), ") at ",
                        hit.t);
  }

  const SceneGeometry& geometry_;
  const Intersector kind_;
  DifferenceTally tally_;
  int listed_ = 0;
};

void CheckCameraRays(const QueryScene& scene, Intersector kind, Disagreements* found) {
  const Camera& camera = scene.cameras.front();
  const TileRect whole = {0, 0, camera.width, camera.height};
  constexpr TileOutputs kOutputs = {.ids = true, .depth = true, .uv = true};
  QueryOptions brute;
  brute.strategy = Strategy::kBruteForce;
  brute.intersector = kind;
  TileResult truth, tile;
  ASSERT_TRUE(TraceTile(scene.indexed, camera, whole, {}, kOutputs, brute, &truth).ok());
  Vec3f eye;
  ASSERT_TRUE(Rebase(camera.eye, scene.indexed.geometry.origin, &eye));
  for (const QueryOptions& way : WaysBy(kind, kStructures)) {
    ASSERT_TRUE(TraceTile(scene.indexed, camera, whole, {}, kOutputs, way, &tile).ok());
    for (uint32_t p = 0; p < camera.width * camera.height; ++p) {
      const PredicateRay ray =
          PredicateRay::Ray(eye, PixelDirection(camera, p % camera.width, p / camera.width));
      found->Compare(ray, {tile.depth[p], tile.triangle[p]}, {truth.depth[p], truth.triangle[p]},
                     way);
      if (tile.triangle[p] != truth.triangle[p]) continue;
      EXPECT_EQ(tile.u[p], truth.u[p]);
      EXPECT_EQ(tile.v[p], truth.v[p]);
    }
  }
}

void CheckShadowRays(const QueryScene& scene, Intersector kind, const PreparedPoints& points,
                     const std::vector<LightSample>& lights, Disagreements* found) {
  QueryOptions brute;
  brute.strategy = Strategy::kBruteForce;
  brute.intersector = kind;
  const size_t n = points.size();
  const PointRange range = PointRange::Slice(points, 0, n);
  constexpr ShadowOutputs kOutputs = {.bits = true, .blockers = true};
  ShadowResult truth, result;
  ASSERT_TRUE(ComputeShadows(scene.indexed, range, lights, {}, {}, kOutputs, brute, &truth).ok());
  for (const QueryOptions& way : WaysBy(kind, kStructures)) {
    ASSERT_TRUE(ComputeShadows(scene.indexed, range, lights, {}, {}, kOutputs, way, &result).ok());
    for (size_t s = 0; s < lights.size(); ++s) {
      for (size_t i = 0; i < n; ++i) {
        if (!points.valid[i] || !lights[s].valid) continue;
        const size_t at = s * n + i;
        const Vec3f p = points.positions[i];
        found->Compare(lights[s].directional ? PredicateRay::Ray(p, lights[s].value)
                                             : PredicateRay::Segment(lights[s].value, p),
                       {result.blocker_t[at], result.blocker[at]},
                       {truth.blocker_t[at], truth.blocker[at]}, way);
      }
    }
  }
}

void Check(const std::vector<QueryScene>& scenes, bool plain, TestRng& rng) {
  for (const QueryScene& scene : scenes) {
    SCOPED_TRACE(scene.name);
    const PreparedPoints points = MakePoints(scene.indexed, rng, kSanitizerBuild ? 20 : 150);
    const std::vector<LightSample> lights = MakeSamples(scene.indexed, rng);
    for (const Intersector kind : kPaperIntersectors) {
      SCOPED_TRACE(IntersectorName(kind));
      Disagreements camera(scene.indexed.geometry, kind), shadows(scene.indexed.geometry, kind);
      CheckCameraRays(scene, kind, &camera);
      CheckShadowRays(scene, kind, points, lights, &shadows);
      std::cout << scene.name << ", " << IntersectorName(kind) << ": camera rays " << camera.tally()
                << "; shadow rays " << shadows.tally() << '\n';
      if (plain) {
        EXPECT_EQ(camera.tally().of(Difference::kPlain), 0);
        EXPECT_EQ(shadows.tally().of(Difference::kPlain), 0);
      }
      if (testing::Test::HasFailure()) return;
    }
  }
}

TEST(IntersectorsTest, BuiltinScenesDifferOnlyWithinTheBoundAndForAReason) {
  TestRng rng;
  Check(MakeBuiltinQueryScenes(), /*plain=*/true, rng);
}

TEST(IntersectorsTest, NastyScenesDifferOnlyWithinTheBound) {
  TestRng rng;
  Check(MakeNastyQueryScenes(rng), /*plain=*/false, rng);
}

// Rays all but within a triangle's plane, from in it: a determinant without a finite reciprocal
// gives no distance, and is no hit, neither for who asks what blocks first nor for who asks whether
// anything does.
TEST(IntersectorsTest, WhatHasNoDistanceBlocksNothing) {
  ObjectInput object;
  object.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  object.indices = {0, 1, 2};
  IndexedGeometry scene = testing_support::IndexObjects({object}, Vec3d{0, 0, 0});
  testing_support::AddKdTree({}, &scene);
  LightSample light;
  light.value = {0.25f, 0.25f, 0};
  PreparedPoints points;
  for (int i = 0; i < 40; ++i) {
    points.positions.push_back({1.25f + 0.01f * static_cast<float>(i), 0.25f, 0x1p-140f});
    points.sources.push_back(kNoTriangle);
    points.valid.push_back(true);
  }
  for (const Intersector kind : kPaperIntersectors) {
    std::vector<QueryOptions> ways = WaysBy(kind, kStructures);
    QueryOptions& brute = ways.emplace_back();
    brute.strategy = Strategy::kBruteForce;
    brute.intersector = kind;
    for (const QueryOptions& way : ways) {
      SCOPED_TRACE(absl::StrCat(IntersectorName(kind), " by ", StrategyName(way.strategy), " on ",
                                StructureName(way.structure)));
      for (const bool first : {false, true}) {
        ShadowResult result;
        ASSERT_TRUE(ComputeShadows(scene, PointRange::Slice(points, 0, points.size()), {&light, 1},
                                   {}, {}, {.bits = true, .blockers = first}, way, &result)
                        .ok());
        for (size_t i = 0; i < points.size(); ++i) {
          EXPECT_EQ(result.lit_bits[i / 8] >> (i % 8) & 1, 1);
          if (!first) continue;
          EXPECT_EQ(result.blocker[i], kNoTriangle);
          EXPECT_EQ(result.blocker_t[i], std::numeric_limits<float>::infinity());
        }
      }
    }
  }
}

}  // namespace
}  // namespace sightline
