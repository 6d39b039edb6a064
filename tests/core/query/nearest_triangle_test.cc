// SPDX-License-Identifier: Apache-2.0
#include "core/query/nearest_triangle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "core/accel/leaf_triangles.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

// Triangles of all sizes and shapes, slivers, duplicates and shared corners among them.
ObjectInput Soup(TestRng& rng, int count) {
  ObjectInput mesh{.name = "soup"};
  for (int i = 0; i < count; ++i) {
    const double size = std::exp2(-rng.Uniform(0, 12));
    const Vec3d centre = RandomInBox(rng, {1, 1, 1});
    for (int k = 0; k < 3; ++k) {
      if (!mesh.vertices.empty() && rng.Chance(0.3)) {
        mesh.indices.push_back(rng.Below(mesh.vertices.size()));
      } else {
        mesh.indices.push_back(mesh.vertices.size());
        mesh.vertices.push_back(centre + RandomDirection(rng) * size);
      }
    }
  }
  return mesh;
}

NearestTriangle NearestByLookingAtAll(const SceneGeometry& geometry, Vec3d p, double limit) {
  NearestTriangle best{kNoTriangle, limit};
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) continue;
    const auto [a, b, c] = geometry.Corners(id);
    const double d = DistanceSquared(p, ClosestPointOnTriangle(p, a, b, c));
    if (d < best.distance_squared || (d == best.distance_squared && id < best.triangle))
      best = {id, d};
  }
  return best;
}

std::vector<uint32_t> TouchingByLookingAtAll(const SceneGeometry& geometry, Vec3d p,
                                             TouchRadius radius, uint32_t skip) {
  std::vector<uint32_t> touching;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (id == skip || std::binary_search(geometry.inert.begin(), geometry.inert.end(), id))
      continue;
    const auto [a, b, c] = geometry.Corners(id);
    const double r = radius.Of(a, b, c);
    if (DistanceSquared(p, ClosestPointOnTriangle(p, a, b, c)) <= r * r) touching.push_back(id);
  }
  return touching;
}

