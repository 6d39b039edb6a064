// SPDX-License-Identifier: Apache-2.0
//
// Hits of a packet are placed where each of them alone is, to the last bit, and are found to touch
// what each of them alone is found to touch.
#include "core/query/hit_placement.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <vector>

#include "core/query/touch_candidates.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

constexpr Vec3f kUntouched = {-7, -7, -7};

std::array<uint32_t, 3> BitsOf(Vec3f p) {
  return {std::bit_cast<uint32_t>(p.x), std::bit_cast<uint32_t>(p.y), std::bit_cast<uint32_t>(p.z)};
}

SimdTarget AnyTarget(TestRng& rng) {
  const std::vector<SimdTarget> targets = AvailableTargets();
  return targets[rng.Below(targets.size())];
}

// Rays from `eye` to lanes of a patch `spread` wide around `at`, traced.
void Trace(const IndexedGeometry& scene, TestRng& rng, Vec3f eye, Vec3d at, double spread,
           RayPacket* packet) {
  packet->origin = eye;
  packet->segments = false;
  packet->count = 1 + static_cast<int>(rng.Below(RayPacket::kMaxRays));
  if (rng.Chance(0.5)) packet->count = RayPacket::kMaxRays;
  const Vec3d right = RandomDirection(rng) * spread, down = RandomDirection(rng) * spread;
  std::vector<TraceRay> rays;
  for (int lane = 0; lane < packet->count; ++lane) {
    const double x = lane % 16 / 16.0 - 0.5, y = lane / 16 / 16.0 - 0.5;
    const Vec3f direction = ToFloat((at - ToDouble(eye)) + right * x + down * y);
    packet->target_x[lane] = direction.x;
    packet->target_y[lane] = direction.y;
    packet->target_z[lane] = direction.z;
    rays.push_back({.ray = PredicateRay::Ray(eye, direction)});
  }
  std::vector<Hit> hits(rays.size());
  WalkStats stats;
  ASSERT_TRUE(
      KernelsFor(SimdTarget::kBest).closest_single(scene, rays, hits, /*cancel=*/nullptr, &stats));
  for (int lane = 0; lane < packet->count; ++lane) {
    packet->t[lane] = hits[lane].t;
    packet->triangle[lane] = hits[lane].triangle;
  }
}

struct Seen {
  int64_t hits = 0, touching = 0, near_surface = 0;
};

// Places the packet's hits together and one by one.
void ExpectPlacedAlike(const IndexedGeometry& scene, const RayPacket& packet, HitPlacer* placer,
                       Seen* seen) {
  std::vector<Vec3f> positions(RayPacket::kMaxRays, kUntouched);
  placer->Place(packet, positions);
  std::vector<uint32_t> touched;
  for (int lane = 0; lane < RayPacket::kMaxRays; ++lane) {
    Placed expected = {.position = kUntouched};
    if (lane < packet.count && packet.triangle[lane] != kNoTriangle) {
      const auto [t, triangle] = packet.hit(lane);
      const HitSource source(scene, packet.origin, triangle);
      const Placement placement = source.PlacementOf(packet.origin, packet.target(lane), t);
      FindTouching(scene, placement.at, placement.radius, triangle, &touched);
      expected = PlaceTouching(scene, placement, source.plane, touched);
      const Vec3f alone = PlaceHit(scene, packet.origin, packet.target(lane), t, triangle);
      ASSERT_EQ(BitsOf(expected.position), BitsOf(alone)) << "lane " << lane;
      seen->near_surface += !expected.clear;
      ++seen->hits;
      seen->touching += !touched.empty();
    }
    ASSERT_EQ(BitsOf(positions[lane]), BitsOf(expected.position)) << "lane " << lane;
    ASSERT_EQ(placer->near_surface()[static_cast<size_t>(lane)], !expected.clear) << lane;
  }
}

double RandomSpread(TestRng& rng, double size) { return size * std::exp2(-rng.Uniform(0, 30)); }

TEST(HitPlacementTest, PacketsOfNastyScenesArePlacedAsSingleHits) {
  TestRng rng;
  Seen seen;
  for (const NastyScene& nasty : MakeNastyScenes(rng)) {
    SCOPED_TRACE(nasty.name);
    const IndexedGeometry& scene = nasty.indexed;
    if (scene.bvh.empty()) continue;
    NastyRays rays(scene, rng);
    const auto placer = std::make_unique<HitPlacer>(scene, AnyTarget(rng));
    const double size = Length(ToDouble(scene.bvh.bounds.Extent()));
    for (int64_t i = ScaledCount(40); i-- > 0;) {
      RayPacket packet;
      Trace(scene, rng, rays.Point(), ToDouble(rays.Point()), RandomSpread(rng, size), &packet);
      ASSERT_NO_FATAL_FAILURE(ExpectPlacedAlike(scene, packet, placer.get(), &seen));
    }
  }
  EXPECT_GT(seen.hits, 100);
  EXPECT_GT(seen.touching, 20);
  EXPECT_GT(seen.near_surface, 20);
}

