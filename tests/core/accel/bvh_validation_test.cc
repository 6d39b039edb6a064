// SPDX-License-Identifier: Apache-2.0
//
// A valid tree, spoiled in one place at a time: every fault is found and named.
#include "core/accel/bvh_validation.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <utility>

#include "core/accel/bvh_builder.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::ScaledCount;
using testing_support::ScatteredTriangles;
using testing_support::TestRng;

struct Slot {
  uint32_t node, slot;
};

class BvhValidationTest : public ::testing::Test {
 protected:
  void SetUp() override {
    geometry_ = ScatteredTriangles(rng_, 3000, 0.05);
    // One inert triangle, the last.
    geometry_.triangles.push_back({0, 0, 0});
    geometry_.inert = {3000};
    ThreadPool pool(1);
    absl::StatusOr<Bvh> bvh = BuildBvh(geometry_, {}, pool);
    ASSERT_TRUE(bvh.ok()) << bvh.status();
    bvh_ = *std::move(bvh);
    ASSERT_TRUE(ValidateBvh(bvh_, geometry_).ok()) << ValidateBvh(bvh_, geometry_);
  }

  void ExpectFault(const std::string& part, const std::function<void(Bvh&)>& spoil) {
    Bvh spoiled = bvh_;
    spoil(spoiled);
    const absl::Status status = ValidateBvh(spoiled, geometry_);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << "instead of " << part;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }

  // The first slot of which `is` holds, by node.
  Slot Find(const std::function<bool(const BvhNode&, uint32_t)>& is) const {
    for (uint32_t node = 0; node < bvh_.nodes.size(); ++node) {
      for (uint32_t slot = 0; slot < kBvhWidth; ++slot) {
        if (is(bvh_.nodes[node], slot)) return {node, slot};
      }
    }
    ADD_FAILURE() << "no such slot";
    return {0, 0};
  }
  Slot FindInner() const {
    return Find([](const BvhNode& node, uint32_t slot) { return node.child[slot].is_inner(); });
  }
  // A leaf whose last unit has a lane without a triangle.
  Slot FindPartialLeaf() const {
    return Find([](const BvhNode& node, uint32_t slot) {
      return node.child[slot].is_leaf() && node.child[slot].leaf_count() % 4 != 0 &&
             node.child[slot].leaf_count() > 1;
    });
  }
  static float& Bound(Bvh& bvh, Slot at, int face) {
    return bvh.nodes[at.node].bounds[face][at.slot];
  }
  static float& Row(Bvh& bvh, Slot at, int row, uint32_t lane) {
    const ChildRef leaf = bvh.nodes[at.node].child[at.slot];
    return bvh.leaves[leaf.leaf_unit() * kUnitFloats + row * 4 * leaf.leaf_units() + lane];
  }

  TestRng rng_;
  SceneGeometry geometry_;
  Bvh bvh_;
};

TEST_F(BvhValidationTest, References) {
  const Slot inner = FindInner();
  ExpectFault("refers to node 4000000", [&](Bvh& bvh) {
    bvh.nodes[inner.node].child[inner.slot] = ChildRef::Inner(4'000'000);
  });
  ExpectFault("node 0 is reached twice",
              [&](Bvh& bvh) { bvh.nodes[inner.node].child[inner.slot] = ChildRef::Inner(0); });
  const Slot leaf = FindPartialLeaf();
  ExpectFault("needs units", [&](Bvh& bvh) {
    bvh.nodes[leaf.node].child[leaf.slot] = ChildRef::Leaf(ChildRef::kMaxUnit, 16);
  });
  const Slot other = Find([&](const BvhNode& node, uint32_t slot) {
    return node.child[slot].is_leaf() && &node != &bvh_.nodes[leaf.node];
  });
  ExpectFault("with another", [&](Bvh& bvh) {
    bvh.nodes[other.node].child[other.slot] = bvh.nodes[leaf.node].child[leaf.slot];
    for (int face = 0; face < 6; ++face) {
      bvh.nodes[other.node].bounds[face][other.slot] = bvh.nodes[leaf.node].bounds[face][leaf.slot];
    }
  });
}

