// SPDX-License-Identifier: Apache-2.0
#include "core/accel/wide_cost.h"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::bvh_build {
namespace {

using testing_support::TestRng;

struct Node {
  float area;
  uint32_t count;
  int left = -1, right = -1;
  WideCost wide;
};

// A random binary tree, children after their parents in the list.
std::vector<Node> RandomTree(TestRng& rng, uint32_t count) {
  std::vector<Node> tree = {{1.0f, count, -1, -1, {}}};
  for (size_t i = 0; i < tree.size(); ++i) {
    if (tree[i].count <= 4) continue;
    const uint32_t left = 1 + static_cast<uint32_t>(rng.Below(tree[i].count - 1));
    const float area = tree[i].area;
    tree[i].left = static_cast<int>(tree.size());
    tree[i].right = tree[i].left + 1;
    const uint32_t right = tree[i].count - left;
    tree.push_back({area * static_cast<float>(rng.Uniform(0.3, 1)), left, -1, -1, {}});
    tree.push_back({area * static_cast<float>(rng.Uniform(0.3, 1)), right, -1, -1, {}});
  }
  return tree;
}

void Evaluate(std::vector<Node>& tree, const SahCost& cost) {
  for (size_t i = tree.size(); i-- > 0;) {
    Node& n = tree[i];
    if (n.left < 0) {
      n.wide.SetLeaf(n.area, n.count, cost);
    } else {
      n.wide.SetInner(n.area, n.count, tree[n.left].wide, tree[n.right].wide, cost);
    }
  }
}

// The cost of what the choices say, added up.
class Replay {
 public:
  Replay(const std::vector<Node>& tree, const SahCost& cost) : tree_(tree), cost_(cost) {}

  float AsChild(int i) const {
    const Node& n = tree_[i];
    if (n.wide.is_leaf()) return n.area * cost_.Leaf(n.count);
    return n.area * cost_.node_visit + Split(i, kWidth);
  }

 private:
  float Split(int i, int slots) const {
    const int left = tree_[i].wide.LeftChildren(slots);
    return AsForest(tree_[i].left, left) + AsForest(tree_[i].right, slots - left);
  }
  float AsForest(int i, int slots) const {
    if (!tree_[i].wide.is_binary_leaf()) {
      while (slots > 1 && tree_[i].wide.LeftChildren(slots) == 0) --slots;
      if (slots > 1) return Split(i, slots);
    }
    return AsChild(i);
  }

  const std::vector<Node>& tree_;
  const SahCost& cost_;
};

// The least over every way, top-down from its definition.
class LeastCost {
 public:
  LeastCost(const std::vector<Node>& tree, const SahCost& cost) : tree_(tree), cost_(cost) {}

  // Of representing subtree `i` by at most `slots` children.
  float Of(int i, int slots) {
    const auto known = known_.find({i, slots});
    if (known != known_.end()) return known->second;
    const Node& n = tree_[i];
    const bool inner = n.left >= 0;
    float best = std::numeric_limits<float>::infinity();
    if (slots > 1) {
      best = std::min(Of(i, slots - 1), inner ? Split(n, slots) : best);
    } else {
      if (inner) best = n.area * cost_.node_visit + Split(n, kWidth);
      if (!inner || n.count <= static_cast<uint32_t>(cost_.max_leaf_triangles)) {
        best = std::min(best, n.area * cost_.Leaf(n.count));
      }
    }
    return known_[{i, slots}] = best;
  }

 private:
  float Split(const Node& n, int slots) {
    float best = std::numeric_limits<float>::infinity();
    for (int k = 1; k < slots; ++k) best = std::min(best, Of(n.left, k) + Of(n.right, slots - k));
    return best;
  }

  const std::vector<Node>& tree_;
  const SahCost& cost_;
  std::map<std::pair<int, int>, float> known_;
};

TEST(WideCostTest, ChoicesCostWhatIsSaid) {
  TestRng rng;
  for (int i = 0; i < 100; ++i) {
    const SahCost cost{.max_leaf_triangles = static_cast<int>(4 + rng.Below(13)),
                       .node_visit = static_cast<float>(rng.Uniform(0, 3))};
    std::vector<Node> tree = RandomTree(rng, static_cast<uint32_t>(1 + rng.Below(2000)));
    Evaluate(tree, cost);
    const float said = tree[0].wide.cost();
    // The same terms, added in another order.
    EXPECT_NEAR(Replay(tree, cost).AsChild(0), said, 1e-4f * said);
  }
}

TEST(WideCostTest, IsTheLeastOfAllWays) {
  TestRng rng;
  for (int i = 0; i < 60; ++i) {
    const SahCost cost{.max_leaf_triangles = static_cast<int>(4 + rng.Below(13)),
                       .node_visit = static_cast<float>(rng.Uniform(0, 2))};
    std::vector<Node> tree = RandomTree(rng, static_cast<uint32_t>(1 + rng.Below(300)));
    Evaluate(tree, cost);
    EXPECT_EQ(tree[0].wide.cost(), LeastCost(tree, cost).Of(0, 1));
  }
}

}  // namespace
}  // namespace sightline::bvh_build
