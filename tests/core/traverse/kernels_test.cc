// SPDX-License-Identifier: Apache-2.0
//
// Every walk, for every instruction set of this machine, gives the definition's answer bit for bit.
#include "core/traverse/kernels.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <iostream>
#include <memory>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/same_bits.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/core/traverse/traced_hits.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

// Any hit names some blocker: what it names has to block by itself.
void ExpectBlocker(const SceneGeometry& geometry, const TraceRay& query, const Hit& hit) {
  ASSERT_LT(hit.triangle, geometry.triangles.size());
  EXPECT_NE(hit.triangle, query.from_source);
  EXPECT_NE(hit.triangle, query.to_source);
  const auto [a, b, c] = geometry.Corners(hit.triangle);
  EXPECT_TRUE(BlocksExactly(query.ray, a, b, c));
}

class KernelsTest : public KernelsFixture {};

SIGHTLINE_FOR_EACH_TARGET(KernelsTest);

TEST_P(KernelsTest, BruteForceIsTheDefinition) {
  TestRng rng;
  for (const NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng);
    std::vector<TraceRay> queries;
    for (int64_t i = ScaledCount(150, 10); i > 0; --i) queries.push_back(rays.Next());
    const std::vector<Hit> closest = Trace(kernels().closest_brute, scene.indexed, queries);
    const std::vector<Hit> any = Trace(kernels().occluded_brute, scene.indexed, queries);
    for (size_t i = 0; i < queries.size(); ++i) {
      const Hit truth = TraceByDefinition(scene.indexed.geometry, queries[i]);
      ASSERT_TRUE(SameBits(closest[i], truth))
          << Printed{queries[i]} << ": " << closest[i].triangle << " at " << closest[i].t
          << ", not " << truth.triangle << " at " << truth.t;
      ASSERT_EQ(any[i].triangle == kNoTriangle, truth.triangle == kNoTriangle)
          << Printed{queries[i]};
    }
  }
}

TEST_P(KernelsTest, SingleRaysGiveBruteForcesBits) {
  TestRng rng;
  int64_t hits = 0, all = 0;
  for (const NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng);
    std::vector<TraceRay> queries;
    for (int64_t i = ScaledCount(6'000); i > 0; --i) queries.push_back(rays.Next());
    const std::vector<Hit> truth = Trace(kernels().closest_brute, scene.indexed, queries);
    const std::vector<Hit> any_brute = Trace(kernels().occluded_brute, scene.indexed, queries);
    const std::vector<Hit> closest = Trace(kernels().closest_single, scene.indexed, queries);
    const std::vector<Hit> any = Trace(kernels().occluded_single, scene.indexed, queries);
    for (size_t i = 0; i < queries.size(); ++i) {
      ASSERT_TRUE(SameBits(closest[i], truth[i]))
          << Printed{queries[i]} << ": " << closest[i].triangle << " at " << closest[i].t
          << ", not " << truth[i].triangle << " at " << truth[i].t;
      const bool blocked = truth[i].triangle != kNoTriangle;
      ASSERT_EQ(any[i].triangle != kNoTriangle, blocked) << Printed{queries[i]};
      ASSERT_EQ(any_brute[i].triangle != kNoTriangle, blocked) << Printed{queries[i]};
      if (blocked) ExpectBlocker(scene.indexed.geometry, queries[i], any[i]);
      hits += blocked;
      ++all;
    }
  }
  EXPECT_GT(hits, all / 10);
  EXPECT_LT(hits, all - all / 10);
}

TEST_P(KernelsTest, PacketsOfEverySizeGiveBruteForcesBits) {
  TestRng rng;
  int64_t cuts = 0;
  const auto packet = std::make_unique<RayPacket>();
  for (const NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng);
    for (int64_t i = 0, n = ScaledCount(110, 10); i < n; ++i) {
      constexpr int kSizes[] = {1, 2, 7, 8, 9, 15, 16, 17, 31, 64, 255, 256};
      const int count = i % 3 == 0 ? kSizes[rng.Below(std::size(kSizes))]
                                   : 1 + static_cast<int>(rng.Below(RayPacket::kMaxRays));
      const std::vector<TraceRay> queries = rays.FillPacket(count, packet.get());
      const std::vector<Hit> truth = Trace(kernels().closest_brute, scene.indexed, queries);
      // A cut of this packet alone, and one that another packet shares.
      std::vector<RayPacket> pair(2, *packet);
      pair[1].count = 1 + static_cast<int>(rng.Below(count));
      ShaftCut alone, shared;
      const bool cut_alone =
          kernels().cut_shaft(scene.indexed, std::span<const RayPacket>(packet.get(), 1), &alone);
      const bool cut_shared = kernels().cut_shaft(scene.indexed, pair, &shared);
      cuts += cut_alone + cut_shared;
      const struct {
        const char* walk;
        bool any, shaft;
        const ShaftCut* cut;
      } kWalks[] = {{"packet", false, false, nullptr},
                    {"packet", true, false, nullptr},
                    {"packet that begins where another ended", true, false, nullptr},
                    {"packet from a cut", true, false, cut_alone ? &alone : nullptr},
                    {"packet from a shared cut", true, false, cut_shared ? &shared : nullptr},
                    {"shaft", false, true, nullptr},
                    {"shaft", true, true, nullptr},
                    {"shaft from a cut", false, true, cut_alone ? &alone : nullptr},
                    {"shaft from a cut", true, true, cut_alone ? &alone : nullptr},
                    {"shaft from a shared cut", false, true, cut_shared ? &shared : nullptr},
                    {"shaft from a shared cut", true, true, cut_shared ? &shared : nullptr}};
      packet->first_leaf = RayPacket::kNoLeaf;
      int walk_index = 1;
      for (const auto& [walk, any, shaft, cut] : kWalks) {
        SCOPED_TRACE(walk);
        std::fill_n(packet->triangle, RayPacket::kMaxRays, 12345u);
        // Now and then the leaf that the walk before this one ended in.
        if (walk_index++ % 4 == 0) packet->first_leaf = RayPacket::kNoLeaf;
        packet->cut = shaft ? nullptr : cut;
        WalkStats stats;
        const bool done = shaft ? (any ? kernels().occluded_shaft : kernels().closest_shaft)(
                                      scene.indexed, *packet, cut, nullptr, &stats)
                                : (any ? kernels().occluded_packet : kernels().closest_packet)(
                                      scene.indexed, *packet, nullptr, &stats);
        ASSERT_TRUE(done);
        for (int lane = 0; lane < count; ++lane) {
          const Hit hit = packet->hit(lane);
          if (any) {
            ASSERT_EQ(hit.triangle != kNoTriangle, truth[lane].triangle != kNoTriangle)
                << "lane " << lane << " of " << count << ", " << Printed{queries[lane]};
            if (hit.triangle != kNoTriangle) {
              ExpectBlocker(scene.indexed.geometry, queries[lane], hit);
            }
          } else {
            ASSERT_TRUE(SameBits(hit, truth[lane]))
                << "lane " << lane << " of " << count << ", " << Printed{queries[lane]} << ": "
                << hit.triangle << " at " << hit.t << ", not " << truth[lane].triangle << " at "
                << truth[lane].t;
            float u = 0, v = 0;
            if (hit.triangle != kNoTriangle) {
              const auto [a, b, c] = scene.indexed.geometry.Corners(hit.triangle);
              HitBarycentrics(queries[lane].ray, a, b, c, &u, &v);
            }
            if (packet->want_barycentrics) {
              ASSERT_EQ(std::bit_cast<uint32_t>(packet->u[lane]), std::bit_cast<uint32_t>(u));
              ASSERT_EQ(std::bit_cast<uint32_t>(packet->v[lane]), std::bit_cast<uint32_t>(v));
            }
          }
        }
      }
    }
  }
  EXPECT_GT(cuts, 0);
}

