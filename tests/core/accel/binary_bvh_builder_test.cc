// SPDX-License-Identifier: Apache-2.0
#include "core/accel/binary_bvh_builder.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/accel/bvh.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::NastyMeshes;
using testing_support::ScaledCount;
using testing_support::ScatteredTriangles;
using testing_support::TestMesh;
using testing_support::TestRng;

BinaryBvh Build(const SceneGeometry& geometry, const BinaryBvhOptions& options, int threads = 2) {
  ThreadPool pool(threads);
  absl::StatusOr<BinaryBvh> bvh = BuildBinaryBvh(geometry, options, pool);
  EXPECT_TRUE(bvh.ok()) << bvh.status();
  return *std::move(bvh);
}

struct Walked {
  std::vector<int> seen;
  uint32_t leaves = 0, depth = 0;
};

// Every box is the hull of what is below, every triangle stands in one leaf.
Box3f Check(const SceneGeometry& geometry, const BinaryBvh& bvh, uint32_t at, uint32_t depth,
            Walked* walked) {
  const BinaryBvhNode& node = bvh.nodes[at];
  Box3f hull;
  if (node.is_leaf()) {
    ++walked->leaves;
    walked->depth = std::max(walked->depth, depth);
    for (uint32_t i = node.first; i < node.first + node.count; ++i) {
      const uint32_t id = bvh.ids[i];
      ++walked->seen[id];
      if (i > node.first) {
        EXPECT_LT(bvh.ids[i - 1], id);
      }
      Box3f box;
      const auto corners = geometry.Corners(id);
      const size_t stride = bvh.leaves.stride;
      for (size_t c = 0; c < 3; ++c) {
        box.Extend(corners[c]);
        for (int k = 0; k < 3; ++k) {
          EXPECT_EQ(bvh.leaves.rows[(3 * c + k) * stride + i], corners[c][k]);
        }
      }
      EXPECT_EQ(std::bit_cast<uint32_t>(bvh.leaves.rows[9 * stride + i]), id);
      for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(bvh.leaves.boxes[k * stride + i], box.lo[k]);
        EXPECT_EQ(bvh.leaves.boxes[(3 + k) * stride + i], box.hi[k]);
      }
      hull.Extend(box);
    }
  } else {
    EXPECT_LT(node.first + 1, bvh.nodes.size());
    hull = Check(geometry, bvh, node.first, depth + 1, walked);
    hull.Extend(Check(geometry, bvh, node.first + 1, depth + 1, walked));
  }
  EXPECT_EQ(hull, node.box());
  return hull;
}

void CheckAll(const SceneGeometry& geometry, const BinaryBvh& bvh,
              const BinaryBvhOptions& options) {
  Walked walked;
  walked.seen.assign(geometry.triangles.size(), 0);
  if (bvh.empty()) {
    EXPECT_EQ(geometry.inert.size(), geometry.triangles.size());
    return;
  }
  Check(geometry, bvh, 0, 0, &walked);
  for (const uint32_t id : geometry.inert) ++walked.seen[id];
  for (size_t id = 0; id < walked.seen.size(); ++id) ASSERT_EQ(walked.seen[id], 1) << id;
  EXPECT_EQ(walked.leaves, bvh.leaf_count);
  EXPECT_EQ(walked.depth, bvh.max_depth);
  EXPECT_LE(bvh.max_depth, static_cast<uint32_t>(options.max_depth));
  EXPECT_EQ(bvh.nodes.size(), 2 * size_t{bvh.leaf_count} - 1);
  // Sixteen may be loaded from any place.
  EXPECT_GE(bvh.leaves.stride, bvh.ids.size() + kLeafPadding - 1);
}

TEST(BinaryBvhBuilderTest, NastyMeshesGiveValidTreesWithEveryOption) {
  TestRng rng;
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(2000, 4)))) {
    SCOPED_TRACE(mesh.name);
    for (const int bins : {2, 8, 65, 1024}) {
      for (const float ratio : {0.01f, 1.0f, 100.0f}) {
        const BinaryBvhOptions options = {.bins = bins, .cost_ratio = ratio};
        CheckAll(mesh.geometry, Build(mesh.geometry, options), options);
      }
    }
    const BinaryBvhOptions shallow = {.max_depth = 3};
    CheckAll(mesh.geometry, Build(mesh.geometry, shallow), shallow);
  }
}

