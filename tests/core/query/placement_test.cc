// SPDX-License-Identifier: Apache-2.0
//
// Camera hits: placed on the eye's side, not blocked by the neighbours of their source. Attached
// points are looked at in points_test.cc.
#include "core/query/placement.h"

#include <algorithm>
#include <cmath>

#include "core/query/hit_placement.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

struct PlacedHit {
  uint32_t triangle = kNoTriangle;
  Vec3f position;
};

// What a camera at `eye` sees toward `at`.
PlacedHit See(const IndexedGeometry& scene, Vec3f eye, Vec3d at) {
  const Vec3f direction = ToFloat(at - ToDouble(eye));
  const Hit hit = FirstHit(scene.geometry, PredicateRay::Ray(eye, direction));
  if (hit.triangle == kNoTriangle) return {};
  return {hit.triangle, PlaceHit(scene, eye, direction, hit.t, hit.triangle)};
}

uint32_t AnyTriangle(TestRng& rng, const IndexedGeometry& scene) {
  return static_cast<uint32_t>(rng.Below(scene.geometry.triangles.size()));
}

// The header's promise, to the last bit: on an exactly convex mesh, a hit is lit by every light
// strictly in front of its source's plane.
TEST(PlacementTest, HitsOnConvexMeshesAreLit) {
  for (Vec3d centre : kCentres) {
    for (int level = 0; level <= 2; ++level) {
      TestRng rng(level);
      const IndexedGeometry scene =
          MakeScene({MakeIcosphere(level, 100, RandomPlacement(rng, centre))});
      ASSERT_TRUE(IsExactlyConvex(scene.geometry));
      int hits = 0;
      // Enough in a sanitizer build, too, for the number of hits that is asked for below.
      for (int64_t i = ScaledCount(400, 4); i-- > 0;) {
        const Vec3f eye = ToFloat(centre + RandomDirection(rng) * rng.Uniform(110, 1000));
        const uint32_t aim = AnyTriangle(rng, scene);
        if (SideOf(scene.geometry, aim, eye) <= 0) continue;
        const PlacedHit hit = See(scene, eye, PointNearRim(rng, scene.geometry.Corners(aim)));
        if (hit.triangle == kNoTriangle) continue;  // Past the silhouette.
        const int side = SideOf(scene.geometry, hit.triangle, eye);
        ASSERT_EQ(SideOf(scene.geometry, hit.triangle, hit.position), side);
        if (side < 0)
          continue;  // On the silhouette: entry and exit at one float t, and the exit's id is
                     // lower.
        ++hits;
        for (int k = 0; k < 4; ++k) {
          const Vec3f light = ToFloat(centre + RandomDirection(rng) * rng.Uniform(101, 500));
          if (SideOf(scene.geometry, hit.triangle, light) <= 0) continue;
          ASSERT_TRUE(
              IsLit(scene.geometry, PredicateRay::Segment(light, hit.position), hit.triangle))
              << "level " << level << " triangle " << hit.triangle;
        }
      }
      EXPECT_GT(hits, 5);
    }
  }
}

// The four corners of a rotated box's face are not in one plane once rounded. What is in front of
// both triangles of a face sees all of it.
TEST(PlacementTest, HitsOnRotatedBoxesAreLit) {
  ForEachRotatedBox(0.5, [](TestRng& rng, Vec3d centre, Vec3d half, const Affine3d& placement) {
    const IndexedGeometry scene = MakeScene({MakeBox(half, placement)});
    for (int64_t i = ScaledCount(500); i-- > 0;) {
      const Vec3f eye = ToFloat(centre + RandomDirection(rng) * 30.0);
      const uint32_t aim = AnyTriangle(rng, scene);
      if (SideOf(scene.geometry, aim, eye) <= 0) continue;
      const PlacedHit hit = See(scene, eye, PointNearRim(rng, scene.geometry.Corners(aim)));
      if (hit.triangle == kNoTriangle) continue;
      const int side = SideOf(scene.geometry, hit.triangle, eye);
      ASSERT_EQ(SideOf(scene.geometry, hit.triangle, hit.position), side);
      if (side < 0) continue;  // On the silhouette, as above.
      const Vec3f light = ToFloat(centre + RandomDirection(rng) * 20.0);
      if (SideOf(scene.geometry, hit.triangle, light) <= 0) continue;
      if (SideOf(scene.geometry, hit.triangle ^ 1, light) <= 0) continue;
      ASSERT_TRUE(IsLit(scene.geometry, PredicateRay::Segment(light, hit.position), hit.triangle));
    }
  });
}

