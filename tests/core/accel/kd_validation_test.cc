// SPDX-License-Identifier: Apache-2.0
//
// A valid tree, spoiled in one place at a time: every fault is found and named.
#include "core/accel/kd_validation.h"

#include <sys/resource.h>

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
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
  int spoiled = 0, wall_missed = 0;
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
    wall_missed += absl::StrContains(status.message(), absl::StrCat("triangle ", wall));
    ++spoiled;
  }
  EXPECT_GT(spoiled, 3);
  EXPECT_GT(wall_missed, 0);
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

// Trees as hostile files may hold them: below a node, so many empty leaves that whoever took every
// triangle to each of them, or kept them all, would be done for.
class HostileKdTreeTest : public ::testing::Test {
 protected:
  static constexpr uint32_t kCopies = 17'000;
  static constexpr int kEmptyLevels = 12;
  // Taking them all to each would take four times as much.
  static constexpr int64_t kMaxKibibytes = 512 << 10;
  static_assert(int64_t{kCopies} * 32 << kEmptyLevels > 4 * kMaxKibibytes * 1024);

  void AddTriangles(uint32_t copies, Vec3f a, Vec3f b, Vec3f c) {
    const auto first = static_cast<uint32_t>(geometry_.vertices.size());
    for (const Vec3f corner : {a, b, c}) {
      geometry_.vertices.push_back(corner);
      geometry_.bounds.Extend(corner);
    }
    geometry_.triangles.resize(geometry_.triangles.size() + copies, {first, first + 1, first + 2});
    tree_.triangle_count += copies;
    tree_.bounds = geometry_.bounds;
  }
  // Turns node `at` into an inner one; returns the first child.
  uint32_t Split(uint32_t at, int axis, float split) {
    const auto child = static_cast<uint32_t>(tree_.nodes.size());
    tree_.nodes.resize(tree_.nodes.size() + 2);
    tree_.nodes[at] = KdNode::Inner(axis, split, child);
    return child;
  }
  // Triangles first .. last - 1.
  void Leaf(uint32_t at, const Box3f& box, uint32_t first, uint32_t last) {
    tree_.nodes[at] = KdNode::Leaf(static_cast<uint32_t>(tree_.leaves.size()));
    tree_.leaves.push_back({{box.lo.x, box.lo.y, box.lo.z},
                            static_cast<uint32_t>(tree_.ids.size()),
                            {box.hi.x, box.hi.y, box.hi.z},
                            last - first});
    for (uint32_t id = first; id < last; ++id) tree_.ids.push_back(id);
  }
  void Emptiness(uint32_t at, const Box3f& cell, int levels) {
    if (levels == 0) return;
    const int axis = levels % 2;
    Box3f below = cell, above = cell;
    below.hi[axis] = above.lo[axis] = 0.5f * (cell.lo[axis] + cell.hi[axis]);
    const uint32_t child = Split(at, axis, below.hi[axis]);
    Emptiness(child, below, levels - 1);
    Emptiness(child + 1, above, levels - 1);
  }
  // What it says of the tree; fails where that takes too much memory.
  absl::Status Validate() const {
    const auto peak = [] {
      rusage usage{};
      EXPECT_EQ(getrusage(RUSAGE_SELF, &usage), 0);
      return int64_t{usage.ru_maxrss};
    };
    const int64_t before = peak();
    absl::Status status = ValidateKdTree(tree_, geometry_);
    EXPECT_LT(peak() - before, kMaxKibibytes);
    return status;
  }
  // Two small triangles, and copies of a large one whose z goes from 0 to `top`; the emptiness is
  // above z = 0.
  void LayFloor(float top) {
    AddTriangles(1, {0, 0, -1}, {0.5f, 0, -1}, {0, 0.5f, -0.5f});
    AddTriangles(kCopies, {0, 0, 0}, {1, 0, 0}, {0, 1, top});
    AddTriangles(1, {0, 0, 0.5f}, {0.5f, 0, 0.5f}, {0, 0.5f, 1});
    tree_.nodes.resize(1);
    const uint32_t floor = Split(0, 2, 0), roof = Split(floor + 1, 2, 0.25f);
    Emptiness(roof, {{0, 0, 0}, {1, 1, 0.25f}}, kEmptyLevels);
    Leaf(floor, {{0, 0, -1}, {1, 1, 0}}, 0, kCopies + 1);
    Leaf(roof + 1, {{0, 0, 0.5f}, {0.5f, 0.5f, 1}}, kCopies + 1, kCopies + 2);
    tree_.max_depth = 2 + kEmptyLevels;
  }

  SceneGeometry geometry_;
  KdTree tree_;
};

// They stand on the other side.
TEST_F(HostileKdTreeTest, ManyTrianglesInASplitAboveEmptiness) {
  LayFloor(0);
  EXPECT_TRUE(Validate().ok()) << Validate();
}

TEST_F(HostileKdTreeTest, ATriangleOnBothSidesOfItsSplit) {
  LayFloor(0);
  // The roof's leaf, which is beyond z = 0.25, becomes that of the cell above the floor.
  tree_.nodes.resize(3);
  tree_.leaves.pop_back();
  tree_.ids.pop_back();
  Leaf(2, {{0, 0, 0}, {1, 1, 1}}, kCopies, kCopies + 2);
  tree_.max_depth = 1;
  EXPECT_THAT(std::string(Validate().message()), HasSubstr("stands on both sides of it"));
}

TEST_F(HostileKdTreeTest, ManyTrianglesThatReachIntoEmptiness) {
  LayFloor(0.125f);
  // As if they began in the floor's cell.
  geometry_.vertices[3].z = -0.125f;
  EXPECT_THAT(std::string(Validate().message()), HasSubstr("stands in no leaf below it"));
}

// With perfect splits, triangles whose boxes alone reach there.
TEST_F(HostileKdTreeTest, ManyClippedTrianglesAroundEmptiness) {
  AddTriangles(kCopies, {1, 0, 0}, {0, 1, 0}, {0, 0, 1});
  tree_.nodes.resize(1);
  const uint32_t x = Split(0, 0, 0.75f), y = Split(x + 1, 1, 0.75f);
  Emptiness(y + 1, {{0.75f, 0.75f, 0}, {1, 1, 1}}, kEmptyLevels);
  Leaf(x, {{0, 0, 0}, {0.75f, 1, 1}}, 0, kCopies);
  Leaf(y, {{0.75f, 0, 0}, {1, 0.75f, 1}}, 0, kCopies);
  tree_.max_depth = 2 + kEmptyLevels;
  tree_.reach.resize(tree_.nodes.size(), Box3f());
  for (const uint32_t node : {0u, x, x + 1, y}) tree_.reach[node] = tree_.bounds;
  EXPECT_TRUE(Validate().ok()) << Validate();
}

TEST(KdValidationEmptyTest, NothingToHit) {
  EXPECT_TRUE(ValidateKdTree({}, {}).ok());
  KdTree tree;
  tree.max_depth = 1;
  EXPECT_FALSE(ValidateKdTree(tree, {}).ok());
}

}  // namespace
}  // namespace sightline