TEST(NearestTriangleTest, ClosestPointIsInTheTriangleAndNoneIsCloser) {
  TestRng rng;
  for (int64_t i = ScaledCount(20'000); i-- > 0;) {
    std::array<Vec3f, 3> t;
    const double size = std::exp2(-rng.Uniform(0, 8));
    for (Vec3f& corner : t) corner = ToFloat(Vec3d{3, -2, 1} + RandomDirection(rng) * size);
    const Vec3d n = Cross(ToDouble(t[1]) - ToDouble(t[0]), ToDouble(t[2]) - ToDouble(t[0]));
    if (Length(n) < 0x1p-10 * size * size) continue;
    const Vec3d p = Vec3d{3, -2, 1} + RandomInBox(rng, {2, 2, 2}) * (2 * size);
    const Vec3d q = ClosestPointOnTriangle(p, t[0], t[1], t[2]);
    const double distance = std::sqrt(DistanceSquared(p, q));
    // A few hundred roundings at these coordinates, made worse by the aspect ratio.
    const double tolerance = 0x1p-53 * 256 * 0x1p10;
    EXPECT_LE(std::abs(Dot(n, q - ToDouble(t[0]))) / Length(n), tolerance);
    for (int k = 0; k < 20; ++k) {
      const Vec3d other = PointNearRim(rng, t);
      EXPECT_LE(distance, std::sqrt(DistanceSquared(p, other)) + tolerance);
    }
  }
}

// What spares Touches the measuring never decides otherwise: on slivers, far from the origin and at
// distances about the radius, too.
TEST(NearestTriangleTest, TouchingIsWhatTheClosestPointSays) {
  TestRng rng;
  int64_t touching = 0, apart = 0;
  for (int64_t i = ScaledCount(400'000); i-- > 0;) {
    const Vec3d centre = RandomDirection(rng) * std::exp2(rng.Uniform(-3, 20));
    const double size = std::exp2(rng.Uniform(-12, 4));
    std::array<Vec3f, 3> t;
    for (Vec3f& corner : t) corner = ToFloat(centre + RandomDirection(rng) * size);
    if (rng.Chance(0.3)) {  // Nearly or wholly without width.
      const Vec3d a = ToDouble(t[0]), b = ToDouble(t[1]);
      t[2] = ToFloat(a + (b - a) * rng.Uniform(-0.5, 1.5) +
                     RandomDirection(rng) * (size * std::exp2(-rng.Uniform(8, 60))));
    }
    const Vec3d a = ToDouble(t[0]), b = ToDouble(t[1]), c = ToDouble(t[2]);
    const TouchRadius radius = {0x1p-22 * NormOne(centre) * rng.Uniform(0, 1),
                                rng.Chance(0.5) ? 0x1p-44 : 0x1p-24};
    const double r = radius.Of(t[0], t[1], t[2]);
    const double u = rng.Uniform(-0.2, 1.2), v = rng.Uniform(-0.2, 1.2);
    const Vec3d n = Cross(b - a, c - a);
    const Vec3d up = Length(n) > 0 ? n * (1 / Length(n)) : RandomDirection(rng);
    const double height = r * (rng.Chance(0.5) ? rng.Uniform(-4, 4) : 1 + rng.Uniform(-0.01, 0.01));
    const Vec3d p = a + (b - a) * u + (c - a) * v + up * height;
    const bool expected = DistanceSquared(p, ClosestPointOnTriangle(p, t[0], t[1], t[2])) <= r * r;
    ASSERT_EQ(Touches(p, radius, t[0], t[1], t[2]), expected)
        << "of point (" << p.x << ", " << p.y << ", " << p.z << "), " << i << " to go";
    ++(expected ? touching : apart);
  }
  EXPECT_GT(touching, 0);
  EXPECT_GT(apart, 0);
}

TEST(NearestTriangleTest, ClosestPointIsExactAtCornersAndAlikeOnSharedEdges) {
  TestRng rng;
  for (int64_t i = ScaledCount(5'000); i-- > 0;) {
    Vec3f v[4];
    for (Vec3f& corner : v) corner = ToFloat(RandomInBox(rng, {1, 1, 1}));
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(ClosestPointOnTriangle(ToDouble(v[k]), v[0], v[1], v[2]), ToDouble(v[k]));
    }
    // Where both triangles say "on the edge", they name the same point.
    const Vec3d p = RandomInBox(rng, {2, 2, 2});
    const Vec3d q = ClosestPointOnTriangle(p, v[0], v[1], v[2]);
    const Vec3d r = ClosestPointOnTriangle(p, v[2], v[1], v[3]);
    if (DistanceSquared(q, r) < 0x1p-80) {
      EXPECT_EQ(q, r);
    }
  }
}

// What is walked: the BVH, and kd-trees that stand alone.
enum class Walked { kBvh, kKdTree, kPerfectKdTree, kKdTreeWithLeavesLaidOut };

IndexedGeometry Over(IndexedGeometry scene, Walked walked, TestRng& rng) {
  if (walked == Walked::kBvh) return scene;
  scene = OnKdTreeAlone(std::move(scene), {.traversal_cost = rng.Chance(0.5) ? 0.1f : 3.0f,
                                           .perfect_splits = walked == Walked::kPerfectKdTree});
  if (walked == Walked::kKdTreeWithLeavesLaidOut) {
    scene.kd_leaves =
        MakeLeafTriangles(scene.geometry, {scene.kd_tree->ids.data(), scene.kd_tree->ids.size()});
  }
  return scene;
}

class WalkedTest : public ::testing::TestWithParam<Walked> {};

std::string WalkedName(const ::testing::TestParamInfo<Walked>& info) {
  constexpr const char* kNames[] = {"Bvh", "KdTree", "PerfectKdTree", "KdTreeWithLeavesLaidOut"};
  return kNames[static_cast<int>(info.param)];
}

INSTANTIATE_TEST_SUITE_P(All, WalkedTest,
                         ::testing::Values(Walked::kBvh, Walked::kKdTree, Walked::kPerfectKdTree,
                                           Walked::kKdTreeWithLeavesLaidOut),
                         WalkedName);

TEST_P(WalkedTest, AgreesWithLookingAtAll) {
  for (uint64_t seed = 0; seed < 6; ++seed) {
    TestRng rng(seed);
    BvhBuildOptions options;
    options.max_leaf_triangles = 1 + static_cast<int>(rng.Below(16));
    const IndexedGeometry scene = Over(
        MakeScene({Soup(rng, 1 + 60 * static_cast<int>(seed))}, Vec3d{}, options), GetParam(), rng);
    for (int64_t i = ScaledCount(1000); i-- > 0;) {
      Vec3d p = RandomInBox(rng, {1.5, 1.5, 1.5});
      // Corners themselves: many triangles at distance zero.
      if (rng.Chance(0.3))
        p = ToDouble(scene.geometry.vertices[rng.Below(scene.geometry.vertices.size())]);
      const double limit = rng.Chance(0.5) ? 100 : std::exp2(-rng.Uniform(0, 10));
      const NearestTriangle expected = NearestByLookingAtAll(scene.geometry, p, limit);
      const NearestTriangle found = FindNearest(scene, p, limit);
      ASSERT_EQ(found.triangle, expected.triangle);
      ASSERT_EQ(found.distance_squared, expected.distance_squared);

      const TouchRadius radius = {limit * 0.1, limit * 0.01};
      std::vector<uint32_t> touching;
      const uint32_t skip = found.triangle;
      FindTouching(scene, p, radius, skip, &touching);
      ASSERT_EQ(touching, TouchingByLookingAtAll(scene.geometry, p, radius, skip));
      ASSERT_EQ(TouchesAny(scene, p, radius, skip), !touching.empty());
    }
  }
}

// A soup of triangles of which some have one, two or all corners far out: each is touched within
// the radius that its own corners have it, and points are asked about that lie just within it and
// just beyond.
TEST_P(WalkedTest, TouchingAgreesWhereSomeReachFarOut) {
  int64_t touching = 0, apart = 0;
  for (uint64_t seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(seed);
    TestRng rng(seed);
    ObjectInput mesh = Soup(rng, 100);
    for (Vec3d& v : mesh.vertices) {
      if (rng.Chance(0.1)) v = v + RandomDirection(rng) * std::exp2(rng.Uniform(0, 39));
    }
    const IndexedGeometry scene = Over(MakeScene({mesh}), GetParam(), rng);
    const SceneGeometry& geometry = scene.geometry;
    for (int64_t i = ScaledCount(1000); i-- > 0;) {
      const auto [a, b, c] =
          geometry.Corners(static_cast<uint32_t>(rng.Below(geometry.triangles.size())));
      const TouchRadius radius = {rng.Chance(0.5) ? 0 : std::exp2(-rng.Uniform(0, 30)), 0x1p-24};
      const double u = rng.Uniform(0, 1), v = rng.Uniform(0, 1 - u);
      const Vec3d on = ToDouble(a) * (1 - u - v) + ToDouble(b) * u + ToDouble(c) * v;
      // Off a face of the triangle's box, or any way.
      Vec3d way = RandomDirection(rng);
      if (rng.Chance(0.5)) way = Vec3d{}, way[static_cast<int>(rng.Below(3))] = 1;
      const double r = radius.Of(a, b, c);
      const Vec3d p =
          on + way * (r * (rng.Chance(0.5) ? 1 + rng.Uniform(-0.01, 0.01) : rng.Uniform(-2, 2)));
      std::vector<uint32_t> found;
      FindTouching(scene, p, radius, kNoTriangle, &found);
      const std::vector<uint32_t> expected =
          TouchingByLookingAtAll(geometry, p, radius, kNoTriangle);
      ASSERT_EQ(found, expected) << i << " to go";
      ASSERT_EQ(TouchesAny(scene, p, radius, kNoTriangle), !expected.empty());
      ++(expected.empty() ? apart : touching);
    }
  }
  EXPECT_GT(touching, 0);
  EXPECT_GT(apart, 0);
}

// One stray triangle far out, whose touch radius is longer than the whole mesh: it sends no other
// triangle to be measured. The poll has fired, and would stop at 4096 triangles.
TEST_P(WalkedTest, AStrayTriangleSendsNoOthersToBeMeasured) {
  ObjectInput mesh = MakeTerrain(100, 100, {});
  const auto first = static_cast<uint32_t>(mesh.vertices.size());
  for (const Vec3d v : {Vec3d{0x1p39, 0, 0}, Vec3d{0x1p39, 0x1p30, 0}, Vec3d{0x1p39, 0, 0x1p30}}) {
    mesh.vertices.push_back(v);
  }
  mesh.indices.insert(mesh.indices.end(), {first, first + 1, first + 2});
  TestRng rng;
  const IndexedGeometry scene = Over(MakeScene({mesh}), GetParam(), rng);
  ASSERT_GT(scene.geometry.triangles.size(), 20'000u);
  CancelToken cancel;
  cancel.Cancel();
  // Without perfect splits a kd-tree's cells do not tell how far out their triangles reach, and all
  // are looked through for each point, eight for the work of one.
  const bool blind =
      GetParam() == Walked::kKdTree || GetParam() == Walked::kKdTreeWithLeavesLaidOut;
  const int points = blind ? 1 : 100;
  PointPoll poll(&cancel);
  for (int i = 0; i < points; ++i) {
    const Vec3d p = {0.5 + i * 0.9, 11.3 + i * 0.7, 30};
    EXPECT_FALSE(TouchesAny(scene, p, {0x1p-24 * NormOne(p), 0x1p-24}, kNoTriangle, &poll));
  }
  EXPECT_FALSE(poll.stopped());
}

TEST_P(WalkedTest, CrossingAgreesWithThePredicate) {
  TestRng rng;
  const IndexedGeometry scene = Over(MakeScene({Soup(rng, 300)}), GetParam(), rng);
  int crossings = 0;
  for (int64_t i = ScaledCount(3000); i-- > 0;) {
    const Vec3d p = RandomInBox(rng, {1, 1, 1});
    const Vec3f from = ToFloat(p),
                to = ToFloat(p + RandomDirection(rng) * std::exp2(-rng.Uniform(0, 6)));
    const std::vector<uint32_t> skip = {1, 7, 100, 299};
    bool expected = false;
    for (uint32_t id = 0; id < scene.geometry.triangles.size(); ++id) {
      if (std::binary_search(skip.begin(), skip.end(), id)) continue;
      const auto [a, b, c] = scene.geometry.Corners(id);
      expected |= Blocks(PredicateRay::Segment(from, to), a, b, c);
    }
    ASSERT_EQ(CrossesAny(scene, from, to, skip), expected);
    crossings += expected;
  }
  EXPECT_GT(crossings, 10);
}

TEST(NearestTriangleTest, NothingIsNearInAnEmptyScene) {
  const IndexedGeometry scene = MakeScene({});
  EXPECT_EQ(FindNearest(scene, {1, 2, 3}, 1e9).triangle, kNoTriangle);
  EXPECT_FALSE(TouchesAny(scene, {1, 2, 3}, {1e9, 1}, kNoTriangle));
  EXPECT_FALSE(CrossesAny(scene, {0, 0, 0}, {1, 1, 1}, {}));
}

// The limit itself is included.
TEST(NearestTriangleTest, DistanceLimitIsInclusive) {
  const IndexedGeometry scene =
      MakeScene({{.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}}});
  EXPECT_EQ(FindNearest(scene, {0.25, 0.25, 2}, 4).triangle, 0u);
  EXPECT_EQ(FindNearest(scene, {0.25, 0.25, 2}, std::nextafter(4.0, 0.0)).triangle, kNoTriangle);
}

}  // namespace
}  // namespace sightline