TEST_F(BvhValidationTest, EverythingIsReached) {
  ExpectFault("node " + std::to_string(bvh_.nodes.size()) + " is never reached",
              [](Bvh& bvh) { bvh.nodes.push_back(BvhNode()); });
  ExpectFault("is never reached",
              [](Bvh& bvh) { bvh.leaves.resize(bvh.leaves.size() + kUnitFloats); });
  // A leaf taken out with its slot, and closed up.
  const Slot leaf = Find([](const BvhNode& node, uint32_t slot) {
    return node.child[slot].is_leaf() && slot + 1 == node.child_count && slot > 0;
  });
  ExpectFault("is never reached", [&](Bvh& bvh) {
    BvhNode& node = bvh.nodes[leaf.node];
    node.child[leaf.slot] = ChildRef::Empty();
    --node.child_count;
    for (int k = 0; k < 6; ++k) {
      constexpr float kInfinity = std::numeric_limits<float>::infinity();
      node.bounds[k][leaf.slot] = k < 3 ? kInfinity : -kInfinity;
    }
  });
}

TEST_F(BvhValidationTest, EmptySlots) {
  const Slot empty =
      Find([](const BvhNode& node, uint32_t slot) { return node.child[slot].is_empty(); });
  ExpectFault("is empty, but its box is not inverted",
              [&](Bvh& bvh) { bvh.nodes[empty.node].bounds[4][empty.slot] = 0; });
  ExpectFault("is empty, but its box is not inverted", [&](Bvh& bvh) {
    bvh.nodes[empty.node].bounds[0][empty.slot] = std::numeric_limits<float>::quiet_NaN();
  });
  ExpectFault("slot 0 is empty",
              [&](Bvh& bvh) { bvh.nodes[empty.node].child[0] = ChildRef::Empty(); });
  ExpectFault("children, but slot", [&](Bvh& bvh) { ++bvh.nodes[empty.node].child_count; });
  ExpectFault("children, but slot", [&](Bvh& bvh) { --bvh.nodes[empty.node].child_count; });
  ExpectFault("has 0 children", [&](Bvh& bvh) { bvh.nodes[0].child_count = 0; });
  ExpectFault("has 9 children", [&](Bvh& bvh) { bvh.nodes[0].child_count = 9; });
}

TEST_F(BvhValidationTest, LeafContents) {
  const Slot leaf = FindPartialLeaf();
  const uint32_t count = bvh_.nodes[leaf.node].child[leaf.slot].leaf_count();
  ExpectFault("holds triangle 5000 of 3001",
              [&](Bvh& bvh) { Row(bvh, leaf, 9, 0) = std::bit_cast<float>(5000u); });
  ExpectFault("holds triangle 3000, which is inert",
              [&](Bvh& bvh) { Row(bvh, leaf, 9, 0) = std::bit_cast<float>(3000u); });
  ExpectFault("stands in a leaf already",
              [&](Bvh& bvh) { Row(bvh, leaf, 9, 1) = Row(bvh, leaf, 9, 0); });
  ExpectFault("does not hold its ids in order", [&](Bvh& bvh) {
    for (int row = 0; row < kLeafRows; ++row) {
      std::swap(Row(bvh, leaf, row, 0), Row(bvh, leaf, row, 1));
    }
  });
  ExpectFault("in unused lane",
              [&](Bvh& bvh) { Row(bvh, leaf, 9, count) = std::bit_cast<float>(1u); });
  ExpectFault("has another coordinate in row 3 lane " + std::to_string(count),
              [&](Bvh& bvh) { Row(bvh, leaf, 3, count) = 1; });
  for (int row = 0; row < 9; ++row) {
    ExpectFault("has another coordinate in row " + std::to_string(row) + " lane 1", [&](Bvh& bvh) {
      Row(bvh, leaf, row, 1) = std::nextafter(Row(bvh, leaf, row, 1), 10.0f);
    });
  }
}

