// SPDX-License-Identifier: Apache-2.0
#include "core/accel/leaf_mates_finder.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "core/accel/bvh_builder.h"
#include "core/accel/bvh_refit.h"
#include "core/mesh/position_hash.h"
#include "gtest/gtest.h"
#include "tests/core/accel/test_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::NastyMeshes;
using testing_support::ScaledCount;
using testing_support::TestMesh;
using testing_support::TestRng;

Bvh BuildWithMates(const SceneGeometry& geometry, const BvhBuildOptions& options, int threads = 2) {
  ThreadPool pool(threads);
  absl::StatusOr<Bvh> bvh = BuildBvh(geometry, options, pool);
  EXPECT_TRUE(bvh.ok()) << bvh.status();
  return bvh.ok() ? *std::move(bvh) : Bvh();
}

std::vector<ChildRef> LeavesOf(const Bvh& bvh) {
  std::vector<ChildRef> leaves;
  for (const BvhNode& node : bvh.nodes) {
    for (uint32_t slot = 0; slot < node.child_count; ++slot) {
      if (node.child[slot].is_leaf()) leaves.push_back(node.child[slot]);
    }
  }
  return leaves;
}

uint32_t IdAt(const Bvh& bvh, ChildRef leaf, uint32_t lane) {
  if (!bvh.has_leaf_rows()) return bvh.leaf_ids[LeafMates::PlaceOf(leaf, lane)];
  const size_t rows = size_t{leaf.leaf_unit()} * kUnitFloats;
  return std::bit_cast<uint32_t>(
      bvh.leaves[rows + size_t{kLeafRows - 1} * kUnitTriangles * leaf.leaf_units() + lane]);
}

using Position = std::array<float, 3>;
using Ends = std::pair<Position, Position>;

Position At(Vec3f p) { return {p.x, p.y, p.z}; }

// Of all edges with the same two ends: how many run up and down, and how many have a mate.
struct AtEnds {
  int up = 0, down = 0, joined = 0, same_way = 0;
};

std::map<Ends, AtEnds> CheckMates(const Bvh& bvh, const SceneGeometry& geometry) {
  const LeafMates& mates = bvh.mates;
  std::map<Ends, AtEnds> all;
  for (const ChildRef leaf : LeavesOf(bvh)) {
    for (uint32_t lane = 0; lane < leaf.leaf_count(); ++lane) {
      const auto corners = geometry.Corners(IdAt(bvh, leaf, lane));
      for (int e = 0; e < 3; ++e) {
        const Position from = At(corners[e]), to = At(corners[(e + 1) % 3]);
        AtEnds& at = all[{std::min(from, to), std::max(from, to)}];
        ++(from < to ? at.up : at.down);
        const LeafMate mate = mates.of(leaf, e)[lane];
        if (!mate.exists()) continue;
        ++at.joined;
        at.same_way += mate.same_way() ? 1 : 0;
        const ChildRef other = mates.leaf(mate);
        EXPECT_TRUE(bvh.HoldsLeaf(other));
        const uint32_t i = LeafMates::lane(other, mate);
        if (i >= other.leaf_count()) {
          ADD_FAILURE() << "lane " << i << " of " << other.leaf_count();
          continue;
        }
        // One of its edges is this one, and leads back.
        const auto theirs = geometry.Corners(IdAt(bvh, other, i));
        bool back = false;
        for (int f = 0; f < 3; ++f) {
          const Position first = At(theirs[f]), second = At(theirs[(f + 1) % 3]);
          const bool same =
              mate.same_way() ? first == from && second == to : first == to && second == from;
          back |= same && mates.of(other, f)[i] ==
                              LeafMate(LeafMates::PlaceOf(leaf, lane), mate.same_way());
        }
        EXPECT_TRUE(back) << "edge " << e << " of triangle " << IdAt(bvh, leaf, lane);
      }
    }
  }
  return all;
}

