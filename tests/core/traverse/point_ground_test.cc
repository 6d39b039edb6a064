// SPDX-License-Identifier: Apache-2.0
//
// What points' grounds are said to block is blocked, by the definition: for segments and rays that
// graze what the points lie on, for every instruction set of this machine. And points on a surface
// have grounds that tell below from above.
#include "core/traverse/point_ground.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr size_t kWords = PointGrounds::kMaxPoints / 16;

bool IsSet(const uint16_t* bits, int i) { return (bits[i / 16] >> (i % 16) & 1) != 0; }

// Just above or below a place on some triangle, at times next to its edges; or anywhere.
Vec3f NearSurface(const SceneGeometry& geometry, NastyRays& rays, TestRng& rng) {
  if (geometry.triangles.empty() || rng.Chance(0.1)) return rays.Point();
  const auto [a, b, c] =
      geometry.Corners(static_cast<uint32_t>(rng.Below(geometry.triangles.size())));
  double v = rng.Uniform(0, 1), w = rng.Uniform(0, 1 - v);
  if (rng.Chance(0.2)) v = std::ldexp(v, -20);
  if (rng.Chance(0.2)) w = 1 - v - std::ldexp(1, -static_cast<int>(rng.Below(24)));
  const Vec3d ad = ToDouble(a), ab = ToDouble(b) - ad, ac = ToDouble(c) - ad;
  const Vec3d normal = Cross(ab, ac);
  const double size = Length(normal);
  Vec3d p = ad + ab * v + ac * w;
  if (size > 0) {
    const double height = std::ldexp(std::sqrt(size), -static_cast<int>(rng.Below(26)));
    p = p + normal * (rng.Uniform(-1, 1) * height / size);
  }
  return ToFloat(p);
}

// A direction that leads down from some point at about the slope of its ground, or at any other.
Vec3d Grazing(const PointGrounds& grounds, TestRng& rng) {
  const int i = static_cast<int>(rng.Below(static_cast<uint64_t>(grounds.count)));
  const Vec3d up = ToDouble(grounds.normal(i));
  Vec3d along;
  do {
    for (int k = 0; k < 3; ++k) along[k] = rng.Uniform(-1, 1);
    along = along - up * Dot(along, up);
  } while (!(Length(along) > 0.01));
  const double slope = std::min(1.0, double{grounds.slope[i]});
  const double times = rng.Chance(0.5) ? rng.Uniform(0.9, 1.2) : std::ldexp(1, rng.Below(20));
  return along * (1 / Length(along)) - up * (slope * times);
}

class PointGroundTest : public KernelsFixture {
 protected:
  // Asks about segments to, and rays along, what some points lead to. Returns how many are blocked.
  size_t Check(const IndexedGeometry& scene, const PointGrounds& grounds,
               const std::vector<uint32_t>& sources, NastyRays& rays, TestRng& rng) {
    size_t blocked = 0;
    for (int ask = 0; ask < 24; ++ask) {
      const bool parallel = rng.Chance(0.5);
      const int some = static_cast<int>(rng.Below(static_cast<uint64_t>(grounds.count)));
      const double scale = std::ldexp(1, static_cast<int>(rng.Below(30)) - 20);
      const Vec3d lead = Grazing(grounds, rng) * scale;
      Vec3f common = ToFloat(parallel ? lead : ToDouble(grounds.point(some)) + lead);
      if (rng.Chance(0.2)) common = parallel ? rays.Target({0, 0, 0}, false) : rays.Point();
      uint16_t bits[kWords];
      alignas(64) float rises[kWords];
      const size_t count = (parallel ? kernels().parallel_ground_bits : kernels().ground_bits)(
          grounds, common, bits, rises);
      size_t set = 0;
      for (int i = 0; i < PointGrounds::kMaxPoints; ++i) {
        if (!IsSet(bits, i)) continue;
        ++set;
        EXPECT_LT(i, grounds.count);
        const Vec3f p = grounds.point(i);
        const TraceRay query = {
            .ray = parallel ? PredicateRay::Ray(p, common) : PredicateRay::Segment(common, p),
            .to_source = sources.empty() ? kNoTriangle : sources[static_cast<size_t>(i)]};
        EXPECT_NE(TraceByDefinition(scene.geometry, query).triangle, kNoTriangle)
            << Printed{query} << ", slope " << grounds.slope[i] << ", height " << grounds.height[i];
      }
      EXPECT_EQ(set, count);
      blocked += set;
    }
    return blocked;
  }
};
SIGHTLINE_FOR_EACH_TARGET(PointGroundTest);

