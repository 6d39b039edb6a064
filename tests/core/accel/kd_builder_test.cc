// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_builder.h"

#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>

#include "core/accel/kd_sweep.h"
#include "core/accel/kd_validation.h"
#include "core/base/mutex.h"
#include "core/mesh/scene_compiler.h"
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

template <typename T>
bool SameBytes(const AlignedVector<T>& a, const AlignedVector<T>& b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}
bool SameBytes(const KdTree& a, const KdTree& b) {
  return SameBytes(a.nodes, b.nodes) && SameBytes(a.leaves, b.leaves) && SameBytes(a.ids, b.ids) &&
         SameBytes(a.reach, b.reach) && a.bounds == b.bounds && a.max_depth == b.max_depth &&
         a.triangle_count == b.triangle_count;
}

KdTree BuildValid(const SceneGeometry& geometry, const KdBuildOptions& options) {
  ThreadPool pool(2);
  absl::StatusOr<KdTree> tree = BuildKdTree(geometry, options, pool);
  EXPECT_TRUE(tree.ok()) << tree.status();
  if (!tree.ok()) return {};
  EXPECT_TRUE(ValidateKdTree(*tree, geometry).ok()) << ValidateKdTree(*tree, geometry);
  return *std::move(tree);
}

TEST(KdBuilderTest, EveryOptionGivesValidTrees) {
  TestRng rng;
  const std::vector<TestMesh> meshes = NastyMeshes(rng, static_cast<size_t>(ScaledCount(600, 3)));
  for (const bool perfect : {false, true}) {
    for (const float cost : {0.01f, 1.0f, 10.0f}) {
      for (const int min_leaf : {1, 4, 32}) {
        for (const bool bounded : {false, true}) {
          for (const int depth : {0, 1, 62}) {
            const KdBuildOptions options{.traversal_cost = cost,
                                         .perfect_splits = perfect,
                                         .min_leaf_triangles = min_leaf,
                                         .max_leaf_triangles = bounded ? min_leaf : 0,
                                         .max_depth = depth,
                                         .max_references = bounded ? 64.0f : 2.0f};
            for (const TestMesh& mesh : meshes) {
              SCOPED_TRACE(mesh.name);
              const KdTree tree = BuildValid(mesh.geometry, options);
              ASSERT_FALSE(HasFailure())
                  << "perfect " << perfect << " cost " << cost << " leaf " << min_leaf
                  << " bounded " << bounded << " depth " << depth;
              EXPECT_EQ(tree.empty(), mesh.geometry.triangles.size() == mesh.geometry.inert.size());
              EXPECT_EQ(tree.perfect(), perfect && !tree.empty());
              EXPECT_LE(static_cast<double>(tree.ids.size()),
                        static_cast<double>(options.max_references) * tree.triangle_count);
              if (depth != 0) {
                EXPECT_LE(tree.max_depth, static_cast<uint32_t>(depth));
              } else if (!tree.empty()) {
                EXPECT_LE(tree.max_depth, 8 + 1.3 * std::log2(tree.triangle_count));
              }
            }
          }
        }
      }
    }
  }
}

