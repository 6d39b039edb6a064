// SPDX-License-Identifier: Apache-2.0
//
// The walks that cull within leaves give brute force's bits, with every combination of their
// options, over trees of every leaf size; with the papers' own tests, they differ from the same
// test over all triangles only within that test's bound.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iostream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/accel/binary_bvh_builder.h"
#include "core/accel/kd_builder.h"
#include "core/traverse/culled_kernels.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/intersector_answers.h"
#include "tests/core/intersect/same_bits.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

// All trees, with leaves of all sizes.
void AddTrees(IndexedGeometry* scene, TestRng& rng) {
  ThreadPool pool(2);
  const float ratios[] = {0.01f, 0.1f, 1.0f, 10.0f};
  auto bvh =
      BuildBinaryBvh(scene->geometry,
                     {.bins = rng.Chance(0.5) ? 8 : 32, .cost_ratio = ratios[rng.Below(4)]}, pool);
  ASSERT_TRUE(bvh.ok()) << bvh.status();
  scene->binary_bvh = *std::move(bvh);
  scene->bvh = BuildOrFail(scene->geometry, BvhPresetOptions(rng.Chance(0.5) ? BvhPreset::kCompact
                                                                             : BvhPreset::kStatic));
  auto kd = BuildKdTree(
      scene->geometry,
      {.traversal_cost = rng.Chance(0.5) ? 10.0f : 0.5f, .perfect_splits = rng.Chance(0.3)}, pool);
  ASSERT_TRUE(kd.ok()) << kd.status();
  scene->kd_tree = *std::move(kd);
  scene->kd_leaves.reset();
  if (rng.Chance(0.7)) {
    scene->kd_leaves = MakeLeafTriangles(scene->geometry,
                                         {scene->kd_tree->ids.data(), scene->kd_tree->ids.size()});
  }
}

LeafCulling RandomCulling(TestRng& rng) {
  LeafCulling c;
  c.tree = static_cast<CulledTree>(rng.Below(3));
  c.side_planes = rng.Chance(0.7);
  c.near_far = rng.Chance(0.6);
  c.aperture = rng.Chance(0.6);
  c.aperture_first = rng.Chance(0.5);
  c.skip_edges = rng.Chance(0.7);
  c.frustum = static_cast<FrustumRays>(rng.Below(3));
  c.first_axis = rng.Chance(0.3);
  c.ray_mask = rng.Chance(0.6);
  c.node_test = static_cast<NodeTest>(rng.Below(3));
  c.split = rng.Chance(0.5) ? PacketSplit::kHalves : PacketSplit::kSingleRays;
  c.ray_box = rng.Chance(0.7);
  c.ray_box_min_triangles = static_cast<uint32_t>(rng.Below(20));
  c.ray_box_update = rng.Chance(0.7);
  c.mailbox = rng.Chance(0.4);
  c.cell_boxes = rng.Chance(0.4);
  return c;
}

std::string Describe(const LeafCulling& c) {
  std::string text = c.tree == CulledTree::kBinaryBvh ? "binary"
                     : c.tree == CulledTree::kKdTree  ? "kd"
                                                      : "bvh";
  const std::pair<const char*, bool> switches[] = {
      {"planes", c.side_planes},    {"near_far", c.near_far},
      {"aperture", c.aperture},     {"aperture_first", c.aperture_first},
      {"skip", c.skip_edges},       {"first_axis", c.first_axis},
      {"ray_mask", c.ray_mask},     {"box", c.ray_box},
      {"update", c.ray_box_update}, {"mailbox", c.mailbox},
      {"cells", c.cell_boxes}};
  for (const auto& [name, on] : switches) {
    if (on) text += std::string(" ") + name;
  }
  return text + " frustum " + std::to_string(static_cast<int>(c.frustum)) + " nodes " +
         std::to_string(static_cast<int>(c.node_test)) + " split " +
         std::to_string(static_cast<int>(c.split)) + " test " +
         std::string(IntersectorName(c.intersector));
}

