// SPDX-License-Identifier: Apache-2.0
//
// A cut by the hull of several origins and many points loses nothing that any of the origins'
// walks would find, for every instruction set of this machine.
#include <bit>
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

class HullCutTest : public KernelsFixture {
 protected:
  // All of the packet's segments, by every walk that begins at `cut`.
  void Compare(const IndexedGeometry& scene, RayPacket& packet, const ShaftCut* cut) {
    std::vector<TraceRay> queries;
    for (int lane = 0; lane < packet.count; ++lane) {
      queries.push_back({.ray = packet.ray(lane),
                         .mask = packet.mask,
                         .from_source = packet.origin_source,
                         .to_source = packet.target_source[lane]});
    }
    std::vector<Hit> truth(queries.size());
    WalkStats stats;
    ASSERT_TRUE(kernels().closest_brute(scene, queries, truth, nullptr, &stats));
    for (const bool any : {true, false}) {
      packet.first_leaf = RayPacket::kNoLeaf;
      ASSERT_TRUE((any ? kernels().occluded_shaft : kernels().closest_shaft)(scene, packet, cut,
                                                                             nullptr, &stats));
      for (int lane = 0; lane < packet.count; ++lane) {
        const TraceRay& query = queries[lane];
        if (any) {
          ASSERT_EQ(packet.triangle[lane] == kNoTriangle, truth[lane].triangle == kNoTriangle)
              << Printed{query} << "the definition: " << truth[lane].triangle;
        } else {
          ASSERT_EQ(packet.triangle[lane], truth[lane].triangle) << Printed{query};
          ASSERT_EQ(std::bit_cast<uint32_t>(packet.t[lane]), std::bit_cast<uint32_t>(truth[lane].t))
              << Printed{query};
        }
      }
    }
  }
};

SIGHTLINE_FOR_EACH_TARGET(HullCutTest);

// `spread` of the middle's size about it, in all directions.
Vec3f Near(Vec3f middle, float size, TestRng& rng) {
  Vec3f p = middle;
  for (int k = 0; k < 3; ++k) p[k] += static_cast<float>(rng.Uniform(-1, 1)) * size;
  return p;
}

TEST_P(HullCutTest, LosesNothing) {
  TestRng rng;
  int64_t cuts = 0, empty = 0;
  const auto packets = std::make_unique<RayPacket[]>(2);
  for (const NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng);
    for (int64_t i = 0, n = ScaledCount(40, 5); i < n; ++i) {
      // A light of some extent, or of points here and there; patches of points likewise.
      const Vec3f light = rays.Point();
      const float light_size = static_cast<float>(rng.Uniform(0, 0.1)) * Length(light);
      const bool compact = rng.Chance(0.8);
      std::vector<Vec3f> origins(4 + rng.Below(5));
      for (Vec3f& origin : origins) origin = compact ? Near(light, light_size, rng) : rays.Point();
      for (int p = 0; p < 2; ++p) {
        RayPacket& packet = packets[p];
        packet.segments = true;
        packet.mask = rng.Chance(0.8) ? 0xFFFFFFFFu : 1u << rng.Below(3);
        packet.origin_source = rays.Source();
        packet.count = 1 + static_cast<int>(rng.Below(80));
        const Vec3f middle = rays.Target(light, /*segment=*/true);
        const float size = static_cast<float>(rng.Uniform(0, 0.05)) * Length(middle);
        const double strays = rng.Chance(0.3) ? 0.1 : 0.0;
        for (int lane = 0; lane < packet.count; ++lane) {
          const Vec3f target =
              rng.Chance(strays) ? rays.Target(light, true) : Near(middle, size, rng);
          packet.target_x[lane] = target.x;
          packet.target_y[lane] = target.y;
          packet.target_z[lane] = target.z;
          packet.target_source[lane] = rays.Source();
        }
      }
      ShaftCut group, cut;
      const bool has_group = kernels().cut_hull(
          scene.indexed, origins, std::span<const RayPacket>(packets.get(), 2), nullptr, &group);
      const bool nested = has_group && rng.Chance(0.5);
      for (int p = 0; p < 2; ++p) {
        const std::span<const RayPacket> alone(&packets[p], 1);
        if (!kernels().cut_hull(scene.indexed, origins, alone, nested ? &group : nullptr, &cut)) {
          continue;
        }
        ++cuts;
        empty += cut.node_count == 0;
        for (const Vec3f& origin : origins) {
          packets[p].origin = origin;
          Compare(scene.indexed, packets[p], &cut);
          if (HasFatalFailure()) return;
        }
      }
    }
  }
  EXPECT_GT(cuts, 0);
  EXPECT_GT(empty, 0);
  EXPECT_GT(cuts, empty);
}

}  // namespace
}  // namespace sightline::testing_support