TEST_F(BvhValidationTest, BoxesAreExact) {
  const Slot inner = FindInner(), leaf = FindPartialLeaf();
  for (const Slot at : {inner, leaf}) {
    for (int face = 0; face < 6; ++face) {
      for (float to : {-10.0f, 10.0f}) {
        ExpectFault("has a box that is not", [&](Bvh& bvh) {
          float& x = Bound(bvh, at, face);
          x = std::nextafter(x, to);
        });
      }
    }
  }
  ExpectFault("its bounds", [](Bvh& bvh) { bvh.bounds.hi.y += 1; });
}

TEST_F(BvhValidationTest, Counts) {
  ExpectFault("triangles", [](Bvh& bvh) { ++bvh.triangle_count; });
  ExpectFault("leaves", [](Bvh& bvh) { ++bvh.leaf_count; });
  ExpectFault("depth", [](Bvh& bvh) { ++bvh.max_depth; });
  ExpectFault("leaf floats", [](Bvh& bvh) { bvh.leaves.push_back(0); });
  ExpectFault("leaf floats", [](Bvh& bvh) { bvh.leaves.resize(3); });
  const Bvh empty;
  EXPECT_FALSE(ValidateBvh(empty, geometry_).ok());
  EXPECT_TRUE(ValidateBvh(empty, SceneGeometry()).ok());
  Bvh bounded;
  bounded.bounds = {{0, 0, 0}, {1, 1, 1}};
  EXPECT_FALSE(ValidateBvh(bounded, SceneGeometry()).ok());
}

TEST_F(BvhValidationTest, CompactLeaves) {
  ThreadPool pool(1);
  absl::StatusOr<Bvh> compact = BuildBvh(geometry_, BvhPresetOptions(BvhPreset::kCompact), pool);
  ASSERT_TRUE(compact.ok()) << compact.status();
  bvh_ = *std::move(compact);
  ASSERT_TRUE(ValidateBvh(bvh_, geometry_).ok()) << ValidateBvh(bvh_, geometry_);
  ExpectFault("not whole units", [](Bvh& bvh) { bvh.leaf_ids.push_back(kNoTriangle); });
  ExpectFault("rows and names", [](Bvh& bvh) { bvh.leaves.resize(kLeafPadding); });
  ExpectFault("is never reached",
              [](Bvh& bvh) { bvh.leaf_ids.resize(bvh.leaf_ids.size() + 4, 0); });
  ExpectFault("needs units", [](Bvh& bvh) {
    for (int i = 0; i < kUnitTriangles; ++i) bvh.leaf_ids.pop_back();
  });
  ExpectFault("of 3001", [](Bvh& bvh) { bvh.leaf_ids[0] = 3001; });
  ExpectFault("inert or stands", [](Bvh& bvh) { bvh.leaf_ids[0] = 3000; });
  ExpectFault("inert or stands", [](Bvh& bvh) { bvh.leaf_ids[1] = bvh.leaf_ids[0]; });
  ExpectFault("ids in order", [](Bvh& bvh) { std::swap(bvh.leaf_ids[0], bvh.leaf_ids[1]); });
  for (size_t i = 0; i < bvh_.leaf_ids.size(); ++i) {
    if (bvh_.leaf_ids[i] != kNoTriangle) continue;
    ExpectFault("in unused lane", [i](Bvh& bvh) { bvh.leaf_ids[i] = 0; });
    break;
  }
}

