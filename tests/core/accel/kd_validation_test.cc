// SPDX-License-Identifier: Apache-2.0
//
// A valid tree, spoiled in one place at a time: every fault is found and named.
#include "core/accel/kd_validation.h"

#include <cmath>
#include <functional>
#include <utility>

#include "absl/strings/match.h"
#include "core/accel/kd_builder.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::ScatteredTriangles;
using testing_support::TestRng;

class KdValidationTest : public ::testing::Test {
 protected:
  void SetUp() override {
    geometry_ = ScatteredTriangles(rng_, 1500, 0.05);
    // One inert triangle, the last.
    geometry_.triangles.push_back({0, 0, 0});
    geometry_.inert = {1500};
    tree_ = Build({});
  }

  KdTree Build(const KdBuildOptions& options) const {
    ThreadPool pool(1);
    absl::StatusOr<KdTree> tree = BuildKdTree(geometry_, options, pool);
    EXPECT_TRUE(tree.ok()) << tree.status();
    EXPECT_TRUE(ValidateKdTree(*tree, geometry_).ok()) << ValidateKdTree(*tree, geometry_);
    return *std::move(tree);
  }

  void ExpectFault(const std::string& part, const std::function<void(KdTree&)>& spoil) const {
    KdTree spoiled = tree_;
    spoil(spoiled);
    const absl::Status status = ValidateKdTree(spoiled, geometry_);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << "instead of " << part;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }

  uint32_t Find(const std::function<bool(const KdNode&)>& is) const {
    for (uint32_t i = 0; i < tree_.nodes.size(); ++i) {
      if (is(tree_.nodes[i])) return i;
    }
    ADD_FAILURE() << "no such node";
    return 0;
  }

  TestRng rng_;
  SceneGeometry geometry_;
  KdTree tree_;
};

TEST_F(KdValidationTest, Nodes) {
  const KdNode root = tree_.nodes[0];
  ASSERT_FALSE(root.is_leaf());
  const int axis = root.axis();
  ExpectFault("node 0 refers to nodes 4000000",
              [&](KdTree& t) { t.nodes[0] = KdNode::Inner(axis, root.split(), 4'000'000); });
  ExpectFault("is reached twice",
              [&](KdTree& t) { t.nodes[0] = KdNode::Inner(axis, root.split(), 0); });
  for (const float at : {tree_.bounds.lo[axis], tree_.bounds.hi[axis], std::nanf("")}) {
    ExpectFault("not within its cell",
                [&](KdTree& t) { t.nodes[0] = KdNode::Inner(axis, at, root.first_child()); });
  }
  ExpectFault("is never reached", [&](KdTree& t) { t.nodes.push_back(KdNode::EmptyLeaf()); });
  const uint32_t leaf = Find([](const KdNode& n) { return n.is_leaf() && !n.is_empty_leaf(); });
  ExpectFault("comes next", [&](KdTree& t) { t.nodes[leaf] = KdNode::Leaf(123'456'789); });
  ExpectFault("comes next", [&](KdTree& t) { t.nodes[leaf] = KdNode::EmptyLeaf(); });
}

// A triangle that lies in a split stands on one side of it, there in every leaf that it reaches.
TEST_F(KdValidationTest, TrianglesInSplits) {
  const Box3f bounds = geometry_.bounds;
  const float x = 0.5f * (bounds.lo.x + bounds.hi.x);
  const auto first = static_cast<uint32_t>(geometry_.vertices.size());
  geometry_.vertices.push_back({x, bounds.lo.y, bounds.lo.z});
  geometry_.vertices.push_back({x, bounds.hi.y, bounds.lo.z});
  geometry_.vertices.push_back({x, bounds.hi.y, bounds.hi.z});
  // So many lie in it that no plane is cheaper.
  geometry_.triangles.resize(geometry_.triangles.size() + 40, {first, first + 1, first + 2});
  const auto wall = static_cast<uint32_t>(geometry_.triangles.size() - 1);
  tree_ = Build({});
  int spoiled = 0, in_split = 0;
  for (size_t l = 0; l < tree_.leaves.size(); ++l) {
    const auto ids = tree_.LeafIds(tree_.leaves[l]);
    if (ids.size() < 2 || ids.back() != wall) continue;
    // The leaf no longer names it.
    KdTree tree = tree_;
    const size_t at = tree.leaves[l].first + tree.leaves[l].count - 1;
    for (size_t i = at; i + 1 < tree.ids.size(); ++i) tree.ids[i] = tree.ids[i + 1];
    tree.ids.pop_back();
    --tree.leaves[l].count;
    for (size_t later = l + 1; later < tree.leaves.size(); ++later) --tree.leaves[later].first;
    const absl::Status status = ValidateKdTree(tree, geometry_);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << "leaf " << l;
    in_split += absl::StrContains(status.message(), "on either side of it");
    ++spoiled;
  }
  EXPECT_GT(spoiled, 3);
  EXPECT_GT(in_split, 0);
}

