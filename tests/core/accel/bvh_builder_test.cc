// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_builder.h"

#include <atomic>
#include <limits>

#include "core/accel/bvh_validation.h"
#include "core/base/mutex.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/accel/same_bytes.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::NastyMeshes;
using testing_support::SameBytes;
using testing_support::ScaledCount;
using testing_support::ScatteredTriangles;
using testing_support::TestMesh;
using testing_support::TestRng;

TEST(BvhBuilderTest, NastyMeshesGiveValidTrees) {
  TestRng rng;
  ThreadPool pool(2);
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(20'000)))) {
    SCOPED_TRACE(mesh.name);
    const absl::StatusOr<Bvh> bvh = BuildBvh(mesh.geometry, {}, pool);
    ASSERT_TRUE(bvh.ok()) << bvh.status();
    EXPECT_TRUE(ValidateBvh(*bvh, mesh.geometry).ok()) << ValidateBvh(*bvh, mesh.geometry);
    EXPECT_EQ(bvh->bounds, mesh.geometry.bounds);
    EXPECT_EQ(bvh->empty(), mesh.geometry.triangles.size() == mesh.geometry.inert.size());
  }
}

TEST(BvhBuilderTest, EveryOptionGivesValidTrees) {
  TestRng rng;
  ThreadPool pool(2);
  const std::vector<TestMesh> meshes = NastyMeshes(rng, 700);
  for (int bins : {2, 3, 16, 256}) {
    for (int max_leaf : {1, 2, 7, 16}) {
      for (float traversal_cost : {0.0f, 1.0f, kMaxTraversalCost}) {
        for (unsigned switches = 0; switches < 8; ++switches) {
          const BvhBuildOptions options{.bins = bins,
                                        .max_leaf_triangles = max_leaf,
                                        .traversal_cost = traversal_cost,
                                        .longest_axis_only = (switches & 1) != 0,
                                        .full_leaves = (switches & 2) != 0,
                                        .grid = (switches & 4) != 0,
                                        .leaf_rows = rng.Chance(0.5)};
          for (const TestMesh& mesh : meshes) {
            const absl::StatusOr<Bvh> bvh = BuildBvh(mesh.geometry, options, pool);
            ASSERT_TRUE(bvh.ok()) << bvh.status();
            ASSERT_TRUE(ValidateBvh(*bvh, mesh.geometry).ok())
                << mesh.name << ": " << ValidateBvh(*bvh, mesh.geometry) << " bins " << bins
                << " leaf " << max_leaf << " cost " << traversal_cost << " switches " << switches;
            for (const BvhNode& node : bvh->nodes) {
              for (const ChildRef& child : node.child) {
                if (child.is_leaf()) {
                  ASSERT_LE(child.leaf_count(), static_cast<uint32_t>(max_leaf));
                }
              }
            }
          }
        }
      }
    }
  }
}

constexpr BvhPreset kPresets[] = {BvhPreset::kStatic, BvhPreset::kDynamic, BvhPreset::kCompact};

TEST(BvhBuilderTest, EveryPresetGivesValidTrees) {
  TestRng rng;
  ThreadPool pool(2);
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(20'000)))) {
    for (const BvhPreset preset : kPresets) {
      const absl::StatusOr<Bvh> bvh = BuildBvh(mesh.geometry, BvhPresetOptions(preset), pool);
      ASSERT_TRUE(bvh.ok()) << bvh.status();
      EXPECT_TRUE(ValidateBvh(*bvh, mesh.geometry).ok())
          << mesh.name << ", preset " << static_cast<int>(preset) << ": "
          << ValidateBvh(*bvh, mesh.geometry);
      EXPECT_EQ(bvh->empty(), mesh.geometry.triangles.size() == mesh.geometry.inert.size());
      if (!bvh->empty()) {
        EXPECT_EQ(bvh->has_leaf_rows(), preset != BvhPreset::kCompact);
      }
    }
  }
}