class CulledWalksTest : public KernelsFixture {
 protected:
  const CulledKernels& culled() const { return CulledKernelsFor(GetParam()); }
  std::vector<Hit> Brute(const IndexedGeometry& scene, const std::vector<TraceRay>& rays) const {
    std::vector<Hit> hits(rays.size());
    WalkStats stats;
    EXPECT_TRUE(kernels().closest_brute(scene, rays, hits, nullptr, &stats));
    return hits;
  }
};

SIGHTLINE_FOR_EACH_TARGET(CulledWalksTest);

TEST_P(CulledWalksTest, SingleRaysGiveBruteForcesBitsWithEveryOption) {
  TestRng rng;
  uint64_t culled_tests = 0, updates = 0;
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    for (int trees = 0; trees < 3; ++trees) {
      ASSERT_NO_FATAL_FAILURE(AddTrees(&scene.indexed, rng));
      for (int round = 0; round < 6; ++round) {
        const LeafCulling culling = RandomCulling(rng);
        SCOPED_TRACE(Describe(culling));
        NastyRays rays(scene.indexed, rng);
        std::vector<TraceRay> queries;
        for (int64_t i = ScaledCount(250); i > 0; --i) queries.push_back(rays.Next());
        const std::vector<Hit> truth = Brute(scene.indexed, queries);
        std::vector<Hit> hits(queries.size(), Hit{-1, 12345}), any = hits;
        WalkStats stats;
        ASSERT_TRUE(
            culled().closest_single(scene.indexed, culling, queries, hits, nullptr, &stats));
        ASSERT_TRUE(
            culled().occluded_single(scene.indexed, culling, queries, any, nullptr, &stats));
        culled_tests += stats.culled_tests;
        updates += stats.ray_box_updates;
        for (size_t i = 0; i < queries.size(); ++i) {
          ASSERT_TRUE(SameBits(hits[i], truth[i]))
              << Printed{queries[i]} << ": " << hits[i].triangle << " at " << hits[i].t << ", not "
              << truth[i].triangle << " at " << truth[i].t;
          ASSERT_EQ(any[i].triangle == kNoTriangle, truth[i].triangle == kNoTriangle)
              << Printed{queries[i]};
        }
      }
    }
  }
  EXPECT_GT(culled_tests, 10'000u);
  EXPECT_GT(updates, 50u);
}

// A packet from `origin`: narrow, wide, or in all directions, so that some have no common axis; or
// in all directions but along one axis, where all go the same way, by however little: slopes to
// that axis reach the largest floats.
void FillPacket(const IndexedGeometry& scene, NastyRays& rays, TestRng& rng, RayPacket* packet,
                std::vector<TraceRay>* queries) {
  constexpr int kSizes[] = {1, 4, 16, 64, 100, 256};
  packet->origin = rays.Point();
  packet->segments = rng.Chance(0.5);
  packet->mask = rng.Chance(0.8) ? 0xFFFFFFFFu : 1u << rng.Below(3);
  packet->origin_source = rays.Source();
  packet->count = kSizes[rng.Below(std::size(kSizes))];
  packet->want_barycentrics = false;
  const double spread = rng.Chance(0.7) ? std::exp(rng.Uniform(-8, -1)) : 0.0;
  const double strays = rng.Chance(0.3) ? 0.05 : 0.0;
  const int steep_axis = !packet->segments && rng.Chance(0.2) ? static_cast<int>(rng.Below(3)) : -1;
  const double steep = std::exp2(-rng.Uniform(0, 130)) * (rng.Chance(0.5) ? 1 : -1);
  const Vec3f middle = rays.Target(packet->origin, packet->segments);
  const Vec3f away = packet->segments ? middle - packet->origin : middle;
  queries->clear();
  for (int lane = 0; lane < packet->count; ++lane) {
    Vec3f target = rays.Target(packet->origin, packet->segments);
    if (spread > 0 && !rng.Chance(strays)) {
      target = middle;
      const float size = MaxAbs(away) * static_cast<float>(spread);
      for (int k = 0; k < 3; ++k) target[k] += size * static_cast<float>(rng.Uniform(-1, 1));
    }
    if (steep_axis >= 0) {
      target = rays.Target(packet->origin, /*segment=*/false);
      target[steep_axis] = static_cast<float>(steep * rng.Uniform(0.5, 1));
    }
    packet->target_x[lane] = target.x;
    packet->target_y[lane] = target.y;
    packet->target_z[lane] = target.z;
    packet->target_source[lane] = packet->segments ? rays.Source() : kNoTriangle;
    queries->push_back(
        {packet->ray(lane), packet->mask, packet->origin_source, packet->target_source[lane]});
  }
  (void)scene;
}