// Large enough for halves, sweeps and sorts that run side by side.
TEST(KdBuilderTest, SameBytesWithAnyNumberOfThreads) {
  TestRng rng;
  std::vector<TestMesh> meshes = NastyMeshes(rng, 5000);
  const size_t many = static_cast<size_t>(ScaledCount(60'000, 3));
  meshes.push_back({"many", ScatteredTriangles(rng, many, 0.02)});
  for (const TestMesh& mesh : meshes) {
    for (const bool perfect : {false, true}) {
      const KdBuildOptions options{.perfect_splits = perfect};
      ThreadPool one(1);
      const absl::StatusOr<KdTree> expected = BuildKdTree(mesh.geometry, options, one);
      ASSERT_TRUE(expected.ok()) << expected.status();
      ASSERT_TRUE(ValidateKdTree(*expected, mesh.geometry).ok())
          << mesh.name << ": " << ValidateKdTree(*expected, mesh.geometry);
      for (const int threads : {2, 4}) {
        ThreadPool pool(threads);
        const absl::StatusOr<KdTree> tree = BuildKdTree(mesh.geometry, options, pool);
        ASSERT_TRUE(tree.ok()) << tree.status();
        EXPECT_TRUE(SameBytes(*tree, *expected)) << mesh.name << ", " << threads << " threads";
      }
    }
  }
}

// The sweep finds what trying every plane finds.
TEST(KdSweepTest, FindsTheLeastCost) {
  TestRng rng;
  for (int round = 0; round < 200; ++round) {
    const Box3f cell{{0, 0, 0}, {8, 4, 2}};
    std::vector<Box3f> boxes(1 + rng.Below(12));
    kd_build::KdEvents events;
    for (size_t i = 0; i < boxes.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        // On a coarse grid: many coincide.
        const auto at = [&] { return cell.hi[axis] * static_cast<float>(rng.Below(9)) / 8; };
        const float p = at(), q = at();
        boxes[i].lo[axis] = std::min(p, q);
        boxes[i].hi[axis] = std::max(p, q);
        kd_build::AppendEvents(boxes[i], static_cast<uint32_t>(i), axis, &events[axis]);
      }
    }
    for (auto& list : events) std::sort(list.begin(), list.end());
    double least = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      for (int step = 1; step < 8; ++step) {
        const float at = cell.hi[axis] * static_cast<float>(step) / 8;
        bool candidate = false;
        int below = 0, above = 0, flat = 0;
        for (const Box3f& box : boxes) {
          const float lo = box.lo[axis], hi = box.hi[axis];
          candidate |= lo == at || hi == at;
          flat += lo == at && hi == at;
          below += lo < at;
          above += hi > at;
        }
        if (!candidate) continue;
        Box3f lower = cell, upper = cell;
        lower.hi[axis] = upper.lo[axis] = at;
        for (const int flat_below : {0, flat}) {
          const int n_below = below + flat_below, n_above = above + flat - flat_below;
          double cost = 1.5 + (static_cast<double>(lower.HalfArea()) * n_below +
                               static_cast<double>(upper.HalfArea()) * n_above) /
                                  static_cast<double>(cell.HalfArea());
          if (n_below == 0 || n_above == 0) cost *= kd_build::kEmptyBonus;
          least = std::min(least, cost);
        }
      }
    }
    const kd_build::KdSplit split = kd_build::FindKdSplit(cell, boxes.size(), events, 1.5);
    if (std::isinf(least)) {
      EXPECT_EQ(split.axis, -1);
    } else {
      EXPECT_NEAR(split.cost, least, 1e-6);
    }
  }
}

TEST(KdBuilderTest, CostRatioGovernsTheSize) {
  TestRng rng;
  const SceneGeometry geometry = ScatteredTriangles(rng, 5000, 0.02);
  size_t nodes = std::numeric_limits<size_t>::max();
  for (const float cost : {0.01f, 0.1f, 1.0f, 10.0f}) {
    const KdTree tree = BuildValid(geometry, {.traversal_cost = cost});
    EXPECT_LT(tree.nodes.size(), nodes) << cost;
    nodes = tree.nodes.size();
  }
}

TEST(KdBuilderTest, LeafSizesAreKept) {
  TestRng rng;
  const SceneGeometry geometry = ScatteredTriangles(rng, 5000, 0.01);
  const KdTree few = BuildValid(
      geometry,
      {.traversal_cost = 10, .max_leaf_triangles = 6, .max_depth = 62, .max_references = 64});
  uint32_t most = 0;
  for (const KdLeaf& leaf : few.leaves) most = std::max(most, leaf.count);
  EXPECT_LE(most, 6u);
  // No node of sixteen or fewer was split: pairs of leaves hold more together.
  const KdTree full = BuildValid(geometry, {.traversal_cost = 0.01f, .min_leaf_triangles = 16});
  EXPECT_GT(static_cast<double>(full.ids.size()) / static_cast<double>(full.leaves.size()), 6.0);
}

TEST(KdBuilderTest, BytesAreKept) {
  TestRng rng;
  constexpr size_t kTriangles = 3000;
  const SceneGeometry geometry = ScatteredTriangles(rng, kTriangles, 0.3);
  for (const bool perfect : {false, true}) {
    KdBuildOptions options = {.traversal_cost = 0.1f, .perfect_splits = perfect};
    const KdTree free = BuildValid(geometry, options);
    const size_t one_leaf = sizeof(KdNode) + (perfect ? sizeof(Box3f) : 0) + sizeof(KdLeaf) +
                            kTriangles * sizeof(uint32_t);
    size_t before = 0;
    for (const size_t most :
         {size_t{1}, one_leaf, free.MemoryBytes() / 4, free.MemoryBytes() / 2}) {
      options.max_bytes = most;
      const size_t bytes = BuildValid(geometry, options).MemoryBytes();
      EXPECT_LE(bytes, std::max(most, one_leaf));
      EXPECT_GE(bytes, std::max(before, most / 2));
      before = bytes;
    }
    options.max_bytes = uint64_t{1} << 60;
    EXPECT_EQ(BuildValid(geometry, options).nodes.size(), free.nodes.size());
  }
}