void ExpectRoomLit(const IndexedGeometry& scene, TestRng& rng, const Affine3d& placement,
                   Vec3d half, int64_t count) {
  int64_t unlit = 0, hits = 0;
  for (int64_t i = 0; i < count; ++i) {
    const Vec3f eye = ToFloat(placement.Apply(RandomInBox(rng, half * 0.9)));
    const uint32_t aim = AnyTriangle(rng, scene);
    const PlacedHit hit = See(scene, eye, PointNearRim(rng, scene.geometry.Corners(aim)));
    // Every ray from inside meets a wall: shared edges are tight. (Patches whose edges do not match
    // may leave slits.)
    if (hit.triangle == kNoTriangle) continue;
    ++hits;
    ASSERT_EQ(SideOf(scene.geometry, hit.triangle, hit.position),
              SideOf(scene.geometry, hit.triangle, eye));
    for (int k = 0; k < 3; ++k) {
      const Vec3f light = ToFloat(placement.Apply(RandomInBox(rng, half * 0.9)));
      if (!IsLit(scene.geometry, PredicateRay::Segment(light, hit.position), hit.triangle)) ++unlit;
    }
  }
  EXPECT_EQ(unlit, 0) << "of " << 3 * hits;
  EXPECT_GT(hits, count / 2);
}

// Concave corners: the wall across the edge must not block, whichever way fronts face.
TEST(PlacementTest, HitsInRoomsAreLit) {
  ForEachRotatedBox(2, [](TestRng& rng, Vec3d, Vec3d half, const Affine3d& placement) {
    ObjectInput box = MakeBox(half, placement);
    if (rng.Chance(0.5)) box = Flipped(box);
    ExpectRoomLit(MakeScene({box}), rng, placement, half, ScaledCount(300));
  });
}

// Walls that share no vertices but the corners of the room, wound at random.
TEST(PlacementTest, HitsInPatchedRoomsAreLit) {
  ForEachRotatedBox(2, [](TestRng& rng, Vec3d, Vec3d half, const Affine3d& placement) {
    ExpectRoomLit(MakeScene({MakePatchedBox(rng, half, placement)}), rng, placement, half,
                  ScaledCount(300));
  });
}

// A box stands on a floor that knows nothing of it, sunk in by some roundings or by more (were it
// not, rounding would leave slits to see through): at the line where they meet neither shadows the
// other's hits.
TEST(PlacementTest, HitsWhereABoxStandsOnAFloorAreLit) {
  for (Vec3d centre : kCentres) {
    for (uint64_t b = 0; b < 12; ++b) {
      TestRng rng(b);
      const Affine3d placement = RandomPlacement(rng, centre);
      const double step = 0x1p-22 * std::max(1.0, MaxAbs(centre));
      const double sunk = b % 2 == 0 ? step * rng.Uniform(1, 4) : 0.1 + step;
      ObjectInput floor{.name = "floor",
                        .vertices = {{-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0}},
                        .indices = {0, 1, 2, 0, 2, 3},
                        .transform = placement};
      ObjectInput box =
          MakeBox({1, 1, 1}, Compose(placement, {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1 - sunk}}));
      const IndexedGeometry scene = MakeScene({floor, box});
      int64_t unlit = 0, hits = 0;
      for (int64_t i = ScaledCount(300); i-- > 0;) {
        // Eye and light on the same side of the box, +x, both above the floor and able to see the
        // line x = 1, z = 0.
        const Vec3f eye =
            ToFloat(placement.Apply({rng.Uniform(3, 9), rng.Uniform(-5, 5), rng.Uniform(2, 9)}));
        const Vec3f light =
            ToFloat(placement.Apply({rng.Uniform(3, 9), rng.Uniform(-5, 5), rng.Uniform(2, 9)}));
        const double near = std::exp2(-rng.Uniform(5, 30));
        const bool on_floor = rng.Chance(0.5);
        const Vec3d local = {on_floor ? 1 + near : 1, rng.Uniform(-0.9, 0.9), on_floor ? 0 : near};
        const PlacedHit hit = See(scene, eye, placement.Apply(local));
        ASSERT_NE(hit.triangle, kNoTriangle);
        ++hits;
        if (!IsLit(scene.geometry, PredicateRay::Segment(light, hit.position), hit.triangle))
          ++unlit;
      }
      EXPECT_EQ(unlit, 0) << "of " << hits << ", sunk by " << sunk;
    }
  }
}

