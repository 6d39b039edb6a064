// SPDX-License-Identifier: Apache-2.0
//
// The walks on the kd-tree give brute force's bits, for every instruction set, with trees from
// shallow to deep, with and without perfect splits; and a hunt for rays that slip between cells.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/accel/kd_builder.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/same_bits.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/core/traverse/traced_hits.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

const KdBuildOptions kBuilds[] = {
    {},
    {.traversal_cost = 0.01f, .max_depth = 62, .max_references = 64},
    {.traversal_cost = 10.0f, .min_leaf_triangles = 40},
    {.perfect_splits = true},
    {.traversal_cost = 0.01f, .perfect_splits = true, .max_depth = 62, .max_references = 64},
};

std::string NameOf(const KdBuildOptions& options) {
  return absl::StrCat("cost ", options.traversal_cost, options.perfect_splits ? ", perfect" : "");
}

void Build(const KdBuildOptions& options, IndexedGeometry* indexed) {
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(indexed->geometry, options, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  indexed->kd_tree = *std::move(tree);
}

class KdWalksTest : public KernelsFixture {
 protected:
  // Single rays against brute force.
  void Compare(const IndexedGeometry& scene, const std::vector<TraceRay>& queries,
               int64_t* hits = nullptr) const {
    const std::vector<Hit> truth = Trace(kernels().closest_brute, scene, queries);
    const std::vector<Hit> closest = Trace(kernels().closest_kd_single, scene, queries);
    const std::vector<Hit> any = Trace(kernels().occluded_kd_single, scene, queries);
    for (size_t i = 0; i < queries.size(); ++i) {
      ASSERT_TRUE(SameBits(closest[i], truth[i]))
          << Printed{queries[i]} << ": " << closest[i].triangle << " at " << closest[i].t
          << ", not " << truth[i].triangle << " at " << truth[i].t;
      ASSERT_EQ(any[i].triangle != kNoTriangle, truth[i].triangle != kNoTriangle)
          << Printed{queries[i]};
      if (any[i].triangle != kNoTriangle) {
        const auto [a, b, c] = scene.geometry.Corners(any[i].triangle);
        ASSERT_TRUE(BlocksExactly(queries[i].ray, a, b, c)) << Printed{queries[i]};
      }
      if (hits != nullptr) *hits += truth[i].triangle != kNoTriangle;
    }
  }
};

SIGHTLINE_FOR_EACH_TARGET(KdWalksTest);

TEST_P(KdWalksTest, SingleRaysGiveBruteForcesBits) {
  TestRng rng;
  int64_t hits = 0, all = 0;
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    NastyRays rays(scene.indexed, rng);
    for (const KdBuildOptions& options : kBuilds) {
      SCOPED_TRACE(absl::StrCat(scene.name, ", ", NameOf(options)));
      ASSERT_NO_FATAL_FAILURE(Build(options, &scene.indexed));
      std::vector<TraceRay> queries;
      for (int64_t i = ScaledCount(1'000); i > 0; --i) queries.push_back(rays.Next());
      ASSERT_NO_FATAL_FAILURE(Compare(scene.indexed, queries, &hits));
      all += static_cast<int64_t>(queries.size());
    }
  }
  EXPECT_GT(hits, all / 10);
  EXPECT_LT(hits, all - all / 10);
}

float UlpsAway(float x, TestRng& rng) {
  for (uint64_t n = rng.Below(3); n > 0; --n) {
    x = std::nextafter(x, rng.Chance(0.5) ? std::numeric_limits<float>::infinity()
                                          : -std::numeric_limits<float>::infinity());
  }
  return x;
}

// What the cells' margins must stand: rays within an ulp of splits, along them, through the corners
// and edges of leaves, and from there; and along triangles, where distances are worst.
TEST_P(KdWalksTest, NoRaySlipsBetweenCells) {
  TestRng rng;
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    NastyRays rays(scene.indexed, rng);
    for (const KdBuildOptions& options : kBuilds) {
      SCOPED_TRACE(absl::StrCat(scene.name, ", ", NameOf(options)));
      ASSERT_NO_FATAL_FAILURE(Build(options, &scene.indexed));
      const KdTree& tree = *scene.indexed.kd_tree;
      if (tree.leaves.empty()) continue;
      const auto weak = [&] {
        Vec3f p = rays.Point();
        const Box3f box = tree.leaves[rng.Below(tree.leaves.size())].box();
        for (int axis = 0; axis < 3; ++axis) {
          if (rng.Chance(0.3)) p[axis] = rng.Chance(0.5) ? box.lo[axis] : box.hi[axis];
        }
        const KdNode node = tree.nodes[rng.Below(tree.nodes.size())];
        if (!node.is_leaf() && rng.Chance(0.7)) p[node.axis()] = node.split();
        for (int axis = 0; axis < 3; ++axis) {
          if (rng.Chance(0.3)) p[axis] = UlpsAway(p[axis], rng);
        }
        return p;
      };
      std::vector<TraceRay> queries;
      for (int64_t i = ScaledCount(1'000); i > 0; --i) {
        const Vec3f from = weak(), to = weak();
        TraceRay query;
        query.ray.origin = from;
        query.ray.segment = rng.Chance(0.5);
        query.ray.target = query.ray.segment ? to : to - from;
        if (rng.Chance(0.2)) {  // Along a plane of splits.
          const int axis = static_cast<int>(rng.Below(3));
          query.ray.target[axis] = query.ray.segment ? from[axis] : rng.Chance(0.5) ? 0.0f : -0.0f;
        }
        if (MaxAbs(query.ray.RoundedDirection()) == 0) continue;
        queries.push_back(query);
      }
      ASSERT_NO_FATAL_FAILURE(Compare(scene.indexed, queries));
    }
  }
}

// A fan of large triangles through one axis, seen along their planes: quotients are off by much
// more than a cell is wide, and the hit that counts may stand in a cell behind another's.
TEST_P(KdWalksTest, DistancesOffByMoreThanACellKeepTheirOrder) {
  TestRng rng;
  ObjectInput fan{.name = "fan"};
  for (int i = 0; i < 120; ++i) {
    const double angle = 0.05 * i, far = 3 + 0.1 * i;
    for (const Vec3d& v : {Vec3d{-far, 0.001 * i, 0}, Vec3d{far, 0, 0.002 * i},
                           Vec3d{far, std::cos(angle), std::sin(angle)}}) {
      fan.indices.push_back(static_cast<uint32_t>(fan.vertices.size()));
      fan.vertices.push_back(v);
    }
  }
  IndexedGeometry indexed = IndexObjects({fan}, Vec3d{});
  for (const KdBuildOptions& options : kBuilds) {
    SCOPED_TRACE(NameOf(options));
    ASSERT_NO_FATAL_FAILURE(Build(options, &indexed));
    std::vector<TraceRay> queries;
    for (int64_t i = ScaledCount(20'000); i > 0; --i) {
      const auto corners = indexed.geometry.Corners(static_cast<uint32_t>(rng.Below(120)));
      // Two points of a triangle's plane, rounded, and a few ulps to either side.
      const auto on_plane = [&] {
        const float u = static_cast<float>(rng.Uniform(-1, 2));
        const float v = static_cast<float>(rng.Uniform(-1, 2));
        Vec3f p = corners[0] + u * (corners[1] - corners[0]) + v * (corners[2] - corners[0]);
        for (int axis = 0; axis < 3; ++axis) p[axis] = UlpsAway(p[axis], rng);
        return p;
      };
      const Vec3f from = on_plane(), to = on_plane();
      const bool segment = rng.Chance(0.5);
      queries.push_back({.ray = {from, segment ? to : to - from, segment}});
    }
    int64_t hits = 0;
    ASSERT_NO_FATAL_FAILURE(Compare(indexed, queries, &hits));
    EXPECT_GT(hits, 0);
  }
}

TEST_P(KdWalksTest, PacketsGiveBruteForcesBits) {
  TestRng rng;
  const auto packet = std::make_unique<RayPacket>();
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    NastyRays rays(scene.indexed, rng);
    for (const KdBuildOptions& options : kBuilds) {
      SCOPED_TRACE(absl::StrCat(scene.name, ", ", NameOf(options)));
      ASSERT_NO_FATAL_FAILURE(Build(options, &scene.indexed));
      for (int64_t i = 0, n = ScaledCount(20, 5); i < n; ++i) {
        const int count = 1 + static_cast<int>(rng.Below(RayPacket::kMaxRays));
        const std::vector<TraceRay> queries = rays.FillPacket(count, packet.get());
        const std::vector<Hit> truth = Trace(kernels().closest_brute, scene.indexed, queries);
        for (const bool any : {false, true}) {
          std::fill_n(packet->triangle, RayPacket::kMaxRays, 12345u);
          WalkStats stats;
          ASSERT_TRUE((any ? kernels().occluded_kd_packet : kernels().closest_kd_packet)(
              scene.indexed, *packet, nullptr, &stats));
          for (int lane = 0; lane < packet->count; ++lane) {
            const Hit hit = packet->hit(lane);
            if (any) {
              ASSERT_EQ(hit.triangle != kNoTriangle, truth[lane].triangle != kNoTriangle)
                  << "lane " << lane << ", " << Printed{queries[lane]};
              continue;
            }
            ASSERT_TRUE(SameBits(hit, truth[lane]))
                << "lane " << lane << ", " << Printed{queries[lane]} << ": " << hit.triangle
                << " at " << hit.t << ", not " << truth[lane].triangle << " at " << truth[lane].t;
            if (!packet->want_barycentrics) continue;
            float u = 0, v = 0;
            if (hit.triangle != kNoTriangle) {
              const auto [a, b, c] = scene.indexed.geometry.Corners(hit.triangle);
              HitBarycentrics(queries[lane].ray, a, b, c, &u, &v);
            }
            ASSERT_EQ(std::bit_cast<uint32_t>(packet->u[lane]), std::bit_cast<uint32_t>(u));
            ASSERT_EQ(std::bit_cast<uint32_t>(packet->v[lane]), std::bit_cast<uint32_t>(v));
          }
        }
      }
    }
  }
}

TEST_P(KdWalksTest, NothingToDoAndFiredTokens) {
  TestRng rng;
  IndexedGeometry scene = IndexObjects({MakeClosedSphere(60, 80, 1, {})}, Vec3d{});
  ASSERT_NO_FATAL_FAILURE(Build({}, &scene));
  NastyRays rays(scene, rng);
  const auto packet = std::make_unique<RayPacket>();
  WalkStats stats;
  EXPECT_TRUE(kernels().closest_kd_packet(scene, *packet, nullptr, &stats));
  EXPECT_TRUE(kernels().closest_kd_single(scene, {}, {}, nullptr, &stats));
  EXPECT_EQ(stats.nodes, 0u);
  CancelToken cancel;
  cancel.Cancel();
  std::vector<TraceRay> queries(500);
  for (TraceRay& query : queries) query = rays.Next();
  std::vector<Hit> hits(queries.size());
  EXPECT_FALSE(kernels().closest_kd_single(scene, queries, hits, &cancel, &stats));
  EXPECT_FALSE(kernels().occluded_kd_single(scene, queries, hits, &cancel, &stats));
  packet->segments = false;
  packet->count = RayPacket::kMaxRays;
  for (int lane = 0; lane < packet->count; ++lane) {
    packet->target_x[lane] = static_cast<float>(rng.Uniform(-1, 1));
    packet->target_y[lane] = static_cast<float>(rng.Uniform(-1, 1));
    packet->target_z[lane] = static_cast<float>(rng.Uniform(-1, 1));
  }
  EXPECT_FALSE(kernels().closest_kd_packet(scene, *packet, &cancel, &stats));
}

}  // namespace
}  // namespace sightline::testing_support