// A chain of nodes, each over one leaf and the next node, is valid until it is too deep for a
// walk's stack.
TEST(BvhDepthTest, ChainsAreBounded) {
  for (uint32_t depth : {kMaxBvhDepth, kMaxBvhDepth + 1}) {
    TestRng rng;
    const SceneGeometry geometry = ScatteredTriangles(rng, depth, 0.1);
    Bvh bvh;
    bvh.nodes.resize(depth);
    bvh.leaves.resize(depth * kUnitFloats + kLeafPadding, 0.0f);
    Box3f box;
    for (uint32_t i = depth; i-- > 0;) {
      BvhNode& node = bvh.nodes[i];
      for (int slot = 0; slot < kBvhWidth; ++slot) {
        for (int k = 0; k < 6; ++k) node.bounds[k][slot] = k < 3 ? Box3f().lo.x : Box3f().hi.x;
      }
      const auto set_child = [&](uint32_t slot, ChildRef child, const Box3f& b) {
        node.child[slot] = child;
        for (int axis = 0; axis < 3; ++axis) {
          node.bounds[axis][slot] = b.lo[axis];
          node.bounds[axis + 3][slot] = b.hi[axis];
        }
        ++node.child_count;
      };
      Box3f leaf_box;
      float* const rows = &bvh.leaves[i * kUnitFloats];
      for (int lane = 0; lane < kUnitTriangles; ++lane) rows[36 + lane] = std::bit_cast<float>(~0u);
      for (int corner = 0; corner < 3; ++corner) {
        const Vec3f v = geometry.Corners(i)[corner];
        leaf_box.Extend(v);
        for (int axis = 0; axis < 3; ++axis) rows[4 * (3 * corner + axis)] = v[axis];
      }
      rows[36] = std::bit_cast<float>(i);
      set_child(0, ChildRef::Leaf(i, 1), leaf_box);
      if (i + 1 < depth) set_child(1, ChildRef::Inner(i + 1), box);
      box.Extend(leaf_box);
    }
    bvh.bounds = box;
    bvh.leaf_count = bvh.triangle_count = bvh.max_depth = depth;
    const absl::Status status = ValidateBvh(bvh, geometry);
    if (depth <= kMaxBvhDepth) {
      EXPECT_TRUE(status.ok()) << status;
    } else {
      EXPECT_THAT(std::string(status.message()), HasSubstr("at depth 65"));
    }
  }
}

// Whatever single bit of nodes or leaves is flipped, the validation ends, and finds it, but for the
// bytes that say nothing: a node's reserved words, the padding, and the sign of a zero or the
// payload of a box.
TEST_F(BvhValidationTest, RandomBitFlips) {
  for (int64_t i = 0, n = ScaledCount(3000); i < n; ++i) {
    Bvh spoiled = bvh_;
    std::string where;
    if (rng_.Chance(0.5)) {
      const size_t node = rng_.Below(spoiled.nodes.size());
      const size_t word = rng_.Below(offsetof(BvhNode, reserved) / 4);
      const uint32_t flip = 1u << rng_.Below(32);
      uint32_t value;
      char* const at = reinterpret_cast<char*>(&spoiled.nodes[node]) + 4 * word;
      std::memcpy(&value, at, 4);
      if (value == 0 && flip == 0x80000000u) continue;  // -0 is 0 to a box.
      value ^= flip;
      std::memcpy(at, &value, 4);
      where = "node " + std::to_string(node) + " word " + std::to_string(word);
    } else {
      const size_t word = rng_.Below(spoiled.leaves.size() - kLeafPadding);
      spoiled.leaves[word] = std::bit_cast<float>(std::bit_cast<uint32_t>(spoiled.leaves[word]) ^
                                                  (1u << rng_.Below(32)));
      where = "leaf float " + std::to_string(word);
    }
    ASSERT_EQ(ValidateBvh(spoiled, geometry_).code(), absl::StatusCode::kDataLoss) << where;
  }
}

// Before the first node is looked at, which would be a fault.
TEST_F(BvhValidationTest, CancelledTokensEndIt) {
  CancelToken cancel;
  EXPECT_TRUE(ValidateBvh(bvh_, geometry_, &cancel).ok());
  cancel.Cancel();
  bvh_.nodes[0].child_count = 0;
  EXPECT_EQ(ValidateBvh(bvh_, geometry_, &cancel).code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace sightline
