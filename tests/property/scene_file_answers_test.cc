// SPDX-License-Identifier: Apache-2.0
//
// A scene that was written to a file and mapped again answers as the one that was built: the same
// bytes, by every strategy and instruction set, for scenes that are meant to break a tracer.
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "core/accel/binary_bvh_builder.h"
#include "core/base/folder.h"
#include "core/query/points.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/scene/scene_file.h"
#include "gtest/gtest.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

using testing_support::AddKdTree;
using testing_support::AllWays;
using testing_support::InTurn;
using testing_support::MakeBuiltinQueryScenes;
using testing_support::MakeNastyQueryScenes;
using testing_support::MakePoints;
using testing_support::MakeSamples;
using testing_support::MakeSegments;
using testing_support::QueryScene;
using testing_support::Rebuilt;
using testing_support::SameBytes;
using testing_support::TempDir;
using testing_support::TestRng;
using testing_support::Way;
using testing_support::WaysWithoutBvh;

struct Questions {
  std::vector<Camera> cameras;
  std::vector<LightSample> samples;
  PreparedPoints points;
  PreparedSegments segments;
};

struct Answers {
  std::vector<TileResult> tiles;
  ShadowResult shadows;
  SegmentResult segments;
};

Answers Ask(const IndexedGeometry& scene, const Questions& questions, const Way& way) {
  Answers answers;
  for (const Camera& camera : questions.cameras) {
    answers.tiles.emplace_back();
    EXPECT_TRUE(TraceTile(scene, camera, {0, 0, camera.width, camera.height}, questions.samples,
                          {.ids = true, .depth = true, .uv = true, .lit = true, .points = true},
                          way.Options(), &answers.tiles.back())
                    .ok());
  }
  EXPECT_TRUE(ComputeShadows(scene, PointRange::All(questions.points), questions.samples, {}, {},
                             {.bits = true, .blockers = true}, way.Options(), &answers.shadows)
                  .ok());
  EXPECT_TRUE(TestSegments(scene, questions.segments, {.bits = true, .first_hits = true},
                           way.Options(), &answers.segments)
                  .ok());
  return answers;
}

void ExpectSame(const Answers& a, const Answers& b) {
  ASSERT_EQ(a.tiles.size(), b.tiles.size());
  for (size_t i = 0; i < a.tiles.size(); ++i) {
    EXPECT_TRUE(SameBytes(a.tiles[i].hit_bits, b.tiles[i].hit_bits));
    EXPECT_TRUE(SameBytes(a.tiles[i].triangle, b.tiles[i].triangle));
    EXPECT_TRUE(SameBytes(a.tiles[i].depth, b.tiles[i].depth));
    EXPECT_TRUE(SameBytes(a.tiles[i].u, b.tiles[i].u));
    EXPECT_TRUE(SameBytes(a.tiles[i].v, b.tiles[i].v));
    EXPECT_TRUE(SameBytes(a.tiles[i].lit_bits, b.tiles[i].lit_bits));
    EXPECT_TRUE(SameBytes(a.tiles[i].points.positions, b.tiles[i].points.positions));
  }
  EXPECT_TRUE(SameBytes(a.shadows.lit_bits, b.shadows.lit_bits));
  EXPECT_TRUE(SameBytes(a.shadows.blocker, b.shadows.blocker));
  EXPECT_TRUE(SameBytes(a.shadows.blocker_t, b.shadows.blocker_t));
  EXPECT_TRUE(SameBytes(a.segments.blocked_bits, b.segments.blocked_bits));
  EXPECT_TRUE(SameBytes(a.segments.triangle, b.segments.triangle));
  EXPECT_TRUE(SameBytes(a.segments.t, b.segments.t));
}

std::vector<QueryScene> AllScenes(TestRng& rng) {
  std::vector<QueryScene> scenes = MakeNastyQueryScenes(rng);
  for (QueryScene& scene : MakeBuiltinQueryScenes()) scenes.push_back(std::move(scene));
  return scenes;
}

TEST(SceneFileAnswersTest, AMappedSceneAnswersAsTheBuiltOne) {
  TestRng rng;
  ThreadPool pool(2);
  TempDir dir;
  const Folder folder = *Folder::Open(dir.path());
  std::vector<QueryScene> scenes = AllScenes(rng);
  for (const BvhPreset preset : {BvhPreset::kStatic, BvhPreset::kDynamic, BvhPreset::kCompact}) {
    scenes = Rebuilt(std::move(scenes), preset);
    for (size_t i = 0; i < scenes.size(); ++i) {
      // The other presets differ in which arrays they fill: some scenes tell.
      if (preset != BvhPreset::kStatic && i % 5 != 0) continue;
      if (preset == BvhPreset::kStatic) AddKdTree({}, &scenes[i].indexed);
      const QueryScene& built = scenes[i];
      SCOPED_TRACE(built.name);
      Scene scene;
      static_cast<IndexedGeometry&>(scene) = built.indexed;
      scene.revision = 1;
      const absl::Status written = WriteSceneFile(scene, folder, "scene.slscene", pool);
      ASSERT_TRUE(written.ok()) << written;
      const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
      ASSERT_TRUE(file.ok()) << file.status();
      const auto mapped = LoadScene(*file, "mapped", {}, pool);
      ASSERT_TRUE(mapped.ok()) << mapped.status();
      const Questions questions = {{built.cameras.front()},
                                   MakeSamples(built.indexed, rng),
                                   MakePoints(built.indexed, rng, 30),
                                   MakeSegments(built.indexed, rng, 60)};
      for (const Way& way : InTurn(AllWays(built.indexed.kd_tree.has_value()), rng)) {
        SCOPED_TRACE(way.Name());
        ExpectSame(Ask(built.indexed, questions, way), Ask(**mapped, questions, way));
      }
    }
  }
}