TEST_P(CulledWalksTest, PacketsGiveBruteForcesBitsWithEveryOption) {
  TestRng rng;
  uint64_t culled_tests = 0, tests = 0;
  const auto packet = std::make_unique<RayPacket>();
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    for (int trees = 0; trees < 3; ++trees) {
      ASSERT_NO_FATAL_FAILURE(AddTrees(&scene.indexed, rng));
      NastyRays rays(scene.indexed, rng);
      std::vector<TraceRay> queries;
      for (int64_t i = ScaledCount(40, 10); i > 0; --i) {
        const LeafCulling culling = RandomCulling(rng);
        SCOPED_TRACE(Describe(culling));
        FillPacket(scene.indexed, rays, rng, packet.get(), &queries);
        const std::vector<Hit> truth = Brute(scene.indexed, queries);
        WalkStats stats;
        ASSERT_TRUE(culled().closest_packet(scene.indexed, culling, *packet, nullptr, &stats));
        for (size_t k = 0; k < queries.size(); ++k) {
          const Hit hit = packet->hit(static_cast<int>(k));
          ASSERT_TRUE(SameBits(hit, truth[k]))
              << Printed{queries[k]} << ": " << hit.triangle << " at " << hit.t << ", not "
              << truth[k].triangle << " at " << truth[k].t << ", lane " << k << " of "
              << packet->count;
        }
        ASSERT_TRUE(culled().occluded_packet(scene.indexed, culling, *packet, nullptr, &stats));
        for (size_t k = 0; k < queries.size(); ++k) {
          ASSERT_EQ(packet->triangle[k] == kNoTriangle, truth[k].triangle == kNoTriangle)
              << Printed{queries[k]} << ", lane " << k << " of " << packet->count;
        }
        culled_tests += stats.culled_tests;
        tests += stats.triangle_tests;
      }
    }
  }
  std::cout << "tests culled: " << culled_tests << ", made: " << tests << '\n';
  EXPECT_GT(culled_tests, tests / 10);
}

// Triangles one behind another in a leaf, in that order, along z from 5 on.
IndexedGeometry MakeStack(uint32_t count) {
  ObjectInput object;
  for (uint32_t i = 0; i < count; ++i) {
    const double z = 5 + 0.1 * i, size = i == 0 ? 1 : 0.9;
    const Vec3d corners[] = {{-size, -size, z}, {3 * size, -size, z}, {-size, 3 * size, z}};
    for (const Vec3d& corner : corners) {
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(corner);
    }
  }
  IndexedGeometry scene = IndexObjects({object}, Vec3d{0, 0, 0});
  ThreadPool pool(1);
  auto bvh = BuildBinaryBvh(scene.geometry, {.min_triangles = 1000}, pool);
  auto kd = BuildKdTree(scene.geometry, {.min_leaf_triangles = 1000}, pool);
  EXPECT_TRUE(bvh.ok() && kd.ok()) << bvh.status() << kd.status();
  scene.binary_bvh = *std::move(bvh);
  scene.kd_tree = *std::move(kd);
  for (uint32_t i = 0; i < count; ++i) EXPECT_EQ(scene.binary_bvh->ids[i], i) << "in order";
  return scene;
}

