// SPDX-License-Identifier: Apache-2.0
#include "core/accel/leaf_mates_validation.h"

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "core/accel/bvh_builder.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::NastyMeshes;
using testing_support::ScaledCount;
using testing_support::TestMesh;
using testing_support::TestRng;

Bvh BuildAsAsked(const SceneGeometry& geometry, const BvhBuildOptions& options) {
  ThreadPool pool(2);
  absl::StatusOr<Bvh> bvh = BuildBvh(geometry, options, pool);
  EXPECT_TRUE(bvh.ok()) << bvh.status();
  return bvh.ok() ? *std::move(bvh) : Bvh();
}

// Of other bits than the constructor makes, too.
LeafMate FromBits(uint32_t bits) {
  LeafMate mate;
  std::memcpy(static_cast<void*>(&mate), &bits, sizeof(bits));
  return mate;
}

uint32_t BitsOf(LeafMate mate) {
  uint32_t bits;
  std::memcpy(&bits, &mate, sizeof(bits));
  return bits;
}

void ExpectFault(const Bvh& bvh, const SceneGeometry& geometry, const std::string& part) {
  const absl::Status status = ValidateLeafMates(bvh, geometry);
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr(part));
}

TEST(LeafMatesValidationTest, WhatIsFoundIsValid) {
  TestRng rng;
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(3'000)))) {
    SCOPED_TRACE(mesh.name);
    for (const bool rows : {true, false}) {
      for (const bool mates : {true, false}) {
        const Bvh bvh = BuildAsAsked(mesh.geometry, {.leaf_rows = rows, .mates = mates});
        EXPECT_TRUE(ValidateLeafMates(bvh, mesh.geometry).ok());
      }
    }
  }
}

// Whatever is put in an edge's place: it led to another that leads back, or had none.
TEST(LeafMatesValidationTest, NoEdgeCanBeChangedAlone) {
  TestRng rng;
  for (const TestMesh& mesh : NastyMeshes(rng, 300)) {
    SCOPED_TRACE(mesh.name);
    for (const bool rows : {true, false}) {
      Bvh bvh = BuildAsAsked(mesh.geometry, {.leaf_rows = rows});
      if (bvh.empty()) continue;
      LeafMates& mates = bvh.mates;
      for (int64_t i = 0; i < ScaledCount(300); ++i) {
        LeafMate& mate = mates.rows[rng.Below(mates.rows.size())];
        const LeafMate before = mate;
        const auto places = static_cast<uint32_t>(mates.units.size() * kUnitTriangles);
        switch (rng.Below(5)) {
          case 0:
            mate = LeafMate();
            break;
          case 1:
            mate = LeafMate(static_cast<uint32_t>(rng.Below(places)), rng.Chance(0.5));
            break;
          case 2:  // That of another edge, as often as not of the same triangle.
            mate = mates.rows[rng.Below(mates.rows.size())];
            break;
          case 3:
            mate = FromBits(BitsOf(mate) ^ 1u << rng.Below(32));
            break;
          case 4:
            mate = FromBits(static_cast<uint32_t>(rng()));
            break;
        }
        if (mate == before) continue;
        ExpectFault(bvh, mesh.geometry, "invalid mates: edge ");
        mate = before;
      }
      EXPECT_TRUE(ValidateLeafMates(bvh, mesh.geometry).ok());
    }
  }
}

TEST(LeafMatesValidationTest, UnitsAreTheirLeaves) {
  TestRng rng;
  for (const TestMesh& mesh : NastyMeshes(rng, 300)) {
    SCOPED_TRACE(mesh.name);
    Bvh bvh = BuildAsAsked(mesh.geometry, {});
    if (bvh.empty()) continue;
    for (int i = 0; i < 20; ++i) {
      uint8_t& code = bvh.mates.units[rng.Below(bvh.mates.units.size())];
      const uint8_t before = code;
      code ^= static_cast<uint8_t>(1 + rng.Below(255));
      ExpectFault(bvh, mesh.geometry, "has code ");
      code = before;
    }
    bvh.mates.units.push_back(0);
    ExpectFault(bvh, mesh.geometry, " units and ");
    bvh.mates.units = {};
    ExpectFault(bvh, mesh.geometry, " units and ");
    bvh.mates = {};
    EXPECT_TRUE(ValidateLeafMates(bvh, mesh.geometry).ok());
    bvh.mates.units.push_back(0);
    ExpectFault(bvh, mesh.geometry, " units and ");
  }
}

TEST(LeafMatesValidationTest, BothSidesMayHaveNone) {
  TestRng rng;
  size_t taken = 0;
  for (const TestMesh& mesh : NastyMeshes(rng, 300)) {
    SCOPED_TRACE(mesh.name);
    Bvh bvh = BuildAsAsked(mesh.geometry, {});
    LeafMates& mates = bvh.mates;
    for (const BvhNode& node : bvh.nodes) {
      const ChildRef leaf = node.child[0];
      if (!leaf.is_leaf()) continue;
      const size_t at = mates.of(leaf, 0) - mates.rows.data();
      if (!mates.rows[at].exists()) continue;
      const LeafMate mate = mates.rows[at], back(LeafMates::PlaceOf(leaf, 0), mate.same_way());
      const ChildRef other = mates.leaf(mate);
      for (int e = 0; e < 3; ++e) {
        LeafMate& theirs =
            mates.rows[mates.of(other, e) - mates.rows.data() + LeafMates::lane(other, mate)];
        if (theirs != back) continue;
        // One side alone, the other one alone, both.
        mates.rows[at] = {};
        EXPECT_FALSE(ValidateLeafMates(bvh, mesh.geometry).ok());
        theirs = {};
        EXPECT_TRUE(ValidateLeafMates(bvh, mesh.geometry).ok());
        mates.rows[at] = mate;
        EXPECT_FALSE(ValidateLeafMates(bvh, mesh.geometry).ok());
        mates.rows[at] = {};
        ++taken;
        break;
      }
      if (taken % 10 == 9) break;
    }
  }
  EXPECT_GT(taken, 0u);
}

TEST(LeafMatesValidationTest, CanBeCancelled) {
  TestRng rng;
  CancelToken cancel;
  cancel.Cancel();
  for (const TestMesh& mesh : NastyMeshes(rng, 300)) {
    const Bvh bvh = BuildAsAsked(mesh.geometry, {});
    if (bvh.empty()) continue;
    EXPECT_EQ(ValidateLeafMates(bvh, mesh.geometry, &cancel).code(), absl::StatusCode::kCancelled);
  }
}

}  // namespace
}  // namespace sightline