// A slanted quadrilateral's box is full of cells that it is not in.
TEST(KdBuilderTest, PerfectSplitsSpareSlantedTriangles) {
  ObjectInput object{.name = "slanted"};
  constexpr int kStrips = 300;
  for (int i = 0; i < kStrips; ++i) {
    const double at = i / static_cast<double>(kStrips);
    for (const Vec3d& v : {Vec3d{at, 0, 0}, Vec3d{at + 1, 1, 0.5}, Vec3d{at + 1, 1, 1}}) {
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(v);
    }
  }
  const absl::StatusOr<SceneGeometry> geometry = CompileScene({&object, 1}, std::nullopt, {});
  ASSERT_TRUE(geometry.ok()) << geometry.status();
  const auto mean_leaf = [&](bool perfect) {
    const KdTree tree = BuildValid(*geometry, {.traversal_cost = 0.1f, .perfect_splits = perfect});
    return static_cast<double>(tree.ids.size()) / static_cast<double>(tree.leaves.size());
  };
  EXPECT_LT(mean_leaf(true), mean_leaf(false));
}

// One triangle in a corner of a room's worth of space: the splits that free it are its leaf's box.
TEST(KdBuilderTest, EmptyCellsFoldIntoLeafBoxes) {
  ObjectInput object{.name = "two"};
  for (const double at : {0.0, 100.0}) {
    for (const Vec3d& v : {Vec3d{at, at, at}, Vec3d{at + 1, at, at}, Vec3d{at, at + 1, at}}) {
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(v);
    }
  }
  const absl::StatusOr<SceneGeometry> geometry = CompileScene({&object, 1}, std::nullopt, {});
  ASSERT_TRUE(geometry.ok()) << geometry.status();
  const KdTree tree = BuildValid(*geometry, {.traversal_cost = 0.01f});
  ASSERT_EQ(tree.leaves.size(), 2u);
  EXPECT_LE(tree.nodes.size(), 5u);
  EXPECT_EQ(tree.leaves[0].box(), (Box3f{{0, 0, 0}, {1, 1, 0}}));
}

TEST(KdBuilderTest, RefusesOptionsOutOfRange) {
  ThreadPool pool(1);
  const SceneGeometry geometry;
  const auto expect = [&](const KdBuildOptions& options, const std::string& part) {
    const absl::Status status = BuildKdTree(geometry, options, pool).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  };
  expect({.traversal_cost = 0.001f}, "traversal_cost = 0.001");
  expect({.traversal_cost = 11}, "traversal_cost = 11");
  expect({.traversal_cost = std::numeric_limits<float>::quiet_NaN()}, "traversal_cost = nan");
  expect({.min_leaf_triangles = 0}, "min_leaf_triangles = 0");
  expect({.min_leaf_triangles = 5, .max_leaf_triangles = 4}, "max_leaf_triangles = 4");
  expect({.max_depth = 63}, "max_depth = 63");
  expect({.max_references = 0.5f}, "max_references = 0.5");
}

TEST(KdBuilderTest, ReportsProgressAndStopsWhenCancelled) {
  TestRng rng;
  ThreadPool pool(2);
  const SceneGeometry geometry = ScatteredTriangles(rng, 20'000, 0.02);
  Mutex mutex;
  std::vector<double> shares;
  ASSERT_TRUE(BuildKdTree(geometry, {}, pool, nullptr, [&](double share) {
                MutexLock lock(mutex);
                shares.push_back(share);
              }).ok());
  ASSERT_GT(shares.size(), 2u);
  EXPECT_EQ(shares.back(), 1.0);
  for (const double share : shares) EXPECT_TRUE(share > 0 && share <= 1) << share;

  CancelToken before;
  before.Cancel();
  EXPECT_EQ(BuildKdTree(geometry, {}, pool, &before).status().code(), absl::StatusCode::kCancelled);
  CancelToken during;
  const absl::Status status =
      BuildKdTree(geometry, {}, pool, &during, [&](double) { during.Cancel(); }).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace sightline