// All rays of a packet but one see the stack; that one sees the sky: what it looks for has no end,
// but it is not asked about this leaf. The others' far plane moves up to what they hit: at once
// where that covers their frustum, else after sixteen triangles.
TEST_P(CulledWalksTest, ARayThatSeesTheSkyLeavesTheOthersTheirFarPlane) {
  constexpr uint32_t kTriangles = 41, kRays = 64, kSeeing = kRays - 1;
  const IndexedGeometry scene = MakeStack(kTriangles);
  const auto packet = std::make_unique<RayPacket>();
  packet->origin = {0, 0, 0};
  packet->segments = false;
  packet->count = kRays;
  for (uint32_t lane = 0; lane < kRays; ++lane) {
    const uint32_t column = lane % 8, row = lane / 8;
    packet->target_x[lane] = lane < kSeeing ? 0.01f * static_cast<float>(column) : 2.0f;
    packet->target_y[lane] = 0.01f * static_cast<float>(row);
    packet->target_z[lane] = 1;
    packet->target_source[lane] = kNoTriangle;
  }
  for (const Intersector intersector : {Intersector::kExact, Intersector::kKenslerShirley}) {
    for (const FrustumRays frustum : kAllFrustumRays) {
      for (const auto& [ray_mask, aperture, aperture_first] : {std::array{false, false, false},
                                                               {true, false, false},
                                                               {true, true, false},
                                                               {false, true, true},
                                                               {true, true, true}}) {
        LeafCulling culling = LeafCulling::None();
        culling.intersector = intersector;
        culling.frustum = frustum;
        culling.near_far = true;
        culling.ray_mask = ray_mask;
        culling.aperture = aperture;
        culling.aperture_first = aperture_first;
        SCOPED_TRACE(Describe(culling));
        WalkStats stats;
        ASSERT_TRUE(culled().closest_packet(scene, culling, *packet, nullptr, &stats));
        for (uint32_t lane = 0; lane < kRays; ++lane) {
          EXPECT_EQ(packet->triangle[lane], lane < kSeeing ? 0 : kNoTriangle);
        }
        const uint64_t asked = ray_mask ? kSeeing : kRays;
        const bool at_once = aperture && frustum == FrustumRays::kMasked;
        EXPECT_EQ(stats.triangle_tests, asked * (at_once ? 1 : kMaxLeafTriangles));
        EXPECT_EQ(stats.culled_tests + stats.triangle_tests, asked * kTriangles);
      }
    }
  }
}

// The part of a ray ends at each hit (paper 001, section 3.5): the rest of the leaf meets the
// smaller box. By the predicate sixteen triangles are tested at once, and the next ones meet it.
TEST_P(CulledWalksTest, ARaysBoxEndsAtEachHit) {
  struct Case {
    uint32_t triangles;
    Intersector intersector;
    bool update;
    uint64_t tests, updates;          // Where the nearest triangle is the leaf's first,
    uint64_t far_tests, far_updates;  // and where it is the last.
  };
  for (const Case& c : {Case{12, Intersector::kMoellerTrumbore, true, 1, 1, 12, 11},
                        Case{41, Intersector::kMoellerTrumbore, true, 1, 1, 41, 40},
                        Case{12, Intersector::kMoellerTrumbore, false, 12, 0, 12, 0},
                        Case{12, Intersector::kExact, true, 12, 0, 12, 0},
                        Case{41, Intersector::kExact, true, 16, 1, 41, 2}}) {
    const IndexedGeometry scene = MakeStack(c.triangles);
    // Boxes stored with the leaf, and made on the way.
    for (const CulledTree tree : {CulledTree::kBinaryBvh, CulledTree::kKdTree}) {
      LeafCulling culling = LeafCulling::None();
      culling.tree = tree;
      culling.intersector = c.intersector;
      culling.ray_box = true;
      culling.ray_box_update = c.update;
      SCOPED_TRACE(testing::Message() << c.triangles << ", " << Describe(culling));
      const TraceRay ahead = {.ray = PredicateRay::Ray({0, 0, 0}, {0.01f, -0.01f, 1})};
      const TraceRay back = {.ray = PredicateRay::Segment({0, 0, 20}, {0.01f, -0.01f, 0})};
      for (const bool from_ahead : {true, false}) {
        Hit hit;
        WalkStats stats;
        ASSERT_TRUE(culled().closest_single(scene, culling, {from_ahead ? &ahead : &back, 1},
                                            {&hit, 1}, nullptr, &stats));
        EXPECT_EQ(hit.triangle, from_ahead ? 0 : c.triangles - 1);
        EXPECT_EQ(stats.triangle_tests, from_ahead ? c.tests : c.far_tests);
        EXPECT_EQ(stats.ray_box_updates, from_ahead ? c.updates : c.far_updates);
        EXPECT_EQ(stats.triangle_tests + stats.culled_tests, c.triangles);
      }
    }
  }
}