TEST_P(PointGroundTest, WhatTheyBlockIsBlocked) {
  TestRng rng;
  size_t found = 0, blocked = 0;
  for (int64_t round = 0, n = ScaledCount(3, 3); round < n; ++round) {
    for (const NastyScene& scene : MakeNastyScenes(rng)) {
      SCOPED_TRACE(scene.name);
      if (!scene.indexed.geometry.uniform) continue;
      const SceneGeometry& geometry = scene.indexed.geometry;
      NastyRays rays(scene.indexed, rng);
      const auto grounds = std::make_unique<PointGrounds>();
      grounds->count = 1 + static_cast<int>(rng.Below(PointGrounds::kMaxPoints));
      std::vector<uint32_t> sources;
      const bool with_sources = rng.Chance(0.3);
      for (int i = 0; i < grounds->count; ++i) {
        const Vec3f p = NearSurface(geometry, rays, rng);
        grounds->x[i] = p.x;
        grounds->y[i] = p.y;
        grounds->z[i] = p.z;
        if (with_sources) {
          sources.push_back(geometry.triangles.empty() || rng.Chance(0.5)
                                ? kNoTriangle
                                : static_cast<uint32_t>(rng.Below(geometry.triangles.size())));
        }
      }
      WalkStats stats;
      found += kernels().find_grounds(scene.indexed, with_sources ? sources.data() : nullptr,
                                      grounds.get(), nullptr, &stats);
      blocked += Check(scene.indexed, *grounds, sources, rays, rng);
      if (HasFailure()) return;
    }
  }
  EXPECT_GT(found, 100u);
  EXPECT_GT(blocked, 1000u);
}

// Nothing is left to chance of a plain: points above it see down from their slope on.
TEST_P(PointGroundTest, PointsOnASurfaceTellBelowFromAbove) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeGrid(12, 0, {-6, 0, -6}, rng)}, std::nullopt);
  const auto grounds = std::make_unique<PointGrounds>();
  for (const double height : {1e-7, 1e-5, 1e-3}) {
    grounds->count = 250;
    for (int i = 0; i < grounds->count; ++i) {
      grounds->x[i] = static_cast<float>(0.02 + 0.41 * (i % 16) / 16);
      grounds->y[i] = static_cast<float>(height);
      grounds->z[i] = static_cast<float>(0.05 + 0.41 * (i / 16) / 16);
    }
    WalkStats stats;
    EXPECT_EQ(kernels().find_grounds(scene, nullptr, grounds.get(), nullptr, &stats), 250u);
    for (int i = 0; i < grounds->count; ++i) {
      EXPECT_EQ(grounds->normal(i), (Vec3f{0, 1, 0}));
      EXPECT_LT(grounds->slope[i], 200 * height + 2 * kGroundSlack);
    }
    uint16_t bits[kWords];
    alignas(64) float rises[kWords];
    for (int ask = 0; ask < 50; ++ask) {
      const Vec3f along = {static_cast<float>(rng.Uniform(-1, 1)), -0.5f,
                           static_cast<float>(rng.Uniform(-1, 1))};
      EXPECT_EQ(kernels().parallel_ground_bits(*grounds, along, bits, rises), 250u);
      EXPECT_EQ(kernels().parallel_ground_bits(*grounds, along * -1.0f, bits, rises), 0u);
      EXPECT_EQ(kernels().ground_bits(*grounds, along * 3.0f, bits, rises), 250u);
      EXPECT_EQ(kernels().ground_bits(*grounds, along * -3.0f, bits, rises), 0u);
      // Within the plain, and between it and the points.
      EXPECT_EQ(kernels().ground_bits(*grounds, {along.x, 0, along.z}, bits, rises), 0u);
      const auto between = static_cast<float>(height / 2);
      EXPECT_EQ(kernels().ground_bits(*grounds, {along.x, between, along.z}, bits, rises), 0u);
    }
  }
}

// A point's own triangle blocks nothing of it.
TEST_P(PointGroundTest, SourcesAreNoGrounds) {
  ObjectInput object;
  object.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 0, 1}};
  object.indices = {0, 1, 2};
  const IndexedGeometry scene = IndexObjects({object}, std::nullopt);
  const auto grounds = std::make_unique<PointGrounds>();
  grounds->count = 2;
  for (int i = 0; i < 2; ++i) {
    grounds->x[i] = grounds->z[i] = 0.25f;
    grounds->y[i] = 0x1p-24f;
  }
  const uint32_t sources[2] = {0, kNoTriangle};
  WalkStats stats;
  EXPECT_EQ(kernels().find_grounds(scene, sources, grounds.get(), nullptr, &stats), 1u);
  uint16_t bits[kWords];
  alignas(64) float rises[kWords];
  EXPECT_EQ(kernels().parallel_ground_bits(*grounds, {0, -1, 0}, bits, rises), 1u);
  EXPECT_EQ(bits[0], 2u);
}

// Points that have a whole scene between them do not walk all of it.
TEST_P(PointGroundTest, PointsFarApartEndTheSearch) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeGrid(200, 0.5, {0, 0, 0}, rng)}, std::nullopt, 4);
  ASSERT_GT(scene.bvh.leaf_count, 20'000u);
  const auto grounds = std::make_unique<PointGrounds>();
  grounds->count = PointGrounds::kMaxPoints;
  for (int i = 0; i < grounds->count; ++i) {
    grounds->x[i] = static_cast<float>(rng.Uniform(0, 200));
    grounds->y[i] = static_cast<float>(rng.Uniform(-0.5, 0.5));
    grounds->z[i] = static_cast<float>(rng.Uniform(0, 200));
  }
  WalkStats stats;
  kernels().find_grounds(scene, nullptr, grounds.get(), nullptr, &stats);
  EXPECT_GT(stats.leaves, 0u);
  EXPECT_LT(stats.leaves, 1000u);
  EXPECT_LT(stats.nodes, 1000u);
  EXPECT_LT(stats.triangle_tests, 300'000u);
}

}  // namespace
}  // namespace sightline::testing_support