TEST_P(KernelsTest, ParallelPacketsGiveBruteForcesBits) {
  TestRng rng;
  const auto packet = std::make_unique<ParallelPacket>();
  int64_t hits = 0, all = 0;
  for (const NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng);
    for (int64_t i = 0, n = ScaledCount(110, 10); i < n; ++i) {
      const int count = 1 + static_cast<int>(rng.Below(ParallelPacket::kMaxRays));
      const Vec3f middle = rays.Point();
      do {
        packet->direction = rays.Target(middle, /*segment=*/false);
      } while (MaxAbs(packet->direction) == 0);
      packet->mask = rng.Chance(0.7) ? 0xFFFFFFFFu : 1u << rng.Below(3);
      packet->direction_source = rays.Source();
      packet->count = count;
      const bool narrow = rng.Chance(0.5);
      std::vector<TraceRay> queries;
      for (int lane = 0; lane < count; ++lane) {
        Vec3f origin = rays.Point();
        if (narrow) {
          for (int k = 0; k < 3; ++k) {
            origin[k] = middle[k] + static_cast<float>(rng.Uniform(-0.03, 0.03)) * middle[k];
          }
        }
        packet->origin_x[lane] = origin.x;
        packet->origin_y[lane] = origin.y;
        packet->origin_z[lane] = origin.z;
        packet->origin_source[lane] = rays.Source();
        queries.push_back({.ray = packet->ray(lane),
                           .mask = packet->mask,
                           .from_source = packet->origin_source[lane],
                           .to_source = packet->direction_source});
      }
      const std::vector<Hit> truth = Trace(kernels().closest_brute, scene.indexed, queries);
      WalkStats stats;
      ShaftCut cut;
      const bool has_cut = kernels().cut_parallel_shaft(
          scene.indexed, std::span<const ParallelPacket>(packet.get(), 1), &cut);
      for (const bool as_shaft : {true, false}) {
        SCOPED_TRACE(as_shaft ? "shaft" : "packet");
        std::fill_n(packet->triangle, ParallelPacket::kMaxRays, 12345u);
        // For packets now and then the leaf that darkened another one.
        if (as_shaft || i % 3 != 0) packet->first_leaf = RayPacket::kNoLeaf;
        packet->cut = !as_shaft && has_cut && i % 4 < 2 ? &cut : nullptr;
        ASSERT_TRUE(
            as_shaft ? kernels().occluded_parallel_shaft(scene.indexed, *packet,
                                                         has_cut && i % 2 == 0 ? &cut : nullptr,
                                                         nullptr, &stats)
                     : kernels().occluded_parallel_packet(scene.indexed, *packet, nullptr, &stats));
        for (int lane = 0; lane < count; ++lane) {
          const Hit hit = {0.0f, packet->triangle[lane]};
          ASSERT_EQ(hit.triangle != kNoTriangle, truth[lane].triangle != kNoTriangle)
              << "lane " << lane << " of " << count << ", " << Printed{queries[lane]};
          if (hit.triangle != kNoTriangle) {
            ExpectBlocker(scene.indexed.geometry, queries[lane], hit);
            ++hits;
          }
          ++all;
        }
      }
    }
  }
  EXPECT_GT(hits, all / 10);
  EXPECT_LT(hits, all - all / 10);
}