// Meshes as they are: many triangles for one packet, some, two; whole objects and patches of less
// than a rounding; with the rows of leaves at hand, without, and on a kd-tree alone.
TEST(HitPlacementTest, PacketsOnMeshesArePlacedAsSingleHits) {
  Seen seen, on_kd;
  for (const Vec3d centre : {Vec3d{0, 0, 0}, Vec3d{1.5e5, -1.2e5, 1.4e5}}) {
    for (const int level : {0, 2, 5}) {
      TestRng rng(static_cast<uint64_t>(level));
      const Affine3d placement = RandomPlacement(rng, centre);
      BvhBuildOptions options;
      options.leaf_rows = rng.Chance(0.5);
      const IndexedGeometry scene = MakeScene(
          {MakeIcosphere(level, 10, placement), MakeBox({6, 7, 8}, placement)}, Vec3d{}, options);
      const IndexedGeometry kd_alone = OnKdTreeAlone(scene, {});
      const auto placer = std::make_unique<HitPlacer>(scene, AnyTarget(rng));
      const auto kd_placer = std::make_unique<HitPlacer>(kd_alone, AnyTarget(rng));
      for (int64_t i = ScaledCount(60); i-- > 0;) {
        const Vec3f eye = ToFloat(centre + RandomDirection(rng) * rng.Uniform(1, 60));
        const size_t aim = rng.Below(scene.geometry.triangles.size());
        const Vec3d at = PointNearRim(rng, scene.geometry.Corners(static_cast<uint32_t>(aim)));
        RayPacket packet;
        Trace(scene, rng, eye, at, RandomSpread(rng, 30), &packet);
        ASSERT_NO_FATAL_FAILURE(ExpectPlacedAlike(scene, packet, placer.get(), &seen));
        ASSERT_NO_FATAL_FAILURE(ExpectPlacedAlike(kd_alone, packet, kd_placer.get(), &on_kd));
      }
    }
  }
  EXPECT_GT(seen.hits, 100);
  EXPECT_GT(seen.touching, 20);
  EXPECT_EQ(on_kd.touching, seen.touching);
}

// One triangle again and again.
IndexedGeometry CopiesOf(uint32_t copies) {
  ObjectInput sheets{.vertices = {{-9, -9, 3}, {9, -9, 4}, {0, 12, 5}}};
  for (uint32_t i = 0; i < copies; ++i) sheets.indices.insert(sheets.indices.end(), {0, 1, 2});
  return MakeScene({sheets});
}

// The search leaves off once there are too many, to the same places as if it had found them all.
TEST(HitPlacementTest, OfManyCopiesNoMoreAreFoundThanAreSortedOut) {
  TestRng rng;
  for (const uint32_t copies : {1024u, 1025u, 1026u, 5000u}) {
    SCOPED_TRACE(copies);
    const IndexedGeometry scene = CopiesOf(copies), kd_alone = OnKdTreeAlone(scene, {});
    for (const IndexedGeometry* walked : {&scene, &kd_alone}) {
      const auto placer = std::make_unique<HitPlacer>(*walked, AnyTarget(rng));
      RayPacket packet;
      while (packet.count < 20) Trace(scene, rng, {0, 0, -5}, {0, 0, 4}, 0.5, &packet);
      packet.count = 20;
      std::vector<Vec3f> positions(RayPacket::kMaxRays, kUntouched);
      ASSERT_TRUE(placer->Place(packet, positions));
      std::vector<uint32_t> all, some;
      for (int lane = 0; lane < packet.count; ++lane) {
        const auto [t, triangle] = packet.hit(lane);
        ASSERT_NE(triangle, kNoTriangle);
        const HitSource source(*walked, packet.origin, triangle);
        const Placement placement =
            source.PlacementOf(packet.origin, packet.target(lane), packet.t[lane]);
        FindTouching(*walked, placement.at, placement.radius, triangle, &all);
        ASSERT_EQ(all.size(), copies - 1);
        FindTouching(*walked, placement.at, placement.radius, triangle, &some, kMaxTouched);
        if (all.size() <= kMaxTouched) {
          ASSERT_EQ(some, all);
        } else {
          ASSERT_GT(some.size(), kMaxTouched);
          ASSERT_LE(some.size(), 2 * kMaxTouched + 1);
        }
        const Placed expected = PlaceTouching(*walked, placement, source.plane, all);
        ASSERT_EQ(BitsOf(positions[lane]), BitsOf(expected.position)) << "lane " << lane;
      }
    }
  }
}

TEST(HitPlacementTest, StopsAmidOnePacket) {
  TestRng rng;
  const IndexedGeometry scene = CopiesOf(5000);
  CancelToken cancel;
  const auto placer = std::make_unique<HitPlacer>(scene, AnyTarget(rng), &cancel);
  RayPacket packet;
  while (packet.count < 16) Trace(scene, rng, {0, 0, -5}, {0, 0, 4}, 0.5, &packet);
  std::vector<Vec3f> positions(RayPacket::kMaxRays, kUntouched);
  EXPECT_TRUE(placer->Place(packet, positions));
  cancel.Cancel();
  EXPECT_FALSE(placer->Place(packet, positions));
}