TEST_P(CulledWalksTest, ThePapersTestsDifferFromTheirBruteForceOnlyWithinTheirBounds) {
  TestRng rng;
  DifferenceTally tally;
  const auto packet = std::make_unique<RayPacket>();
  for (NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    const SceneGeometry& geometry = scene.indexed.geometry;
    for (const Intersector kind : kPaperIntersectors) {
      ASSERT_NO_FATAL_FAILURE(AddTrees(&scene.indexed, rng));
      scene.indexed.prepared.reset();
      if (rng.Chance(0.7)) scene.indexed.prepared = PrepareGeometry(geometry, kind);
      NastyRays rays(scene.indexed, rng);
      for (int64_t i = ScaledCount(4, 4); i > 0; --i) {
        LeafCulling culling = RandomCulling(rng);
        culling.intersector = kind;
        SCOPED_TRACE(Describe(culling));
        std::vector<TraceRay> queries;
        FillPacket(scene.indexed, rays, rng, packet.get(), &queries);
        std::vector<Hit> hits(queries.size()), truths = hits;
        WalkStats stats;
        ASSERT_TRUE(culled().closest_packet(scene.indexed, culling, *packet, nullptr, &stats));
        ASSERT_TRUE(
            culled().closest_single(scene.indexed, culling, queries, hits, nullptr, &stats));
        ASSERT_TRUE(
            culled().closest_brute(scene.indexed, culling, queries, truths, nullptr, &stats));
        for (size_t k = 0; k < queries.size(); ++k) {
          for (const Hit& hit : {packet->hit(static_cast<int>(k)), hits[k]}) {
            const Difference difference =
                CompareHits(geometry, kind, queries[k].ray, hit, truths[k], culling.skip_edges);
            tally.Add(difference);
            ASSERT_NE(difference, Difference::kBeyondBound)
                << Printed{queries[k]} << ": " << hit.triangle << " at " << hit.t << ", not "
                << truths[k].triangle << " at " << truths[k].t;
          }
        }
      }
    }
  }
  std::cout << tally << '\n';
  EXPECT_GT(tally.compared(), 1000);
  EXPECT_GT(tally.of(Difference::kNone), tally.compared() * 3 / 4);
}

TEST_P(CulledWalksTest, ACancelledWalkStops) {
  TestRng rng;
  std::vector<NastyScene> scenes = MakeNastyScenes(rng);
  IndexedGeometry& scene = scenes.front().indexed;
  ASSERT_NO_FATAL_FAILURE(AddTrees(&scene, rng));
  CancelToken cancel;
  cancel.Cancel();
  NastyRays rays(scene, rng);
  const std::vector<TraceRay> queries = {rays.Next()};
  std::vector<Hit> hits(1);
  WalkStats stats;
  EXPECT_FALSE(culled().closest_single(scene, {}, queries, hits, &cancel, &stats));
}

}  // namespace
}  // namespace sightline::testing_support
