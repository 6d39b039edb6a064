// SPDX-License-Identifier: Apache-2.0
//
// What a shaft says by bits alone (RayPacket::blocked), and packets whose rows of sources hold
// anything (RayPacket::sourceless): brute force's answers.
#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/traverse/shaft_cut.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr size_t kNumbers = RayPacket::kMaxRays / 16;
using Bits = std::array<uint16_t, kNumbers>;

bool Bit(const Bits& bits, size_t lane) { return (bits[lane / 16] >> (lane % 16) & 1) != 0; }

class ShaftBitsTest : public KernelsFixture {
 protected:
  std::vector<Hit> Truth(const IndexedGeometry& scene, const std::vector<TraceRay>& queries) {
    std::vector<Hit> hits(queries.size());
    WalkStats stats;
    EXPECT_TRUE(kernels().closest_brute(scene, queries, hits, nullptr, &stats));
    return hits;
  }

  // `trace` asks about *packet, whose rays are `queries`; all of them are wanted, or some.
  template <class Packet, class TracePacket>
  void CheckBits(const std::vector<TraceRay>& queries, const std::vector<Hit>& truth, bool all,
                 Packet* packet, const TracePacket& trace) {
    Bits unasked = {}, blocked;
    for (uint16_t& number : unasked) {
      if (!all) number = static_cast<uint16_t>(rng_.Below(1 << 16));
    }
    blocked.fill(0xA5A5);
    packet->unasked = all ? nullptr : unasked.data();
    packet->blocked = blocked.data();
    packet->first_leaf = RayPacket::kNoLeaf;
    trace();
    packet->unasked = nullptr;
    packet->blocked = nullptr;
    for (size_t lane = 0; lane < RayPacket::kMaxRays; ++lane) {
      const bool asked = lane < queries.size() && !Bit(unasked, lane);
      ASSERT_EQ(Bit(blocked, lane), asked && truth[lane].triangle != kNoTriangle)
          << "lane " << lane << " of " << queries.size() << (asked ? "" : ", not asked about");
      blocked_ += Bit(blocked, lane) ? 1 : 0;
      lit_ += asked && !Bit(blocked, lane) ? 1 : 0;
    }
  }

  TestRng rng_;
  int64_t blocked_ = 0, lit_ = 0;
};
SIGHTLINE_FOR_EACH_TARGET(ShaftBitsTest);

TEST_P(ShaftBitsTest, SegmentsAndRaysGiveBruteForcesBits) {
  const auto packet = std::make_unique<RayPacket>();
  for (const NastyScene& scene : MakeNastyScenes(rng_)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng_);
    for (int64_t i = 0, n = ScaledCount(60, 6); i < n; ++i) {
      const int count =
          rng_.Chance(0.5) ? RayPacket::kMaxRays : 1 + static_cast<int>(rng_.Below(256));
      const std::vector<TraceRay> queries = rays.FillPacket(count, packet.get());
      const std::vector<Hit> truth = Truth(scene.indexed, queries);
      ShaftCut cut;
      const bool has_cut =
          kernels().cut_shaft(scene.indexed, std::span<const RayPacket>(packet.get(), 1), &cut);
      for (const bool from_cut : {false, true}) {
        CheckBits(queries, truth, i % 2 == 0, packet.get(), [&] {
          WalkStats stats;
          ASSERT_TRUE(kernels().occluded_shaft(
              scene.indexed, *packet, from_cut && has_cut ? &cut : nullptr, nullptr, &stats));
        });
      }
    }
  }
  EXPECT_GT(blocked_, lit_ / 10);
  EXPECT_GT(lit_, blocked_ / 10);
}

TEST_P(ShaftBitsTest, ParallelRaysGiveBruteForcesBits) {
  const auto packet = std::make_unique<ParallelPacket>();
  for (const NastyScene& scene : MakeNastyScenes(rng_)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng_);
    for (int64_t i = 0, n = ScaledCount(60, 6); i < n; ++i) {
      const Vec3f middle = rays.Point();
      // Now and then without a direction: such rays fit no frame, and meet nothing.
      packet->direction = rng_.Chance(0.05) ? Vec3f{} : rays.Target(middle, /*segment=*/false);
      packet->direction_source = rays.Source();
      packet->count =
          rng_.Chance(0.5) ? RayPacket::kMaxRays : 1 + static_cast<int>(rng_.Below(256));
      const bool narrow = rng_.Chance(0.7);
      std::vector<TraceRay> queries;
      for (int lane = 0; lane < packet->count; ++lane) {
        Vec3f origin = narrow ? middle : rays.Point();
        for (int k = 0; k < 3 && narrow; ++k) {
          origin[k] += static_cast<float>(rng_.Uniform(-0.03, 0.03)) * middle[k];
        }
        packet->origin_x[lane] = origin.x;
        packet->origin_y[lane] = origin.y;
        packet->origin_z[lane] = origin.z;
        packet->origin_source[lane] = rays.Source();
        queries.push_back(packet->trace_ray(lane));
      }
      CheckBits(queries, Truth(scene.indexed, queries), i % 2 == 0, packet.get(), [&] {
        WalkStats stats;
        ASSERT_TRUE(
            kernels().occluded_parallel_shaft(scene.indexed, *packet, nullptr, nullptr, &stats));
      });
    }
  }
  EXPECT_GT(blocked_, lit_ / 10);
  EXPECT_GT(lit_, blocked_ / 10);
}

