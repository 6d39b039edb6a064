// SPDX-License-Identifier: Apache-2.0
//
// Packets that share a seed (RayPacket::seed): brute force's answers, whoever made it, and shafts
// of their own for those that do not fit their neighbours'.
#include "core/traverse/shaft_seed.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/traverse/answered_by.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

class ShaftSeedTest : public KernelsFixture {
 protected:
  // `trace` asks about the lanes of *packet.
  template <class Packet, class TracePacket>
  void Check(const IndexedGeometry& scene, Packet* packet, const TracePacket& trace) {
    std::vector<TraceRay> queries;
    queries.reserve(RayPacket::kMaxRays);
    for (int lane = 0; lane < packet->count; ++lane) queries.push_back(packet->trace_ray(lane));
    std::vector<Hit> truth(queries.size());
    WalkStats stats;
    ASSERT_TRUE(kernels().closest_brute(scene, queries, truth, nullptr, &stats));
    packet->first_leaf = RayPacket::kNoLeaf;
    ASSERT_TRUE(trace());
    for (size_t lane = 0; lane < queries.size(); ++lane) {
      ASSERT_EQ(packet->triangle[lane] != kNoTriangle, truth[lane].triangle != kNoTriangle)
          << "lane " << lane << " of " << queries.size();
      (truth[lane].triangle != kNoTriangle ? blocked_ : lit_) += 1;
    }
  }

  // trace_packets(scene, rays, seed) of some groups of packets, each of which has a seed.
  template <class TracePackets>
  void ForEachGroup(const TracePackets& trace_packets) {
    int64_t seeds = 0;
    for (const NastyScene& scene : MakeNastyScenes(rng_)) {
      SCOPED_TRACE(scene.name);
      NastyRays rays(scene.indexed, rng_);
      for (int64_t group = 0, groups = ScaledCount(12, 2); group < groups; ++group) {
        ShaftSeed seed;
        trace_packets(scene.indexed, rays, &seed);
        seeds += seed.made ? 1 : 0;
      }
    }
    EXPECT_GT(seeds, 0);
    EXPECT_GT(blocked_, lit_ / 20);
    EXPECT_GT(lit_, blocked_ / 20);
  }

  // Now and then all of a packet's points are near one, so that it fits some frame.
  Vec3f Near(Vec3f middle) {
    Vec3f point = middle;
    for (int k = 0; k < 3; ++k) {
      point[k] += static_cast<float>(rng_.Uniform(-0.03, 0.03)) * middle[k];
    }
    return point;
  }

  TestRng rng_;
  int64_t blocked_ = 0, lit_ = 0;
};
SIGHTLINE_FOR_EACH_TARGET(ShaftSeedTest);

TEST_P(ShaftSeedTest, SegmentsThatShareOneGiveBruteForcesAnswers) {
  const auto packet = std::make_unique<RayPacket>();
  ForEachGroup([&](const IndexedGeometry& scene, NastyRays& rays, ShaftSeed* seed) {
    const Vec3f origin = rays.Point();
    const uint32_t source = rays.Source();
    for (int i = 0; i < 5; ++i) {
      rays.FillPacket(
          rng_.Chance(0.5) ? RayPacket::kMaxRays : 1 + static_cast<int>(rng_.Below(256)),
          packet.get());
      const bool narrow = rng_.Chance(0.6);
      const Vec3f middle = rays.Point();
      Box3f box;
      for (int lane = 0; lane < packet->count; ++lane) {
        const Vec3f point = narrow ? Near(middle) : packet->target(lane);
        packet->target_x[lane] = point.x;
        packet->target_y[lane] = point.y;
        packet->target_z[lane] = point.z;
        box.Extend(point);
      }
      // As a light's samples have it, now and then.
      packet->origin = rng_.Chance(0.7) ? origin : Near(origin);
      packet->origin_source = source;
      packet->segments = true;
      packet->point_box = &box;  // Without it packets' walks take no seed.
      packet->seed = seed;
      Check(scene, packet.get(), [&] {
        WalkStats stats;
        return kernels().occluded_packet(scene, *packet, nullptr, &stats);
      });
      Check(scene, packet.get(), [&] {
        WalkStats stats;
        return kernels().occluded_shaft(scene, *packet, nullptr, nullptr, &stats);
      });
    }
  });
}