// A hit on a lone triangle moves by no more than the rounding it guards against.
TEST(PlacementTest, HitsMoveByUlps) {
  TestRng rng;
  for (int64_t i = ScaledCount(20'000); i-- > 0;) {
    const double out = std::exp2(rng.Uniform(0, 30));
    const Vec3d centre = RandomDirection(rng) * out;
    const double size = std::exp2(rng.Uniform(-6, 6)) * out * 0.01;
    ObjectInput t{.indices = {0, 1, 2}};
    for (int k = 0; k < 3; ++k) t.vertices.push_back(centre + RandomDirection(rng) * size);
    const IndexedGeometry scene = MakeScene({t});
    if (!scene.geometry.inert.empty()) continue;
    const Vec3f eye = ToFloat(centre + RandomDirection(rng) * (size * rng.Uniform(1, 100)));
    const Vec3d aim = PointNearRim(rng, scene.geometry.Corners(0));
    const PlacedHit hit = See(scene, eye, aim);
    if (hit.triangle == kNoTriangle) continue;
    const auto [a, b, c] = scene.geometry.Corners(0);
    const Vec3d p = ToDouble(hit.position);
    ASSERT_EQ(SideOf(scene.geometry, 0, hit.position), SideOf(scene.geometry, 0, eye));
    const double moved = std::sqrt(DistanceSquared(p, ClosestPointOnTriangle(p, a, b, c)));
    EXPECT_LE(moved, 4 * 0x1p-24 * NormOne(p));
  }
}

// However bad the triangle: needles and slivers at all scales, coordinates that differ by 2^40.
// Always strictly on the eye's side.
TEST(PlacementTest, HitsOnSliversAreOnTheEyesSide) {
  TestRng rng;
  int hits = 0;
  for (int64_t i = ScaledCount(30'000); i-- > 0;) {
    const auto random_float = [&] {
      const double x = std::exp2(rng.Uniform(-60, 40)) * rng.Uniform(-1, 1);
      return static_cast<double>(static_cast<float>(x));
    };
    ObjectInput t{.indices = {0, 1, 2}};
    const Vec3d a = {random_float(), random_float(), random_float()};
    const Vec3d b = {random_float(), random_float(), random_float()};
    Vec3d c = {random_float(), random_float(), random_float()};
    // Often all but on the line through A and B.
    if (rng.Chance(0.7)) c = a + (b - a) * rng.Uniform(0, 1) + c * std::exp2(-rng.Uniform(20, 60));
    t.vertices = {a, b, c};
    const IndexedGeometry scene = MakeScene({t});
    if (!scene.geometry.inert.empty()) continue;
    const Vec3f eye = ToFloat({random_float(), random_float(), random_float()});
    // Through a vertex's own bits, or near the rim: slivers are seldom hit otherwise.
    const Vec3d aim = rng.Chance(0.3) ? ToDouble(scene.geometry.Corners(0)[rng.Below(3)])
                                      : PointNearRim(rng, scene.geometry.Corners(0));
    const Vec3f direction = ToFloat(aim - ToDouble(eye));
    const PredicateRay ray = PredicateRay::Ray(eye, direction);
    const auto [p, q, r] = scene.geometry.Corners(0);
    const int side = SideOf(scene.geometry, 0, eye);
    if (side == 0 || (direction == Vec3f{})) continue;
    // A hit by the predicate, or one that some other test would report.
    const bool blocks = Blocks(ray, p, q, r);
    const float t_hit = blocks ? HitDistance(ray, p, q, r) : 1.0f;
    hits += blocks;
    const Vec3f placed = PlaceHit(scene, eye, direction, t_hit, 0);
    ASSERT_EQ(SideOf(scene.geometry, 0, placed), side);
    // Beside a place on the triangle, however little its normal in doubles is worth.
    const float farthest = std::max({MaxAbs(p), MaxAbs(q), MaxAbs(r)});
    ASSERT_LE(MaxAbs(placed), 1.01f * farthest + 0x1p-140f) << "of " << farthest;
  }
  EXPECT_GT(hits, 100);
}

// A sheet lies a few roundings above the floor: a hit on the floor stays below it, one on the sheet
// above it.
TEST(PlacementTest, HitsDoNotJumpThroughNearbySheets) {
  for (int gap = 1; gap <= 12; ++gap) {
    const double z = 1000, step = std::nextafter(1000.0f, 2000.0f) - 1000.0f;
    const auto sheet = [](double height) {
      return ObjectInput{.vertices = {{-9, -9, height}, {9, -9, height}, {0, 12, height}},
                         .indices = {0, 1, 2}};
    };
    const IndexedGeometry scene = MakeScene({sheet(z), sheet(z + gap * step)});
    for (const float height : {900.0f, 1100.0f}) {
      const Vec3f direction = {0, 0, height < 1000 ? 1.0f : -1.0f};
      const PredicateRay ray = PredicateRay::Ray({0, 0, height}, direction);
      const Hit hit = FirstHit(scene.geometry, ray);
      const Vec3f p = PlaceHit(scene, ray.origin, direction, hit.t, hit.triangle);
      EXPECT_EQ(SideOf(scene.geometry, 0, p), SideOf(scene.geometry, 0, ray.origin));
      EXPECT_EQ(SideOf(scene.geometry, 1, p), SideOf(scene.geometry, 1, ray.origin));
    }
    // Seen from between the sheets (an eye just off the hit's place), where floats leave room for a
    // point.
    if (gap < 4) continue;
    const Vec3f eye = {0, 0, static_cast<float>(z + 2 * step)};
    const Vec3f p = PlaceHit(scene, eye, {0, 0, -1}, static_cast<float>(2 * step), 0);
    EXPECT_EQ(SideOf(scene.geometry, 0, p), 1);
    EXPECT_EQ(SideOf(scene.geometry, 1, p), -1) << gap;
  }
}

TEST(PlacementTest, CoincidentTrianglesDoNotBlockEachOther) {
  TestRng rng;
  for (Vec3d centre : kCentres) {
    const Affine3d placement = RandomPlacement(rng, centre);
    ObjectInput box = MakeBox({1, 2, 3}, placement);
    box.name.clear();
    const IndexedGeometry scene = MakeScene({box, Flipped(box), box});
    for (int64_t i = ScaledCount(500); i-- > 0;) {
      const Vec3f eye = ToFloat(placement.Apply(RandomInBox(rng, {0.9, 1.8, 2.7})));
      const Vec3f light = ToFloat(placement.Apply(RandomInBox(rng, {0.9, 1.8, 2.7})));
      const PlacedHit hit =
          See(scene, eye, PointNearRim(rng, scene.geometry.Corners(AnyTriangle(rng, scene))));
      ASSERT_NE(hit.triangle, kNoTriangle);
      EXPECT_TRUE(IsLit(scene.geometry, PredicateRay::Segment(light, hit.position), hit.triangle));
    }
  }
}

// Which boxes hold a triangle never shows.
TEST(PlacementTest, DoesNotDependOnTheTree) {
  TestRng rng;
  const Affine3d placement = RandomPlacement(rng, kCentres[1]);
  const ObjectInput sphere = MakeIcosphere(2, 10, placement);
  BvhBuildOptions small, narrow;
  small.max_leaf_triangles = 1;
  narrow.bins = 3;
  narrow.longest_axis_only = true;
  const IndexedGeometry scenes[] = {MakeScene({sphere}), MakeScene({sphere}, Vec3d{}, small),
                                    MakeScene({sphere}, Vec3d{}, narrow)};
  for (int64_t i = ScaledCount(300); i-- > 0;) {
    const Vec3f eye = ToFloat(placement.Apply(RandomDirection(rng) * 5.0));
    const Vec3d aim = PointNearRim(rng, scenes[0].geometry.Corners(AnyTriangle(rng, scenes[0])));
    const PlacedHit first = See(scenes[0], eye, aim);
    EXPECT_EQ(See(scenes[1], eye, aim).position, first.position);
    EXPECT_EQ(See(scenes[2], eye, aim).position, first.position);
  }
}

// Whoever asks for a side that is far away is put there, and told that it is no small step.
TEST(PlacementTest, MovedFarIsNotClear) {
  const IndexedGeometry scene = MakeScene(
      {{.vertices = {{6.1232e-17, 0, 0}, {10, 10, 0}, {20, 20, 0}}, .indices = {0, 1, 2}}});
  const Vec3d at = {0.5, 0.5, 3};
  const int side = SideOf(scene.geometry, 0, ToFloat(at));
  PlacementScratch scratch;
  for (const int asked : {side, -side}) {
    const Placed placed = Place(scene,
                                {.at = at,
                                 .source = 0,
                                 .side = asked,
                                 .radius = WorldTouchRadius(NormOne(at)),
                                 .reference = ToFloat(at)},
                                &scratch);
    EXPECT_EQ(SideOf(scene.geometry, 0, placed.position), asked);
    EXPECT_EQ(placed.clear, asked == side);
  }
}

TEST(PlacementTest, OffsetCoversRounding) {
  TestRng rng;
  for (int64_t i = ScaledCount(100'000); i-- > 0;) {
    const Vec3d n = RandomDirection(rng);
    const Vec3d p = RandomDirection(rng) * std::exp2(rng.Uniform(-140, 40));
    const double moved = std::abs(Dot(n, ToDouble(ToFloat(p)) - p));
    ASSERT_LE(moved, 0.5 * PlacementOffset(n, p, 0) * (1 + 0x1p-40));
  }
}

}  // namespace
}  // namespace sightline