TEST_P(KernelsTest, AnEmptyPacketAndNoRaysAreNothing) {
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(6, 8, 1, {})}, Vec3d{});
  const auto packet = std::make_unique<RayPacket>();
  WalkStats stats;
  EXPECT_TRUE(kernels().closest_packet(scene, *packet, nullptr, &stats));
  EXPECT_TRUE(kernels().occluded_shaft(scene, *packet, nullptr, nullptr, &stats));
  EXPECT_TRUE(kernels().closest_single(scene, {}, {}, nullptr, &stats));
  EXPECT_TRUE(kernels().occluded_brute(scene, {}, {}, nullptr, &stats));
  EXPECT_EQ(stats.triangle_tests, 0u);
}

// A token that has fired stops every walk that has enough to do.
TEST_P(KernelsTest, EveryWalkPollsItsToken) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(60, 80, 1, {})}, Vec3d{});
  NastyRays rays(scene, rng);
  CancelToken cancel;
  cancel.Cancel();
  std::vector<TraceRay> queries(5000);
  for (TraceRay& query : queries) query = rays.Next();
  std::vector<Hit> hits(queries.size());
  WalkStats stats;
  EXPECT_FALSE(kernels().closest_single(scene, queries, hits, &cancel, &stats));
  EXPECT_FALSE(kernels().occluded_single(scene, queries, hits, &cancel, &stats));
  EXPECT_FALSE(kernels().closest_brute(scene, queries, hits, &cancel, &stats));
  EXPECT_FALSE(kernels().occluded_brute(scene, queries, hits, &cancel, &stats));
  const auto packet = std::make_unique<RayPacket>();
  packet->segments = false;
  packet->count = RayPacket::kMaxRays;
  for (int lane = 0; lane < packet->count; ++lane) {
    packet->target_x[lane] = static_cast<float>(rng.Uniform(-1, 1));
    packet->target_y[lane] = static_cast<float>(rng.Uniform(-1, 1));
    packet->target_z[lane] = static_cast<float>(rng.Uniform(-1, 1));
  }
  EXPECT_FALSE(kernels().closest_packet(scene, *packet, &cancel, &stats));
  packet->segments = true;
  EXPECT_FALSE(kernels().occluded_packet(scene, *packet, &cancel, &stats));

  // Wide enough to have to visit much, narrow enough to be a shaft: past the sphere's rim.
  for (int lane = 0; lane < packet->count; ++lane) {
    packet->target_x[lane] = static_cast<float>(rng.Uniform(-1.5, 1.5));
    packet->target_y[lane] = static_cast<float>(rng.Uniform(-1.5, 1.5));
    packet->target_z[lane] = 0;
    packet->target_source[lane] = kNoTriangle;
  }
  packet->origin = {0, 0, -4};
  EXPECT_FALSE(kernels().occluded_shaft(scene, *packet, nullptr, &cancel, &stats));
  const auto parallel = std::make_unique<ParallelPacket>();
  parallel->direction = {0, 0, 1};
  parallel->count = packet->count;
  for (int lane = 0; lane < packet->count; ++lane) {
    parallel->origin_x[lane] = packet->target_x[lane];
    parallel->origin_y[lane] = packet->target_y[lane];
    parallel->origin_z[lane] = -4;
    parallel->origin_source[lane] = kNoTriangle;
  }
  EXPECT_FALSE(kernels().occluded_parallel_shaft(scene, *parallel, nullptr, &cancel, &stats));
  parallel->first_leaf = RayPacket::kNoLeaf;
  EXPECT_FALSE(kernels().occluded_parallel_packet(scene, *parallel, &cancel, &stats));
  packet->segments = false;
  for (int lane = 0; lane < packet->count; ++lane) packet->target_z[lane] = 4;
  EXPECT_FALSE(kernels().closest_shaft(scene, *packet, nullptr, &cancel, &stats));
}

}  // namespace
}  // namespace sightline::testing_support
