// SPDX-License-Identifier: Apache-2.0
//
// No point of a box that is said to be lit is blocked, by brute force, for every instruction set of
// this machine: in small adversarial scenes, with lights and boxes on and beside what is there, and
// in rooms, where most boxes that are lit are found.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/cover_question.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

class LitBoxesTest : public KernelsFixture {
 protected:
  struct Counts {
    size_t asked = 0;  // Boxes.
    size_t said = 0;   // To be lit.
    size_t lit = 0;    // Of which no point that was tried is blocked.
  };

  // Whether one of the points, each the end of a segment from `light`, is blocked.
  bool AnyBlocked(const IndexedGeometry& scene, Vec3f light, uint32_t light_source, uint32_t mask,
                  std::span<const Vec3f> points) {
    std::vector<TraceRay> rays;
    for (const Vec3f p : points) {
      rays.push_back(
          {.ray = PredicateRay::Segment(light, p), .mask = mask, .from_source = light_source});
    }
    std::vector<Hit> hits(rays.size());
    WalkStats stats;
    EXPECT_TRUE(kernels().occluded_brute(scene, rays, hits, nullptr, &stats));
    return std::any_of(hits.begin(), hits.end(),
                       [](const Hit& hit) { return hit.triangle != kNoTriangle; });
  }

  // Of each box its corners, and points within.
  std::vector<Vec3f> PointsOf(const Box3f& box, TestRng& rng) {
    std::vector<Vec3f> points;
    for (int i = 0; i < 24; ++i) {
      Vec3f p;
      for (int k = 0; k < 3; ++k) {
        const double share = i < 8 ? i >> k & 1 : rng.Chance(0.2) ? 0 : rng.Uniform(0, 1);
        p[k] = std::clamp(
            static_cast<float>(box.lo[k] + (double{box.hi[k]} - double{box.lo[k]}) * share),
            box.lo[k], box.hi[k]);
      }
      points.push_back(p);
    }
    return points;
  }

  void Ask(const IndexedGeometry& scene, Vec3f light, uint32_t light_source, uint32_t mask,
           std::span<const Box3f> boxes, TestRng& rng, Counts* counts) {
    WalkStats stats;
    const uint32_t said = kernels().lit_boxes(scene, light, light_source, mask, boxes, &stats);
    EXPECT_EQ(said >> boxes.size(), 0u);
    for (size_t b = 0; b < boxes.size(); ++b) {
      ++counts->asked;
      const bool blocked = AnyBlocked(scene, light, light_source, mask, PointsOf(boxes[b], rng));
      const bool is_said = (said >> b & 1) != 0;
      counts->said += is_said ? 1 : 0;
      counts->lit += blocked ? 0 : 1;
      if (is_said) {
        EXPECT_FALSE(blocked) << "light " << light.x << " " << light.y << " " << light.z << ", box "
                              << b << " of " << boxes.size();
      }
    }
  }
};

SIGHTLINE_FOR_EACH_TARGET(LitBoxesTest);

TEST_P(LitBoxesTest, NothingIsBlockedOfWhatIsSaidToBeLit) {
  TestRng rng;
  Counts counts;
  for (int64_t round = 0, n = ScaledCount(40, 2); round < n && !HasFailure(); ++round) {
    for (const NastyScene& scene : MakeNastyScenes(rng)) {
      SCOPED_TRACE(scene.name);
      NastyRays rays(scene.indexed, rng);
      for (int i = 0; i < 12 && !HasFailure(); ++i) {
        const Vec3f light = rays.Point();
        const size_t triangles = scene.indexed.geometry.triangles.size();
        const uint32_t source = triangles > 0 && rng.Chance(0.3)
                                    ? static_cast<uint32_t>(rng.Below(triangles))
                                    : kNoTriangle;
        std::vector<Box3f> boxes(1 + rng.Below(16));
        const Vec3f beside = rays.Point();
        for (Box3f& box : boxes) {
          // Points, flat boxes along the axes, and boxes with a volume; near each other or not.
          const Vec3f at = rng.Chance(0.7) ? beside : rays.Point();
          box.Extend(at);
          const double size = rng.Chance(0.3) ? 0 : std::exp2(rng.Uniform(-12, 0));
          const double scale = std::max(
              {std::abs(double{at.x}), std::abs(double{at.y}), std::abs(double{at.z}), 0x1p-100});
          Vec3f other = at;
          for (int k = 0; k < 3; ++k) {
            if (rng.Chance(0.6)) {
              other[k] = static_cast<float>(at[k] + rng.Uniform(-1, 1) * size * scale);
            }
          }
          box.Extend(other);
        }
        const uint32_t mask = rng.Chance(0.7) ? 0xFFFFFFFFu : 1u << rng.Below(4);
        Ask(scene.indexed, light, source, mask, boxes, rng, &counts);
      }
    }
  }
  EXPECT_GT(counts.said, counts.asked / 50);
  EXPECT_LT(counts.lit, counts.asked);
}

