// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_refit.h"

#include <cmath>
#include <functional>
#include <limits>

#include "core/accel/bvh_builder.h"
#include "core/accel/bvh_validation.h"
#include "gtest/gtest.h"
#include "tests/core/accel/same_bytes.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::NastyMeshes;
using testing_support::SameBytes;
using testing_support::ScaledCount;
using testing_support::ScatteredTriangles;
using testing_support::TestMesh;
using testing_support::TestRng;

constexpr BvhPreset kFitted[] = {BvhPreset::kStatic, BvhPreset::kDynamic, BvhPreset::kCompact};

Bvh Build(const SceneGeometry& geometry, BvhPreset preset) {
  ThreadPool pool(2);
  absl::StatusOr<Bvh> bvh = BuildBvh(geometry, BvhPresetOptions(preset), pool);
  EXPECT_TRUE(bvh.ok()) << bvh.status();
  return bvh.ok() ? *std::move(bvh) : Bvh();
}

// The same triangles with every vertex moved; which of them are inert is not asked again.
SceneGeometry Moved(const SceneGeometry& geometry, const std::function<Vec3f(Vec3f)>& move) {
  SceneGeometry moved = geometry;
  for (Vec3f& vertex : moved.vertices) {
    if (std::isfinite(vertex.x)) vertex = move(vertex);
  }
  return moved;
}

TEST(BvhRefitTest, WhatDidNotMoveStaysAsItIs) {
  TestRng rng;
  ThreadPool pool(2);
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(5'000)))) {
    SCOPED_TRACE(mesh.name);
    for (const BvhPreset preset : kFitted) {
      const Bvh built = Build(mesh.geometry, preset);
      const absl::StatusOr<Bvh> fitted = RefitBvh(built, mesh.geometry, pool);
      ASSERT_TRUE(fitted.ok()) << fitted.status();
      EXPECT_TRUE(SameBytes(*fitted, built));
      const Vec3f extent = built.bounds.Extent();
      const bool has_area = !built.empty() && (extent.x > 0) + (extent.y > 0) + (extent.z > 0) > 1;
      const double unknown = std::numeric_limits<double>::infinity();
      EXPECT_EQ(fitted->cost_growth, built.empty() || has_area ? 1 : unknown);
    }
  }
}

// Whatever the motion: a valid tree over the new positions, the same for any number of threads, in
// place and beside.
TEST(BvhRefitTest, FitsWhateverMoved) {
  TestRng rng;
  ThreadPool one(1), four(4);
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(5'000)))) {
    SCOPED_TRACE(mesh.name);
    const SceneGeometry moved = Moved(mesh.geometry, [&](Vec3f v) {
      // The sum with 0 leaves no -0.
      return Vec3f{static_cast<float>(rng.Uniform(-1, 1)) * v.y + 0.0f,
                   v.z + static_cast<float>(rng.Uniform(-3, 3)) + 0.0f, v.x * 0.5f + 0.0f};
    });
    for (const BvhPreset preset : kFitted) {
      Bvh bvh = Build(mesh.geometry, preset);
      const absl::StatusOr<Bvh> fitted = RefitBvh(bvh, moved, one);
      ASSERT_TRUE(fitted.ok()) << fitted.status();
      EXPECT_TRUE(ValidateBvh(*fitted, moved).ok()) << ValidateBvh(*fitted, moved);
      const absl::Status status = RefitBvhInPlace(moved, four, &bvh);
      ASSERT_TRUE(status.ok()) << status;
      EXPECT_TRUE(SameBytes(*fitted, bvh));
      EXPECT_EQ(fitted->cost_growth, bvh.cost_growth);
    }
  }
}

TEST(BvhRefitTest, GrowthTellsHowGoodTheTreeIs) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 20'000, 0.02);
  const Bvh built = Build(geometry, BvhPreset::kDynamic);
  // Areas by powers of two, and their ratios unchanged.
  const absl::StatusOr<Bvh> larger =
      RefitBvh(built, Moved(geometry, [](Vec3f v) { return v * 4.0f; }), pool);
  EXPECT_EQ(larger->cost_growth, 1);
  const absl::StatusOr<Bvh> waves = RefitBvh(built,
                                             Moved(geometry,
                                                   [](Vec3f v) {
                                                     const float y = 0.05f * std::sin(9 * v.x);
                                                     return Vec3f{v.x, v.y + y, v.z};
                                                   }),
                                             pool);
  EXPECT_GT(waves->cost_growth, 0.8);
  EXPECT_LT(waves->cost_growth, kMaxRefitGrowth);
  // Each triangle goes elsewhere: nothing is left of what the tree knew.
  SceneGeometry shuffled = geometry;
  for (auto& triangle : shuffled.triangles) {
    const Vec3f by{static_cast<float>(rng.Uniform(-1, 1)), static_cast<float>(rng.Uniform(-1, 1)),
                   static_cast<float>(rng.Uniform(-1, 1))};
    for (const uint32_t v : triangle) shuffled.vertices[v] = geometry.vertices[v] + by;
  }
  const absl::StatusOr<Bvh> apart = RefitBvh(built, shuffled, pool);
  EXPECT_GT(apart->cost_growth, 5);
  // Growth is held against the tree as it was built, however many steps led away from it.
  const absl::StatusOr<Bvh> back = RefitBvh(*apart, geometry, pool);
  EXPECT_NEAR(back->cost_growth, 1, 1e-9);
}

TEST(BvhRefitTest, BoxesWithoutAreaSayNothing) {
  ThreadPool pool(1);
  const std::vector<ObjectInput> objects = {
      {.name = "a", .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}}};
  const auto geometry = CompileScene(objects, std::nullopt, {});
  ASSERT_TRUE(geometry.ok()) << geometry.status();
  const Bvh built = Build(*geometry, BvhPreset::kDynamic);
  const auto line = RefitBvh(built,
                             Moved(*geometry,
                                   [](Vec3f v) {
                                     return Vec3f{v.x, 0, 0};
                                   }),
                             pool);
  EXPECT_EQ(line->cost_growth, std::numeric_limits<double>::infinity());
  EXPECT_TRUE(RefitBvh(Bvh(), SceneGeometry(), pool)->empty());
}

TEST(BvhRefitTest, CanRefitAsksForTheSameInertTriangles) {
  TestRng rng;
  const SceneGeometry before = ScatteredTriangles(rng, 10, 0.1);
  SceneGeometry now = before;
  EXPECT_TRUE(CanRefit(before, now));
  now.inert = {3};
  EXPECT_FALSE(CanRefit(before, now));
  EXPECT_FALSE(CanRefit(now, before));
  EXPECT_TRUE(CanRefit(now, now));
  EXPECT_FALSE(CanRefit(before, ScatteredTriangles(rng, 11, 0.1)));
}

TEST(BvhRefitTest, CanBeCancelled) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 1'000, 0.1);
  Bvh bvh = Build(geometry, BvhPreset::kStatic);
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(RefitBvh(bvh, geometry, pool, &cancel).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(RefitBvhInPlace(geometry, pool, &bvh, &cancel).code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace sightline