TEST_P(ShaftBitsTest, NobodyReadsTheSourcesOfPacketsWithoutAny) {
  const auto segments = std::make_unique<RayPacket>();
  const auto parallel = std::make_unique<ParallelPacket>();
  for (const NastyScene& scene : MakeNastyScenes(rng_)) {
    SCOPED_TRACE(scene.name);
    const auto triangles = static_cast<uint32_t>(scene.indexed.geometry.triangles.size());
    if (triangles == 0) continue;
    NastyRays rays(scene.indexed, rng_);
    for (int64_t i = 0, n = ScaledCount(40, 4); i < n; ++i) {
      std::vector<TraceRay> queries =
          rays.FillPacket(1 + static_cast<int>(rng_.Below(RayPacket::kMaxRays)), segments.get());
      segments->segments = true;
      segments->sourceless = true;
      for (size_t lane = 0; lane < queries.size(); ++lane) {
        segments->target_source[lane] = static_cast<uint32_t>(rng_.Below(triangles));
        queries[lane] = segments->trace_ray(static_cast<int>(lane));
        ASSERT_EQ(queries[lane].to_source, kNoTriangle);
      }
      const std::vector<Hit> truth = Truth(scene.indexed, queries);
      using Walk = decltype(kernels().occluded_packet);
      const auto check = [&](const auto& trace) {
        std::fill_n(segments->triangle, RayPacket::kMaxRays, 12345u);
        segments->first_leaf = RayPacket::kNoLeaf;
        ASSERT_TRUE(trace());
        for (size_t lane = 0; lane < queries.size(); ++lane) {
          ASSERT_EQ(segments->triangle[lane] == kNoTriangle, truth[lane].triangle == kNoTriangle)
              << "lane " << lane << " of " << queries.size() << ", " << Printed{queries[lane]};
        }
      };
      WalkStats stats;
      for (const Walk walk : {kernels().occluded_packet, kernels().closest_packet}) {
        check([&] { return walk(scene.indexed, *segments, nullptr, &stats); });
      }
      check([&] {
        return kernels().occluded_shaft(scene.indexed, *segments, nullptr, nullptr, &stats);
      });
      check([&] {
        return kernels().closest_shaft(scene.indexed, *segments, nullptr, nullptr, &stats);
      });

      // The same points, in one direction.
      parallel->direction = rays.Target(rays.Point(), /*segment=*/false);
      if (MaxAbs(parallel->direction) == 0) continue;
      parallel->count = segments->count;
      parallel->sourceless = true;
      for (size_t lane = 0; lane < queries.size(); ++lane) {
        parallel->origin_x[lane] = segments->target_x[lane];
        parallel->origin_y[lane] = segments->target_y[lane];
        parallel->origin_z[lane] = segments->target_z[lane];
        parallel->origin_source[lane] = segments->target_source[lane];
        queries[lane] = parallel->trace_ray(static_cast<int>(lane));
        ASSERT_EQ(queries[lane].from_source, kNoTriangle);
      }
      const std::vector<Hit> beside = Truth(scene.indexed, queries);
      for (const bool shaft : {true, false}) {
        parallel->first_leaf = RayPacket::kNoLeaf;
        ASSERT_TRUE(
            shaft ? kernels().occluded_parallel_shaft(scene.indexed, *parallel, nullptr, nullptr,
                                                      &stats)
                  : kernels().occluded_parallel_packet(scene.indexed, *parallel, nullptr, &stats));
        for (size_t lane = 0; lane < queries.size(); ++lane) {
          ASSERT_EQ(parallel->triangle[lane] == kNoTriangle, beside[lane].triangle == kNoTriangle)
              << "lane " << lane << " of " << queries.size() << ", " << Printed{queries[lane]};
        }
      }
    }
  }
}

}  // namespace
}  // namespace sightline::testing_support