// Boxes on the floor of a room, on walls and in between, a lamp below the ceiling, and a table
// whose shadow some are in: those without are found, though all lie on what bounds them.
TEST_P(LitBoxesTest, MostOfWhatIsLitInARoomIsFound) {
  TestRng rng;
  Counts counts;
  const IndexedGeometry scene = IndexObjects(
      {MakeClosedBox(6, {0, 0, 0}, {8, 6, 3}), MakeClosedBox(2, {3, 2, 0.8}, {4.5, 3.5, 0.9})},
      Vec3d{});
  for (int i = 0; i < 400 && !HasFailure(); ++i) {
    const Vec3f light = {static_cast<float>(rng.Uniform(1, 7)),
                         static_cast<float>(rng.Uniform(1, 5)), 2.75f};
    std::array<Box3f, 16> boxes;
    const int wall = static_cast<int>(rng.Below(3));  // The floor, or an upright one.
    for (size_t b = 0; b < boxes.size(); ++b) {
      const size_t column = b % 4, row = b / 4;
      const auto u = static_cast<float>(0.25 * static_cast<double>(column) + rng.Uniform(0.5, 4));
      const auto v = static_cast<float>(0.25 * static_cast<double>(row) + rng.Uniform(0.5, 1.5));
      Vec3f lo = {u, v, 0}, hi = {u + 0.25f, v + 0.25f, 0};
      if (wall > 0) {
        lo = wall == 1 ? Vec3f{0, v, u / 2} : Vec3f{u, 6, v};
        hi = wall == 1 ? Vec3f{0, v + 0.25f, u / 2 + 0.2f} : Vec3f{u + 0.25f, 6, v + 0.2f};
      }
      boxes[b].Extend(lo);
      boxes[b].Extend(hi);
    }
    Ask(scene, light, kNoTriangle, 0xFFFFFFFFu, boxes, rng, &counts);
  }
  EXPECT_LT(counts.lit, counts.asked);
  EXPECT_GT(counts.said, counts.lit * 3 / 4);
}

// A sheet before all boxes hides each; behind the light it hides none, and nothing does where there
// is nothing.
TEST_P(LitBoxesTest, AllOrNone) {
  TestRng rng;
  const IndexedGeometry empty = IndexObjects({}, Vec3d{});
  const IndexedGeometry sheet = IndexObjects({MakeGrid(16, 0, {-8, 1, -8}, rng)}, Vec3d{});
  // Over the first eight alone, seen from x = 0.
  const IndexedGeometry half = IndexObjects({MakeGrid(4, 0, {-3.75, 1, -2}, rng)}, Vec3d{});
  std::array<Box3f, 16> boxes;
  for (size_t b = 0; b < boxes.size(); ++b) {
    const float x = 0.1f * static_cast<float>(b);
    boxes[b].Extend(Vec3f{x, 0, 0});
    boxes[b].Extend(Vec3f{x + 0.1f, 0, 0.4f});
  }
  const auto lit = [&](const IndexedGeometry& scene, float height, size_t count) {
    WalkStats stats;
    return kernels().lit_boxes(scene, {0, height, 0}, kNoTriangle, 0xFFFFFFFFu,
                               std::span(boxes).first(count), &stats);
  };
  EXPECT_EQ(lit(sheet, 9, 16), 0u);
  EXPECT_EQ(lit(half, 1.5f, 16), 0xFF00u);
  EXPECT_EQ(lit(sheet, 0.5f, 16), 0xFFFFu);
  EXPECT_EQ(lit(empty, 9, 16), 0xFFFFu);
  EXPECT_EQ(lit(empty, 9, 3), 7u);
}

}  // namespace
}  // namespace sightline::testing_support