// With perfect splits, too, no leaf's box may be smaller by a float than what reaches into it.
TEST_F(KdValidationTest, BoxesOfClippedTriangles) {
  tree_ = Build({.perfect_splits = true});
  int spoiled = 0;
  for (size_t l = 0; l < tree_.leaves.size(); ++l) {
    const Box3f box = tree_.leaves[l].box();
    for (const uint32_t id : tree_.LeafIds(tree_.leaves[l])) {
      for (const Vec3f& corner : geometry_.Corners(id)) {
        if (corner.x != box.lo.x || !(corner.y >= box.lo.y && corner.y <= box.hi.y) ||
            !(corner.z >= box.lo.z && corner.z <= box.hi.z)) {
          continue;
        }
        KdTree tree = tree_;
        tree.leaves[l].lo[0] = std::nextafter(box.lo.x, box.hi.x);
        EXPECT_EQ(ValidateKdTree(tree, geometry_).code(), absl::StatusCode::kDataLoss) << l;
        ++spoiled;
      }
    }
  }
  EXPECT_GT(spoiled, 10);
}

TEST_F(KdValidationTest, Leaves) {
  ExpectFault("leaf 3 has ids", [](KdTree& t) { t.leaves[3].first += 1; });
  ExpectFault("leaf 3 has ids", [](KdTree& t) { t.leaves[3].count = 0; });
  ExpectFault("has ids", [](KdTree& t) { t.leaves.back().count += 1; });
  ExpectFault("ids of", [](KdTree& t) { t.ids.push_back(0); });
  ExpectFault("holds triangle 70000", [](KdTree& t) { t.ids[0] = 70'000; });
  ExpectFault("which is inert", [](KdTree& t) { t.ids[0] = 1500; });
  ExpectFault("in order", [](KdTree& t) {
    for (const KdLeaf& leaf : t.leaves) {
      if (leaf.count > 1) return std::swap(t.ids[leaf.first], t.ids[leaf.first + 1]);
    }
  });
  ExpectFault("not within its cell", [](KdTree& t) { t.leaves[2].lo[1] -= 1; });
  ExpectFault("not its triangles'", [](KdTree& t) { t.leaves[2].lo[1] = t.leaves[2].hi[1]; });
}

TEST_F(KdValidationTest, TrianglesThatAreMissingOrOutOfPlace) {
  // A stranger in a leaf of one: its box would have to be the stranger's.
  ExpectFault("leaf", [](KdTree& t) { t.ids[0] = (t.ids[0] + 750) % 1500; });
  // Take a triangle from a leaf of several where its absence does not show in the box.
  bool tried = false;
  for (size_t i = 0; i < tree_.leaves.size() && !tried; ++i) {
    for (uint32_t k = 0; k < tree_.leaves[i].count && tree_.leaves[i].count > 2 && !tried; ++k) {
      KdTree spoiled = tree_;
      const uint32_t at = spoiled.leaves[i].first + k;
      AlignedVector<uint32_t> ids;
      for (uint32_t j = 0; j < spoiled.ids.size(); ++j) {
        if (j != at) ids.push_back(spoiled.ids[j]);
      }
      spoiled.ids = ids;
      --spoiled.leaves[i].count;
      for (size_t j = i + 1; j < spoiled.leaves.size(); ++j) --spoiled.leaves[j].first;
      const absl::Status status = ValidateKdTree(spoiled, geometry_);
      EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
      tried = absl::StrContains(status.message(), "does not stand in its leaf");
    }
  }
  EXPECT_TRUE(tried);
}

TEST_F(KdValidationTest, CountsAndBounds) {
  ExpectFault("it counts", [](KdTree& t) { ++t.triangle_count; });
  ExpectFault("its depth is", [](KdTree& t) { ++t.max_depth; });
  ExpectFault("its bounds", [](KdTree& t) { t.bounds.hi.x += 1; });
  ExpectFault("no nodes", [](KdTree& t) { t.nodes.clear(); });
  ExpectFault("reaches for", [](KdTree& t) { t.reach.push_back(Box3f()); });
}

TEST_F(KdValidationTest, Reach) {
  tree_ = Build({.perfect_splits = true});
  ExpectFault("node 5 has another reach", [](KdTree& t) { t.reach[5].lo.x -= 1; });
}

TEST_F(KdValidationTest, CancelledTokensEndIt) {
  CancelToken cancel;
  EXPECT_TRUE(ValidateKdTree(tree_, geometry_, &cancel).ok());
  cancel.Cancel();
  EXPECT_EQ(ValidateKdTree(tree_, geometry_, &cancel).code(), absl::StatusCode::kCancelled);
}

// Larger than what one thread takes by itself, with triangles in the planes of splits.
TEST_F(KdValidationTest, LargeTreesAreCheckedBySubtrees) {
  geometry_ = ScatteredTriangles(rng_, 40'000, 0.05);
  for (size_t i = 0; i < geometry_.vertices.size(); i += 9) {
    // Flat ones share planes, so that some are splits.
    for (size_t k = 0; k < 3; ++k) {
      geometry_.vertices[i + k].x = 0.125f * std::round(8 * geometry_.vertices[i].x);
    }
  }
  geometry_.bounds = Box3f();
  for (const Vec3f& v : geometry_.vertices) geometry_.bounds.Extend(v);
  for (const bool perfect : {false, true}) {
    tree_ = Build({.perfect_splits = perfect});
    ASSERT_GT(tree_.ids.size(), 40'000u);
    ExpectFault("leaf", [](KdTree& t) { t.ids.back() = (t.ids.back() + 20'000) % 40'000; });
    ExpectFault("leaf", [](KdTree& t) { t.leaves.back().lo[2] -= 0.001f; });
  }
}

TEST(KdValidationEmptyTest, NothingToHit) {
  EXPECT_TRUE(ValidateKdTree({}, {}).ok());
  KdTree tree;
  tree.max_depth = 1;
  EXPECT_FALSE(ValidateKdTree(tree, {}).ok());
}

}  // namespace
}  // namespace sightline