TEST(LeafMatesFinderTest, PairsAllThatCanBe) {
  TestRng rng;
  for (const TestMesh& mesh : NastyMeshes(rng, static_cast<size_t>(ScaledCount(3'000)))) {
    SCOPED_TRACE(mesh.name);
    for (const bool rows : {true, false}) {
      const Bvh bvh = BuildWithMates(mesh.geometry, {.leaf_rows = rows});
      EXPECT_EQ(bvh.mates.empty(), bvh.empty());
      for (const auto& [ends, at] : CheckMates(bvh, mesh.geometry)) {
        EXPECT_EQ(at.joined, (at.up + at.down) / 2 * 2);
        // Contrary ways first.
        const int left = std::max(at.up, at.down) - std::min(at.up, at.down);
        EXPECT_EQ(at.same_way, left / 2 * 2);
      }
    }
  }
}

// A strip of quadrangles that is closed to a ring, as handed in with shared vertices or without.
SceneGeometry Ring(uint32_t cells, bool welded) {
  SceneGeometry geometry;
  const auto corner = [&](uint32_t cell, uint32_t side) -> uint32_t {
    if (welded) return 2 * (cell % cells) + side;
    const auto number = static_cast<uint32_t>(geometry.vertices.size());
    geometry.vertices.push_back({static_cast<float>(cell % cells), static_cast<float>(side),
                                 static_cast<float>((cell % cells) * (cells - cell % cells))});
    return number;
  };
  for (uint32_t cell = 0; welded && cell < cells; ++cell) {
    for (uint32_t side = 0; side < 2; ++side) {
      geometry.vertices.push_back({static_cast<float>(cell), static_cast<float>(side),
                                   static_cast<float>(cell * (cells - cell))});
    }
  }
  for (uint32_t cell = 0; cell < cells; ++cell) {
    geometry.triangles.push_back({corner(cell, 0), corner(cell + 1, 0), corner(cell, 1)});
    geometry.triangles.push_back({corner(cell, 1), corner(cell + 1, 0), corner(cell + 1, 1)});
  }
  for (const Vec3f& vertex : geometry.vertices) geometry.bounds.Extend(vertex);
  return geometry;
}

TEST(LeafMatesFinderTest, PositionsCountAndNotIndices) {
  for (const bool welded : {true, false}) {
    const SceneGeometry ring = Ring(50, welded);
    const Bvh bvh = BuildWithMates(ring, {.max_leaf_triangles = 7});
    int joined = 0, lone = 0;
    for (const auto& [ends, at] : CheckMates(bvh, ring)) {
      EXPECT_EQ(at.same_way, 0);
      joined += at.joined == 2 ? 1 : 0;
      lone += at.joined == 0 ? 1 : 0;
    }
    EXPECT_EQ(joined, 100);  // Across the ring: one in each cell, one between two.
    EXPECT_EQ(lone, 100);
  }
}

// Whichever thread came first; and of edges with more than two triangles, too.
TEST(LeafMatesFinderTest, AreTheSameHoweverManyThreads) {
  SceneGeometry book = Ring(3'000, false);
  TestRng rng;
  const size_t leaves = book.triangles.size();
  for (size_t i = 0; i < leaves; ++i) {
    auto triangle = book.triangles[rng.Below(leaves)];
    if (rng.Chance(0.5)) std::swap(triangle[0], triangle[1]);
    book.triangles.push_back(triangle);
  }
  const Bvh one = BuildWithMates(book, {}, 1);
  CheckMates(one, book);
  for (int round = 0; round < 3; ++round) {
    const Bvh many = BuildWithMates(book, {}, 4);
    EXPECT_EQ(many.mates.rows, one.mates.rows);
    EXPECT_EQ(many.mates.units, one.mates.units);
  }
}

// A vertex whose places would all be taken by those that are not finite, if they took any: where
// they come first, and where they come last.
TEST(LeafMatesFinderTest, VerticesThatAreNotFiniteTakeNoPlaces) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr uint32_t kMany = 200;
  constexpr uint64_t kSamePlace = 0xFFFF;  // In tables of up to so many.
  TestRng rng;
  Vec3f meeting;
  do {
    meeting = {static_cast<float>(rng.Uniform(0, 9)), 0.5f, static_cast<float>(rng.Uniform(0, 9))};
  } while (((HashPosition(meeting) ^ HashPosition({kNan, kNan, kNan})) & kSamePlace) != 0);
  for (const bool first : {true, false}) {
    SceneGeometry ring = Ring(100, false);
    const Vec3f moved = ring.vertices[0];
    for (Vec3f& vertex : ring.vertices) vertex = vertex == moved ? meeting : vertex;
    ring.bounds.Extend(meeting);
    AlignedVector<Vec3f> vertices(kMany, Vec3f{kNan, kNan, kNan});
    if (first) {
      for (const Vec3f& vertex : ring.vertices) vertices.push_back(vertex);
      for (auto& triangle : ring.triangles) {
        for (uint32_t& corner : triangle) corner += kMany;
      }
      ring.vertices = vertices;
    } else {
      for (const Vec3f& vertex : vertices) ring.vertices.push_back(vertex);
    }
    const Bvh one = BuildWithMates(ring, {}, 1);
    for (const auto& [ends, at] : CheckMates(one, ring)) {
      EXPECT_EQ(at.joined, (at.up + at.down) / 2 * 2) << first;
    }
    for (int round = 0; round < 3; ++round) {
      EXPECT_EQ(BuildWithMates(ring, {}, 4).mates.rows, one.mates.rows) << first;
    }
  }
}

TEST(LeafMatesFinderTest, WhoAsksForLessHasNone) {
  const SceneGeometry ring = Ring(50, true);
  EXPECT_FALSE(BuildWithMates(ring, BvhPresetOptions(BvhPreset::kStatic)).mates.empty());
  EXPECT_TRUE(BuildWithMates(ring, BvhPresetOptions(BvhPreset::kDynamic)).mates.empty());
  EXPECT_TRUE(BuildWithMates(ring, BvhPresetOptions(BvhPreset::kCompact)).mates.empty());
  // Vertices at one place may have parted.
  ThreadPool pool(2);
  Bvh bvh = BuildWithMates(ring, {});
  const uint64_t bytes = bvh.MemoryBytes();
  const absl::StatusOr<Bvh> fitted = RefitBvh(bvh, ring, pool);
  ASSERT_TRUE(fitted.ok()) << fitted.status();
  EXPECT_TRUE(fitted->mates.empty());
  EXPECT_EQ(fitted->MemoryBytes() + bvh.mates.MemoryBytes(), bytes);
  ASSERT_TRUE(RefitBvhInPlace(ring, pool, &bvh).ok());
  EXPECT_TRUE(bvh.mates.empty());
}

}  // namespace
}  // namespace sightline
