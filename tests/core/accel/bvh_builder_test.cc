// SPDX-License-Identifier: Apache-2.0
#include "core/accel/bvh_builder.h"

#include <atomic>
#include <cstring>
#include <limits>

#include "core/accel/bvh_validation.h"
#include "core/base/mutex.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::NastyMeshes;
using testing_support::ScaledCount;
using testing_support::ScatteredTriangles;
using testing_support::TestMesh;
using testing_support::TestRng;

bool SameBytes(const Bvh& a, const Bvh& b) {
  return a.nodes.size() == b.nodes.size() && a.leaves.size() == b.leaves.size() &&
         (a.nodes.empty() ||
          std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(BvhNode)) == 0) &&
         (a.leaves.empty() ||
          std::memcmp(a.leaves.data(), b.leaves.data(), a.leaves.size() * sizeof(float)) == 0) &&
         a.bounds == b.bounds && a.leaf_count == b.leaf_count &&
         a.triangle_count == b.triangle_count && a.max_depth == b.max_depth;
}

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
        for (bool longest : {false, true}) {
          const BvhBuildOptions options{.bins = bins,
                                        .max_leaf_triangles = max_leaf,
                                        .traversal_cost = traversal_cost,
                                        .longest_axis_only = longest};
          for (const TestMesh& mesh : meshes) {
            const absl::StatusOr<Bvh> bvh = BuildBvh(mesh.geometry, options, pool);
            ASSERT_TRUE(bvh.ok()) << bvh.status();
            ASSERT_TRUE(ValidateBvh(*bvh, mesh.geometry).ok())
                << mesh.name << ": " << ValidateBvh(*bvh, mesh.geometry) << " bins " << bins
                << " leaf " << max_leaf << " cost " << traversal_cost << " longest " << longest;
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

// Large enough for ranges that are binned and partitioned in parallel, by chunks.
TEST(BvhBuilderTest, SameBytesWithAnyNumberOfThreads) {
  TestRng rng;
  std::vector<TestMesh> meshes = NastyMeshes(rng, 5000);
  const size_t many = static_cast<size_t>(ScaledCount(300'000, 3));
  meshes.push_back({"many", ScatteredTriangles(rng, many, 0.02)});
  for (const TestMesh& mesh : meshes) {
    ThreadPool one(1);
    const absl::StatusOr<Bvh> expected = BuildBvh(mesh.geometry, {}, one);
    ASSERT_TRUE(expected.ok()) << expected.status();
    for (int threads : {2, 4}) {
      ThreadPool pool(threads);
      for (int repeat = 0; repeat < 2; ++repeat) {
        const absl::StatusOr<Bvh> bvh = BuildBvh(mesh.geometry, {}, pool);
        ASSERT_TRUE(bvh.ok()) << bvh.status();
        EXPECT_TRUE(SameBytes(*bvh, *expected)) << mesh.name << ", " << threads << " threads";
      }
    }
    ASSERT_TRUE(ValidateBvh(*expected, mesh.geometry).ok())
        << mesh.name << ": " << ValidateBvh(*expected, mesh.geometry);
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

TEST(BvhBuilderTest, ReportsProgressAndStopsWhenCancelled) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 50'000, 0.02);
  Mutex mutex;
  std::vector<double> shares;
  ASSERT_TRUE(BuildBvh(geometry, {}, pool, nullptr, [&](double share) {
                MutexLock lock(mutex);
                shares.push_back(share);
              }).ok());
  ASSERT_FALSE(shares.empty());
  EXPECT_EQ(shares.back(), 1.0);
  EXPECT_GT(shares.size(), 2u);
  for (double share : shares) EXPECT_TRUE(share > 0 && share <= 1) << share;

  CancelToken before;
  before.Cancel();
  EXPECT_EQ(BuildBvh(geometry, {}, pool, &before).status().code(), absl::StatusCode::kCancelled);
  CancelToken during;
  std::atomic<int> calls{0};
  const absl::Status status = BuildBvh(geometry, {}, pool, &during, [&](double) {
                                calls.fetch_add(1);
                                during.Cancel();
                              }).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
  EXPECT_GE(calls.load(), 1);
}

}  // namespace
}  // namespace sightline