// Nearly all triangles stand in one cell of the grid, beside a few that span the scene.
TEST(BvhBuilderTest, CrowdedGridCellsGiveValidTrees) {
  TestRng rng;
  ThreadPool pool(2);
  SceneGeometry geometry = ScatteredTriangles(rng, static_cast<size_t>(ScaledCount(100'000)), 0.02);
  const size_t far = geometry.vertices.size();
  for (const float x : {-1e6f, 1e6f}) {
    const uint32_t first = static_cast<uint32_t>(geometry.vertices.size());
    for (const Vec3f& v : {Vec3f{x, x, 0}, Vec3f{x, 0, x}, Vec3f{0, x, x}}) {
      geometry.vertices.push_back(v);
    }
    geometry.triangles.push_back({first, first + 1, first + 2});
  }
  for (size_t i = far; i < geometry.vertices.size(); ++i) {
    geometry.bounds.Extend(geometry.vertices[i]);
  }
  const absl::StatusOr<Bvh> bvh = BuildBvh(geometry, BvhPresetOptions(BvhPreset::kDynamic), pool);
  ASSERT_TRUE(bvh.ok()) << bvh.status();
  EXPECT_TRUE(ValidateBvh(*bvh, geometry).ok()) << ValidateBvh(*bvh, geometry);
  EXPECT_LE(bvh->max_depth, 20u);
}

// What compact trees are for: the corners are a scene's own, not a leaf's.
TEST(BvhBuilderTest, CompactLeavesHoldFourBytesATriangle) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 20'000, 0.02);
  const absl::StatusOr<Bvh> full = BuildBvh(geometry, {}, pool);
  const absl::StatusOr<Bvh> compact =
      BuildBvh(geometry, BvhPresetOptions(BvhPreset::kCompact), pool);
  ASSERT_TRUE(full.ok() && compact.ok());
  EXPECT_GT(full->MemoryBytes(), 40u * 20'000);
  EXPECT_LT(compact->MemoryBytes(), 12u * 20'000);
}

// Large enough for ranges that are binned and partitioned in parallel, by chunks.
TEST(BvhBuilderTest, SameBytesWithAnyNumberOfThreads) {
  TestRng rng;
  std::vector<TestMesh> meshes = NastyMeshes(rng, 5000);
  const size_t many = static_cast<size_t>(ScaledCount(300'000, 3));
  meshes.push_back({"many", ScatteredTriangles(rng, many, 0.02)});
  for (const TestMesh& mesh : meshes) {
    for (const BvhPreset preset : kPresets) {
      const BvhBuildOptions options = BvhPresetOptions(preset);
      ThreadPool one(1);
      const absl::StatusOr<Bvh> expected = BuildBvh(mesh.geometry, options, one);
      ASSERT_TRUE(expected.ok()) << expected.status();
      for (int threads : {2, 4}) {
        ThreadPool pool(threads);
        for (int repeat = 0; repeat < 2; ++repeat) {
          const absl::StatusOr<Bvh> bvh = BuildBvh(mesh.geometry, options, pool);
          ASSERT_TRUE(bvh.ok()) << bvh.status();
          EXPECT_TRUE(SameBytes(*bvh, *expected))
              << mesh.name << ", preset " << static_cast<int>(preset) << ", " << threads
              << " threads";
        }
      }
      ASSERT_TRUE(ValidateBvh(*expected, mesh.geometry).ok())
          << mesh.name << ": " << ValidateBvh(*expected, mesh.geometry);
    }
  }
}

// Nothing distinguishes identical triangles: medians in whole leaves fill every leaf.
TEST(BvhBuilderTest, IdenticalTrianglesFillTheirLeaves) {
  ObjectInput object{.name = "same", .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}};
  for (int i = 0; i < 160'000; ++i) object.indices.insert(object.indices.end(), {0, 1, 2});
  const absl::StatusOr<SceneGeometry> geometry = CompileScene({&object, 1}, std::nullopt, {});
  ASSERT_TRUE(geometry.ok()) << geometry.status();
  ThreadPool pool(2);
  const absl::StatusOr<Bvh> bvh = BuildBvh(*geometry, {}, pool);
  ASSERT_TRUE(bvh.ok()) << bvh.status();
  EXPECT_EQ(bvh->leaf_count, 10'000u);
  EXPECT_LE(bvh->max_depth, 14u);
  EXPECT_TRUE(ValidateBvh(*bvh, *geometry).ok());
}

// Two triangles are worth one leaf side by side, and two where they are far apart.
TEST(BvhBuilderTest, FewTrianglesMakeALeafWhenItPays) {
  const auto build = [](double distance) {
    ObjectInput object{.name = "two"};
    for (double x : {0.0, distance}) {
      for (const Vec3d& v : {Vec3d{x, 0, 0}, Vec3d{x + 1, 0, 1}, Vec3d{x, 1, 0}}) {
        object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
        object.vertices.push_back(v);
      }
    }
    const absl::StatusOr<SceneGeometry> geometry = CompileScene({&object, 1}, std::nullopt, {});
    EXPECT_TRUE(geometry.ok());
    ThreadPool pool(1);
    absl::StatusOr<Bvh> bvh =
        BuildBvh(*geometry, {.traversal_cost = 0.1f, .full_leaves = false}, pool);
    EXPECT_TRUE(bvh.ok());
    EXPECT_TRUE(ValidateBvh(*bvh, *geometry).ok());
    return bvh->leaf_count;
  };
  EXPECT_EQ(build(0), 1u);
  EXPECT_EQ(build(1000), 2u);
}

TEST(BvhBuilderTest, LeavesAndNodesAreWellFilled) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 20'000, 0.02);
  const absl::StatusOr<Bvh> bvh = BuildBvh(geometry, {}, pool);
  ASSERT_TRUE(bvh.ok()) << bvh.status();
  EXPECT_GT(static_cast<double>(bvh->triangle_count) / bvh->leaf_count, 8.0);
  double children = 0;
  for (const BvhNode& node : bvh->nodes) children += node.child_count;
  EXPECT_GT(children / static_cast<double>(bvh->nodes.size()), 6.0);
}

TEST(BvhBuilderTest, RefusesOptionsOutOfRange) {
  ThreadPool pool(1);
  const SceneGeometry geometry;
  const auto expect = [&](const BvhBuildOptions& options, const std::string& part) {
    const absl::Status status = BuildBvh(geometry, options, pool).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  };
  expect({.bins = 1}, "bins = 1");
  expect({.bins = 257}, "bins = 257");
  expect({.max_leaf_triangles = 0}, "max_leaf_triangles = 0");
  expect({.max_leaf_triangles = 17}, "max_leaf_triangles = 17");
  expect({.traversal_cost = -1}, "traversal_cost = -1");
  expect({.traversal_cost = 1001}, "traversal_cost = 1001");
  expect({.traversal_cost = std::numeric_limits<float>::quiet_NaN()}, "traversal_cost = nan");
}

class ProgressTest : public ::testing::TestWithParam<BvhPreset> {};

TEST_P(ProgressTest, IsReportedAndBuildsStopWhenCancelled) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 50'000, 0.02);
  const BvhBuildOptions options = BvhPresetOptions(GetParam());
  Mutex mutex;
  std::vector<double> shares;
  ASSERT_TRUE(BuildBvh(geometry, options, pool, nullptr, [&](double share) {
                MutexLock lock(mutex);
                shares.push_back(share);
              }).ok());
  ASSERT_FALSE(shares.empty());
  EXPECT_EQ(shares.back(), 1.0);
  EXPECT_GT(shares.size(), 2u);
  for (double share : shares) EXPECT_TRUE(share > 0 && share <= 1) << share;

  CancelToken before;
  before.Cancel();
  EXPECT_EQ(BuildBvh(geometry, options, pool, &before).status().code(),
            absl::StatusCode::kCancelled);
  CancelToken during;
  std::atomic<int> calls{0};
  const absl::Status status = BuildBvh(geometry, options, pool, &during, [&](double) {
                                calls.fetch_add(1);
                                during.Cancel();
                              }).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_GE(calls.load(), 1);
}

INSTANTIATE_TEST_SUITE_P(Presets, ProgressTest, ::testing::ValuesIn(kPresets));

}  // namespace
}  // namespace sightline