// World coordinates near what is stored, some on it.
std::vector<Vec3d> PlacesNear(const IndexedGeometry& scene, TestRng& rng, size_t count) {
  std::vector<Vec3d> places;
  const SceneGeometry& geometry = scene.geometry;
  for (size_t i = 0; i < count && !geometry.vertices.empty(); ++i) {
    const Vec3f at = geometry.vertices[rng.Below(geometry.vertices.size())];
    const double step = rng.Chance(0.3) ? 0 : std::exp2(-rng.Uniform(0, 12));
    places.push_back(geometry.origin + ToDouble(at) +
                     Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)} * step);
  }
  return places;
}

void ExpectSamePoints(const IndexedGeometry& a, const IndexedGeometry& b,
                      const std::vector<Vec3d>& places) {
  for (const double attach : {0.0, 0.05, 10.0}) {
    const auto of_a = PreparePoints(a, {.positions = places}, {.attach_distance = attach});
    const auto of_b = PreparePoints(b, {.positions = places}, {.attach_distance = attach});
    ASSERT_TRUE(of_a.ok() && of_b.ok()) << of_a.status() << of_b.status();
    EXPECT_TRUE(SameBytes(of_a->positions, of_b->positions)) << attach;
    EXPECT_TRUE(SameBytes(of_a->sources, of_b->sources)) << attach;
    EXPECT_EQ(of_a->near_surface, of_b->near_surface) << attach;
  }
}

// Built so, and mapped: with a binary BVH beside it in every other case.
TEST(SceneFileAnswersTest, AKdTreeAloneAnswersAsABvhDoes) {
  TestRng rng;
  ThreadPool pool(2);
  TempDir dir;
  const Folder folder = *Folder::Open(dir.path());
  std::vector<QueryScene> scenes = AllScenes(rng);
  const std::vector<Way> ways = WaysWithoutBvh();
  size_t number = 0;
  for (const QueryScene& with_bvh : scenes) {
    SCOPED_TRACE(with_bvh.name);
    Scene alone;
    static_cast<IndexedGeometry&>(alone) = with_bvh.indexed;
    alone.revision = 1;
    AddKdTree({.traversal_cost = 0.5f, .perfect_splits = ++number % 2 == 0}, &alone);
    alone.bvh = Bvh();
    if (number % 3 == 0) {
      auto binary = BuildBinaryBvh(alone.geometry, {.cost_ratio = 0.3f}, pool);
      ASSERT_TRUE(binary.ok()) << binary.status();
      alone.binary_bvh = *std::move(binary);
    }
    const absl::Status written = WriteSceneFile(alone, folder, "scene.slscene", pool);
    ASSERT_TRUE(written.ok()) << written;
    const absl::StatusOr<SceneBytes> file = MapSceneFile(folder, "scene.slscene");
    ASSERT_TRUE(file.ok()) << file.status();
    const auto mapped = LoadScene(*file, "mapped", {}, pool);
    ASSERT_TRUE(mapped.ok()) << mapped.status();
    EXPECT_EQ((*mapped)->kd_tree_alone(), !with_bvh.indexed.bvh.empty());
    EXPECT_EQ((*mapped)->binary_bvh.has_value(), alone.binary_bvh.has_value());
    ExpectSamePoints(with_bvh.indexed, **mapped, PlacesNear(with_bvh.indexed, rng, 60));
    const Questions questions = {{with_bvh.cameras.front()},
                                 MakeSamples(with_bvh.indexed, rng),
                                 MakePoints(with_bvh.indexed, rng, 30),
                                 MakeSegments(with_bvh.indexed, rng, 60)};
    const Answers truth = Ask(with_bvh.indexed, questions, ways.front());
    // Scenes take turns with the ways.
    std::vector<Way> fourth;
    for (size_t i = number % 4; i < ways.size(); i += 4) fourth.push_back(ways[i]);
    for (const Way& way : InTurn(fourth, rng)) {
      SCOPED_TRACE(way.Name());
      ExpectSame(Ask(alone, questions, way), truth);
      ExpectSame(Ask(**mapped, questions, way), truth);
    }
    if ((*mapped)->binary_bvh) {
      ExpectSame(Ask(**mapped, questions,
                     {.strategy = Strategy::kPacket,
                      .simd = SimdTarget::kBest,
                      .structure = Structure::kBinaryBvh}),
                 truth);
    }
    if (testing::Test::HasFailure()) return;
  }
}

}  // namespace
}  // namespace sightline