TEST(BinaryBvhBuilderTest, TheTreeDoesNotDependOnTheThreads) {
  TestRng rng;
  const SceneGeometry geometry =
      ScatteredTriangles(rng, static_cast<size_t>(ScaledCount(30'000)), 0.02);
  const BinaryBvh one = Build(geometry, {}, 1), four = Build(geometry, {}, 4);
  EXPECT_EQ(one.ids, four.ids);
  ASSERT_EQ(one.nodes.size(), four.nodes.size());
  for (size_t i = 0; i < one.nodes.size(); ++i) {
    ASSERT_EQ(one.nodes[i].first, four.nodes[i].first) << i;
    ASSERT_EQ(one.nodes[i].count, four.nodes[i].count) << i;
    ASSERT_EQ(one.nodes[i].box(), four.nodes[i].box()) << i;
  }
}

// Coordinates of few bits, which halve and scale exactly down to the smallest floats: whatever the
// scale, trees are the same.
TEST(BinaryBvhBuilderTest, TheTreeDoesNotDependOnTheScale) {
  TestRng rng;
  ObjectInput object;
  for (uint32_t i = 0; i < 3 * 2000; ++i) {
    const Vec3d near = i % 3 == 0 ? Vec3d{} : object.vertices[i - i % 3];
    const auto coordinate = [&](double from) {
      return i % 3 == 0 ? 2.0 * static_cast<double>(rng.Below(120))
                        : from + 2.0 * static_cast<double>(rng.Below(8));
    };
    object.vertices.push_back({coordinate(near.x), coordinate(near.y), coordinate(near.z)});
    object.indices.push_back(i);
  }
  const auto build = [&](double scale) {
    ObjectInput scaled = object;
    for (Vec3d& v : scaled.vertices) v = v * scale;
    const auto geometry = CompileScene({&scaled, 1}, Vec3d{}, {});
    EXPECT_TRUE(geometry.ok()) << geometry.status();
    return Build(*geometry, {});
  };
  const BinaryBvh usual = build(1);
  EXPECT_GT(usual.leaf_count, 500u);
  for (const double scale : {0x1p-149, 0x1p-130, 0x1p-60, 0x1p32}) {
    const BinaryBvh bvh = build(scale);
    EXPECT_EQ(bvh.ids, usual.ids) << scale;
    ASSERT_EQ(bvh.nodes.size(), usual.nodes.size()) << scale;
    for (size_t i = 0; i < bvh.nodes.size(); ++i) {
      ASSERT_EQ(bvh.nodes[i].first, usual.nodes[i].first) << scale << ' ' << i;
      ASSERT_EQ(bvh.nodes[i].count, usual.nodes[i].count) << scale << ' ' << i;
    }
  }
}

TEST(BinaryBvhBuilderTest, EachRuleEndsBranches) {
  TestRng rng;
  const SceneGeometry geometry = ScatteredTriangles(rng, 4000, 0.02);
  const auto leaves = [&](const BinaryBvhOptions& options) {
    return Build(geometry, options).leaf_count;
  };
  const uint32_t all = leaves({.stop_by_cost = false});
  EXPECT_EQ(all, 4000u) << "one triangle a leaf";
  EXPECT_LT(leaves({}), all);
  EXPECT_LT(leaves({.cost_ratio = 0.1f}), leaves({}));
  EXPECT_LE(leaves({.max_depth = 4, .stop_by_cost = false}), 16u);
  const BinaryBvh of_sixteen = Build(geometry, {.min_triangles = 16, .stop_by_cost = false});
  for (const BinaryBvhNode& node : of_sixteen.nodes) EXPECT_LE(node.count, 16u);
  EXPECT_LT(of_sixteen.leaf_count, all / 8);
  EXPECT_LT(leaves({.stop_by_cost = false, .min_extent = 0.25f}), 200u);
}

TEST(BinaryBvhBuilderTest, OptionsOutOfRangeAreNamed) {
  ThreadPool pool(1);
  const SceneGeometry geometry;
  const auto error = [&](const BinaryBvhOptions& options) {
    const absl::Status status = BuildBinaryBvh(geometry, options, pool).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_EQ(error({.bins = 1}), "bins is 1; it must be 2 to 1024");
  EXPECT_EQ(error({.cost_ratio = 0}), "cost_ratio is 0; it must be 0.001 to 1000");
  EXPECT_NE(error({.cost_ratio = std::numeric_limits<float>::quiet_NaN()}).find("nan"),
            std::string::npos);
  EXPECT_EQ(error({.min_triangles = 0}), "min_triangles is 0; it must be 1 to 1048576");
  EXPECT_EQ(error({.max_depth = 97}), "max_depth is 97; it must be 1 to 96");
  EXPECT_EQ(error({.min_extent = 2}), "min_extent is 2; it must be 0 to 1");
}

TEST(BinaryBvhBuilderTest, ACancelledBuildSaysSo) {
  TestRng rng;
  const SceneGeometry geometry = ScatteredTriangles(rng, 10'000, 0.02);
  ThreadPool pool(2);
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(BuildBinaryBvh(geometry, {}, pool, &cancel).status().code(),
            absl::StatusCode::kCancelled);
}

TEST(BinaryBvhBuilderTest, RefusesMoreTrianglesThanItsNodesAreNumberedFor) {
  // Said to be so many, and never looked at.
  using Triangles = AlignedVector<std::array<uint32_t, 3>>;
  const auto one = std::make_shared<const Triangles>(1);
  SceneGeometry geometry;
  geometry.triangles = Triangles::Borrow({one->begin(), (size_t{1} << 31) + 1}, one);
  ThreadPool pool(1);
  const absl::Status status = BuildBinaryBvh(geometry, {.stop_by_cost = false}, pool).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
  EXPECT_NE(std::string(status.message()).find("2147483649 triangles"), std::string::npos);
}

}  // namespace
}  // namespace sightline
