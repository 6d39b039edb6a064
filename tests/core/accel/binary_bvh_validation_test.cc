// SPDX-License-Identifier: Apache-2.0
//
// A valid tree, spoiled in one place at a time: every fault is found and named.
#include "core/accel/binary_bvh_validation.h"

#include <functional>
#include <string>
#include <utility>

#include "core/accel/binary_bvh_builder.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::ScatteredTriangles;
using testing_support::TestRng;

class BinaryBvhValidationTest : public ::testing::Test {
 protected:
  void SetUp() override {
    geometry_ = ScatteredTriangles(rng_, 1000, 0.05);
    // One inert triangle, the last.
    geometry_.triangles.push_back({0, 0, 0});
    geometry_.inert = {1000};
    bvh_ = Build({.cost_ratio = 0.3f});
  }

  BinaryBvh Build(const BinaryBvhOptions& options) const {
    ThreadPool pool(1);
    absl::StatusOr<BinaryBvh> bvh = BuildBinaryBvh(geometry_, options, pool);
    EXPECT_TRUE(bvh.ok()) << bvh.status();
    EXPECT_TRUE(ValidateBinaryBvh(*bvh, geometry_).ok()) << ValidateBinaryBvh(*bvh, geometry_);
    return *std::move(bvh);
  }

  void ExpectFault(const std::string& part, const std::function<void(BinaryBvh&)>& spoil) const {
    BinaryBvh spoiled = bvh_;
    spoil(spoiled);
    const absl::Status status = ValidateBinaryBvh(spoiled, geometry_);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << "instead of " << part;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }

  // The first leaf of two triangles or more.
  uint32_t Leaf() const {
    for (uint32_t i = 0; i < bvh_.nodes.size(); ++i) {
      if (bvh_.nodes[i].count > 1) return i;
    }
    ADD_FAILURE() << "no such leaf";
    return 0;
  }

  TestRng rng_;
  SceneGeometry geometry_;
  BinaryBvh bvh_;
};

TEST_F(BinaryBvhValidationTest, WhatIsBuiltIsValid) {
  for (const float ratio : {0.001f, 0.1f, 1.0f, 100.0f}) Build({.cost_ratio = ratio});
  Build({.min_triangles = 1 << 20});
  geometry_ = {};
  EXPECT_TRUE(Build({}).empty());
}

TEST_F(BinaryBvhValidationTest, Links) {
  ASSERT_FALSE(bvh_.nodes[0].is_leaf());
  const uint32_t last = static_cast<uint32_t>(bvh_.nodes.size()) - 1;
  ExpectFault("node 0 refers to nodes 0", [](BinaryBvh& b) { b.nodes[0].first = 0; });
  ExpectFault("node 0 refers to nodes", [&](BinaryBvh& b) { b.nodes[0].first = last; });
  ExpectFault("node 0 refers to nodes", [](BinaryBvh& b) { b.nodes[0].first = 0xFFFFFFFFu; });
  ExpectFault("is never reached", [](BinaryBvh& b) { b.nodes[0].first += 2; });
  const uint32_t leaf = Leaf();
  ExpectFault("refers to nodes", [&](BinaryBvh& b) {
    b.nodes[leaf].count = 0;
    b.nodes[leaf].first = leaf;  // Not a place among the ids, which may be a node's, too.
  });
  ExpectFault("is reached twice", [](BinaryBvh& b) {
    const uint32_t child = b.nodes[0].first;
    const uint32_t inner = b.nodes[child].is_leaf() ? child + 1 : child;
    b.nodes[inner].first = child + 1;
  });
  ExpectFault("leaves and depth", [](BinaryBvh& b) { ++b.leaf_count; });
  ExpectFault("leaves and depth", [](BinaryBvh& b) { --b.max_depth; });
  ExpectFault("nodes over", [](BinaryBvh& b) { b.nodes.clear(); });
}

TEST_F(BinaryBvhValidationTest, DepthIsBounded) {
  // A list: each inner node has one leaf, so that it is as deep as it has triangles.
  BinaryBvh list;
  const uint32_t n = 1000;
  for (uint32_t i = 0; i < n; ++i) list.ids.push_back(i);
  list.nodes.push_back({.first = 1});
  for (uint32_t i = 0; i + 1 < n; ++i) {
    list.nodes.push_back({.first = i, .count = 1});
    list.nodes.push_back({.first = 2 * i + 3, .count = 0});
  }
  list.nodes.back() = {.first = n - 1, .count = 1};
  list.leaf_count = n;
  list.max_depth = n - 1;
  const absl::Status status = ValidateBinaryBvh(list, geometry_);
  EXPECT_THAT(std::string(status.message()), HasSubstr("is deeper than"));
}

TEST_F(BinaryBvhValidationTest, Leaves) {
  const uint32_t leaf = Leaf(), at = bvh_.nodes[leaf].first;
  ExpectFault("ids for", [](BinaryBvh& b) { b.ids.push_back(3); });
  ExpectFault("names", [&](BinaryBvh& b) { b.nodes[leaf].first = 0xFFFFFFFFu; });
  ExpectFault("names", [&](BinaryBvh& b) { b.nodes[leaf].count = 0xFFFFFFFFu; });
  ExpectFault("its leaves name", [&](BinaryBvh& b) { --b.nodes[leaf].count; });
  ExpectFault("names triangle 1000", [&](BinaryBvh& b) { b.ids[at] = 1000; });
  ExpectFault("names triangle 4000", [&](BinaryBvh& b) { b.ids[at] = 4000; });
  ExpectFault("in another leaf", [&](BinaryBvh& b) { b.ids[at] = b.ids[at + 1]; });
  ExpectFault("do not ascend", [&](BinaryBvh& b) { std::swap(b.ids[at], b.ids[at + 1]); });
}

TEST_F(BinaryBvhValidationTest, Boxes) {
  for (const uint32_t node : {0u, Leaf()}) {
    for (int axis = 0; axis < 3; ++axis) {
      ExpectFault("the box of node", [&](BinaryBvh& b) { b.nodes[node].lo[axis] -= 1; });
      ExpectFault("the box of node", [&](BinaryBvh& b) { b.nodes[node].hi[axis] -= 0.01f; });
    }
  }
}

TEST_F(BinaryBvhValidationTest, Cancelling) {
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(ValidateBinaryBvh(bvh_, geometry_, &cancel).code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace sightline
