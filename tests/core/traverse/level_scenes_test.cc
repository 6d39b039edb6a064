// SPDX-License-Identifier: Apache-2.0
//
// Scenes whose every plane is level, and whose triangles, points and lights stand on one small
// lattice, so that all of them touch: where caps across the axes (core/shaft/axis_caps-inl.h) leave
// out what a segment only touches at its end, and must not leave out what it runs along. For every
// instruction set of this machine, against brute force.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr int kRange = 3;  // Of the lattice, either way.

Vec3f LatticePoint(TestRng& rng) {
  Vec3f p;
  for (int k = 0; k < 3; ++k) {
    p[k] = static_cast<float>(static_cast<int>(rng.Below(2 * kRange + 1)) - kRange);
  }
  return p;
}

// Pieces of level planes, and triangles that lean on them; leaves of one or two, whose boxes are
// flat.
IndexedGeometry LevelScene(TestRng& rng) {
  ObjectInput object;
  const size_t triangles = 1 + rng.Below(20);
  for (size_t i = 0; i < triangles; ++i) {
    const bool level = rng.Chance(0.6);
    const int axis = static_cast<int>(rng.Below(3));
    const Vec3f first = LatticePoint(rng);
    for (int corner = 0; corner < 3; ++corner) {
      Vec3f p = corner == 0 ? first : LatticePoint(rng);
      if (level) p[axis] = first[axis];
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(ToDouble(p));
    }
  }
  return IndexObjects({object}, Vec3d{}, 1 + static_cast<int>(rng.Below(2)));
}

class LevelScenesTest : public KernelsFixture {
 protected:
  // Which of the rays are blocked, by definition.
  std::vector<bool> Truth(const IndexedGeometry& scene, const std::vector<TraceRay>& queries) {
    std::vector<Hit> hits(queries.size());
    WalkStats stats;
    EXPECT_TRUE(kernels().occluded_brute(scene, queries, hits, nullptr, &stats));
    std::vector<bool> blocked;
    blocked.reserve(hits.size());
    for (const Hit& hit : hits) blocked.push_back(hit.triangle != kNoTriangle);
    return blocked;
  }

  template <class Packet>
  void Compare(const Packet& packet, const std::vector<TraceRay>& queries,
               const std::vector<bool>& blocked) {
    for (size_t lane = 0; lane < queries.size(); ++lane) {
      ASSERT_EQ(packet.triangle[lane] != kNoTriangle, blocked[lane])
          << "lane " << lane << ", " << Printed{queries[lane]};
    }
  }
};

SIGHTLINE_FOR_EACH_TARGET(LevelScenesTest);