// One try settles hits on a plain triangle; else the fast path could be off unnoticed.
TEST(HitPlacementTest, HitsInTheOpenAreSettledTogether) {
  TestRng rng;
  const IndexedGeometry scene =
      MakeScene({{.vertices = {{-9, -9, 3}, {9, -9, 4}, {0, 12, 5}}, .indices = {0, 1, 2}}});
  RayPacket packet;
  while (packet.count < 16) Trace(scene, rng, {0, 0, -5}, {0, 0, 4}, 0.5, &packet);
  const HitSource source(scene, packet.origin, 0);
  TouchPoints points;
  for (const SimdTarget simd : AvailableTargets()) {
    Vec3f placed[PlacementKernels::kLanes];
    EXPECT_EQ(PlacementKernelsFor(simd).place(source, packet, 8, 0b10110101, &points, placed),
              0b10110101u);
  }
}

// Points about as far from triangles as the radius is, where the planes must leave open what
// measuring finds near.
TEST(TouchCandidatesTest, FindWhatEachPointFinds) {
  TestRng rng;
  int64_t found = 0, asked = 0;
  for (const NastyScene& nasty : MakeNastyScenes(rng)) {
    SCOPED_TRACE(nasty.name);
    const auto candidates = std::make_unique<TouchCandidates>(PlacementKernelsFor(AnyTarget(rng)));
    const IndexedGeometry& scene = nasty.indexed;
    if (scene.bvh.empty()) continue;
    NastyRays rays(scene, rng);
    for (int64_t i = ScaledCount(300); i-- > 0;) {
      const double per_vertex = rng.Chance(0.5) ? 0x1p-44 : 0x1p-24;
      TouchPoints points;
      points.per_vertex = per_vertex;
      while (points.used == 0) points.used = static_cast<uint32_t>(rng.Below(0x10000));
      Box3d box;
      double base = 0, norm_one = 0;
      for (uint32_t left = points.used; left != 0; left &= left - 1) {
        const int k = std::countr_zero(left);
        const Vec3d near = ToDouble(rays.Point());
        points.base[k] = std::exp2(-rng.Uniform(0, 24)) * NormOne(near);
        const Vec3d at = near + RandomDirection(rng) * (points.base[k] * rng.Uniform(0, 3));
        points.x[k] = at.x;
        points.y[k] = at.y;
        points.z[k] = at.z;
        points.source[k] = rng.Chance(0.5)
                               ? static_cast<uint32_t>(rng.Below(scene.geometry.triangles.size()))
                               : kNoTriangle;
        box.Extend(at);
        base = std::max(base, points.base[k]);
        norm_one = std::max(norm_one, NormOne(at));
      }
      const TouchRadius largest = {base, per_vertex};
      const Box3f around = BoxAround(box, largest.Largest(scene));
      if (!candidates->Gather(scene, around, norm_one, TouchCandidates::kMost)) continue;
      std::vector<uint32_t> touched[TouchPoints::kMost];
      candidates->ForEachTouching(around, points,
                                  [&](int k, uint32_t id) { touched[k].push_back(id); });
      std::vector<uint32_t> expected;
      for (int k = 0; k < TouchPoints::kMost; ++k) {
        if ((points.used >> k & 1) == 0) {
          ASSERT_TRUE(touched[k].empty());
          continue;
        }
        std::sort(touched[k].begin(), touched[k].end());
        FindTouching(scene, points.at(k), points.radius(k), points.source[k], &expected);
        ASSERT_EQ(touched[k], expected);
        found += !expected.empty();
        ++asked;
      }
    }
  }
  EXPECT_GT(found, 50);
  EXPECT_GT(asked - found, 50);
}

TEST(TouchCandidatesTest, HoldNothingWhereThereIsTooMuch) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene({MakeIcosphere(2, 10, RandomPlacement(rng, {0, 0, 0}))});
  ASSERT_GT(scene.geometry.triangles.size(), TouchCandidates::kMost);
  const auto candidates = std::make_unique<TouchCandidates>(PlacementKernelsFor(AnyTarget(rng)));
  const Box3f everything = {{-50, -50, -50}, {50, 50, 50}};
  EXPECT_FALSE(candidates->Gather(scene, everything, 60, TouchCandidates::kMost));
  const Vec3d at = ToDouble(scene.geometry.vertices[0]);
  TouchPoints points;
  points.used = 1;
  points.x[0] = at.x;
  points.y[0] = at.y;
  points.z[0] = at.z;
  points.base[0] = 1e-3;
  points.source[0] = kNoTriangle;
  int found = 0;
  const auto count = [&](int, uint32_t) { ++found; };
  candidates->ForEachTouching(everything, points, count);
  EXPECT_EQ(found, 0);
  const Box3f around = BoxAround({at, at}, 1e-3);
  ASSERT_TRUE(candidates->Gather(scene, around, 60, TouchCandidates::kMost));
  candidates->ForEachTouching(around, points, count);
  EXPECT_GE(found, 5);  // The triangles about a vertex.
}

}  // namespace
}  // namespace sightline