TEST_P(ShaftSeedTest, ParallelRaysThatShareOneGiveBruteForcesAnswers) {
  const auto packet = std::make_unique<ParallelPacket>();
  ForEachGroup([&](const IndexedGeometry& scene, NastyRays& rays, ShaftSeed* seed) {
    packet->direction = rays.Target(rays.Point(), /*segment=*/false);
    packet->direction_source = rays.Source();
    packet->seed = seed;
    for (int i = 0; i < 5; ++i) {
      packet->count = 1 + static_cast<int>(rng_.Below(RayPacket::kMaxRays));
      const Vec3f middle = rays.Point();
      const bool narrow = rng_.Chance(0.7);
      for (int lane = 0; lane < packet->count; ++lane) {
        const Vec3f origin = narrow ? Near(middle) : rays.Point();
        packet->origin_x[lane] = origin.x;
        packet->origin_y[lane] = origin.y;
        packet->origin_z[lane] = origin.z;
        packet->origin_source[lane] = rays.Source();
      }
      Check(scene, packet.get(), [&] {
        WalkStats stats;
        return kernels().occluded_parallel_shaft(scene, *packet, nullptr, nullptr, &stats);
      });
    }
  });
}

// A frame at the origin holds what is within some sixty degrees of its axis.
TEST_P(ShaftSeedTest, WhatDoesNotFitIsAShaftOfItsOwn) {
  const auto packet = std::make_unique<RayPacket>();
  const std::vector<NastyScene> scenes = MakeNastyScenes(rng_);
  const auto some = std::find_if(scenes.begin(), scenes.end(), [](const NastyScene& each) {
    return each.indexed.geometry.triangles.size() > 100;
  });
  ASSERT_NE(some, scenes.end());
  const IndexedGeometry& scene = some->indexed;
  std::array<AnsweredBy, RayPacket::kMaxRays> answered_by;
  packet->answered_by = answered_by.data();
  packet->origin = {0, 0, 0};
  packet->count = RayPacket::kMaxRays;
  packet->sourceless = true;
  ShaftSeed seed;
  packet->seed = &seed;
  const struct {
    Vec3f middle;
    bool fits;  // The frame of the one before.
  } kPackets[] = {{{10, 1, 0}, false},   {{10, 2, 0}, true}, {{-10, 0, 1}, false},
                  {{0, 10, 1}, false},   {{1, 9, 3}, true},  {{1, 0, 10}, false},
                  {{0, -10, -9}, false}, {{0, -9, -9}, true}};
  for (const auto& [middle, fits] : kPackets) {
    const Vec3f before = seed.frame.w;
    for (int lane = 0; lane < packet->count; ++lane) {
      packet->target_x[lane] = middle.x + static_cast<float>(rng_.Uniform(-0.1, 0.1));
      packet->target_y[lane] = middle.y + static_cast<float>(rng_.Uniform(-0.1, 0.1));
      packet->target_z[lane] = middle.z + static_cast<float>(rng_.Uniform(-0.1, 0.1));
    }
    answered_by.fill(AnsweredBy::kShaft);
    Check(scene, packet.get(), [&] {
      WalkStats stats;
      return kernels().occluded_shaft(scene, *packet, nullptr, nullptr, &stats);
    });
    // Rays that no frame holds walk as a packet.
    EXPECT_EQ(std::count(answered_by.begin(), answered_by.end(), AnsweredBy::kPacket), 0);
    EXPECT_GT(Dot(seed.frame.w, middle), 0.4f * 9);
    const Vec3f after = seed.frame.w;
    EXPECT_EQ(before.x == after.x && before.y == after.y && before.z == after.z, fits);
  }
}

}  // namespace
}  // namespace sightline::testing_support