TEST_P(LevelScenesTest, SegmentsToWhatTheyTouchAreBruteForces) {
  TestRng rng;
  const auto packet = std::make_unique<RayPacket>();
  // Blocked in the very plane that holds both ends, which a cap must not reach.
  int64_t along = 0, blocked_of_all = 0, all = 0;
  for (int64_t i = 0, n = ScaledCount(4000, 200); i < n; ++i) {
    const IndexedGeometry scene = LevelScene(rng);
    packet->segments = true;
    packet->mask = 0xFFFFFFFFu;
    packet->origin_source = kNoTriangle;
    packet->first_leaf = RayPacket::kNoLeaf;
    packet->origin = LatticePoint(rng);
    packet->count = 1 + static_cast<int>(rng.Below(40));
    // Mostly points of one level plane, at times all of them in the origin's own.
    const int axis = static_cast<int>(rng.Below(3));
    const bool level = rng.Chance(0.8);
    const float height = rng.Chance(0.3) ? packet->origin[axis] : LatticePoint(rng)[axis];
    std::vector<TraceRay> queries;
    for (int lane = 0; lane < packet->count; ++lane) {
      Vec3f target = LatticePoint(rng);
      if (level) target[axis] = height;
      packet->target_x[lane] = target.x;
      packet->target_y[lane] = target.y;
      packet->target_z[lane] = target.z;
      packet->target_source[lane] = kNoTriangle;
      queries.push_back({.ray = packet->ray(lane)});
    }
    const std::vector<bool> blocked = Truth(scene, queries);
    for (const bool yes : blocked) {
      ++all;
      blocked_of_all += yes;
      along += yes && level && height == packet->origin[axis];
    }
    WalkStats stats;
    ShaftCut cut, hull;
    const std::span<const RayPacket> alone(packet.get(), 1);
    const std::vector<Vec3f> origins = {packet->origin, LatticePoint(rng), LatticePoint(rng)};
    const ShaftCut* cuts[] = {
        nullptr, kernels().cut_shaft(scene, alone, &cut) ? &cut : nullptr,
        kernels().cut_hull(scene, origins, alone, nullptr, &hull) ? &hull : nullptr};
    for (const ShaftCut* from : cuts) {
      packet->first_leaf = RayPacket::kNoLeaf;
      ASSERT_TRUE(kernels().occluded_shaft(scene, *packet, from, nullptr, &stats));
      Compare(*packet, queries, blocked);
      if (HasFatalFailure()) return;
    }
    packet->first_leaf = RayPacket::kNoLeaf;
    ASSERT_TRUE(kernels().occluded_packet(scene, *packet, nullptr, &stats));
    Compare(*packet, queries, blocked);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(along, 0);
  EXPECT_GT(blocked_of_all, all / 20);
  EXPECT_LT(blocked_of_all, all - all / 20);
}

TEST_P(LevelScenesTest, RaysFromWhatTheyTouchAreBruteForces) {
  TestRng rng;
  const auto packet = std::make_unique<ParallelPacket>();
  int64_t along = 0, blocked_of_all = 0, all = 0;
  for (int64_t i = 0, n = ScaledCount(4000, 200); i < n; ++i) {
    const IndexedGeometry scene = LevelScene(rng);
    packet->mask = 0xFFFFFFFFu;
    packet->direction_source = kNoTriangle;
    // A third of its components is 0.
    do {
      packet->direction = LatticePoint(rng);
      for (int k = 0; k < 3; ++k) {
        if (rng.Chance(0.25)) packet->direction[k] = 0;
      }
    } while (MaxAbs(packet->direction) == 0);
    packet->count = 1 + static_cast<int>(rng.Below(40));
    const int axis = static_cast<int>(rng.Below(3));
    const bool level = rng.Chance(0.8);
    const float height = LatticePoint(rng)[axis];
    std::vector<TraceRay> queries;
    for (int lane = 0; lane < packet->count; ++lane) {
      Vec3f origin = LatticePoint(rng);
      if (level) origin[axis] = height;
      packet->origin_x[lane] = origin.x;
      packet->origin_y[lane] = origin.y;
      packet->origin_z[lane] = origin.z;
      packet->origin_source[lane] = kNoTriangle;
      queries.push_back({.ray = packet->ray(lane)});
    }
    const std::vector<bool> blocked = Truth(scene, queries);
    for (const bool yes : blocked) {
      ++all;
      blocked_of_all += yes;
      along += yes && level && packet->direction[axis] == 0;
    }
    WalkStats stats;
    ShaftCut cut;
    const bool has_cut =
        kernels().cut_parallel_shaft(scene, std::span<const ParallelPacket>(packet.get(), 1), &cut);
    for (const bool by_cut : {false, true}) {
      packet->first_leaf = RayPacket::kNoLeaf;
      ASSERT_TRUE(kernels().occluded_parallel_shaft(
          scene, *packet, by_cut && has_cut ? &cut : nullptr, nullptr, &stats));
      Compare(*packet, queries, blocked);
      if (HasFatalFailure()) return;
    }
    packet->first_leaf = RayPacket::kNoLeaf;
    ASSERT_TRUE(kernels().occluded_parallel_packet(scene, *packet, nullptr, &stats));
    Compare(*packet, queries, blocked);
    if (HasFatalFailure()) return;
  }
  EXPECT_GT(along, 0);
  EXPECT_GT(blocked_of_all, all / 20);
  EXPECT_LT(blocked_of_all, all - all / 20);
}

}  // namespace
}  // namespace sightline::testing_support
