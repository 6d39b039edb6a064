// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/point_sets.h"

#include <algorithm>
#include <tuple>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "gtest/gtest.h"
#include "tests/bench/test_scene.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

struct Hall : TestScene {
  Hall() : TestScene("builtin:hall:30000") {}
  // The first view's.
  Camera View(uint32_t width, uint32_t height) const {
    const BuiltinView& view = source.views[0];
    const auto camera = LookAt(view.eye, view.at, view.up, view.fov_y_degrees, width, height);
    SIGHTLINE_CHECK(camera.ok()) << camera.status();
    return *camera;
  }
};

bool Same(Vec3f a, Vec3f b) { return a.x == b.x && a.y == b.y && a.z == b.z; }

void ExpectRangesCover(const PointSet& set) {
  size_t end = 0;
  for (const PointSet::Range& range : set.ranges) {
    EXPECT_EQ(range.begin, end);
    EXPECT_GT(range.count, 0u);
    end += range.count;
    EXPECT_EQ(set.Positions(range).size(), range.count);
    EXPECT_EQ(set.Slice(range).sources.size(), set.sources.empty() ? 0 : range.count);
  }
  EXPECT_EQ(end, set.size());
}

TEST(ViewHitsTest, EveryHitOnceTileByTileInSquares) {
  Hall hall;
  // Neither side a multiple of the tiles', the blocks' or the squares'.
  const Camera camera = hall.View(101, 75);
  const auto set = ViewHits(hall.scene, camera, /*with_sources=*/true, hall.pool);
  ASSERT_TRUE(set.ok()) << set.status();
  ExpectRangesCover(*set);
  std::vector<PointSet::Range> ranges;
  size_t r = 0;
  for (const TileRect& tile : CutImage(101, 75)) {
    TileResult result;
    ASSERT_TRUE(TraceTile(hall.scene, camera, tile, {}, {.points = true}, {}, &result).ok());
    const size_t hits = result.points.size();
    if (hits == 0) continue;
    ASSERT_LT(r, set->ranges.size());
    const PointSet::Range range = set->ranges[r++];
    ASSERT_EQ(range.count, hits);
    // Where each stands, by its pixel: squares of 16, of 4 and of 2 in turn.
    std::vector<std::pair<uint64_t, size_t>> order;
    for (size_t i = 0; i < hits; ++i) {
      const uint32_t x = result.point_pixel[i] % tile.width, y = result.point_pixel[i] / tile.width;
      uint64_t key = 0;
      for (const uint32_t side : {16u, 4u, 2u, 1u}) {
        const uint32_t across = side == 16 ? 64 : side == 4 ? 4 : 2;
        key = key * 4096 + y / side % across * across + x / side % across;
      }
      order.emplace_back(key, i);
    }
    std::sort(order.begin(), order.end());
    for (size_t i = 0; i < hits; ++i) {
      const size_t from = order[i].second;
      ASSERT_TRUE(Same(set->positions[range.begin + i], result.points.positions[from])) << i;
      ASSERT_EQ(set->sources[range.begin + i], result.points.sources[from]) << i;
    }
  }
  EXPECT_EQ(r, set->ranges.size());
}

TEST(ViewHitsTest, SourcesAreLeftOutUnlessAskedFor) {
  Hall hall;
  const auto set = ViewHits(hall.scene, hall.View(64, 48), /*with_sources=*/false, hall.pool);
  ASSERT_TRUE(set.ok()) << set.status();
  ASSERT_GT(set->size(), 0u);
  EXPECT_TRUE(set->sources.empty());
}

TEST(SurfacePointsTest, InMeshOrderOnTheirTrianglesInRanges) {
  Hall hall;
  const auto set =
      SurfacePoints(hall.scene, {.count = 10'001, .range = 1000, .with_sources = true}, hall.pool);
  ASSERT_TRUE(set.ok()) << set.status();
  ASSERT_EQ(set->size(), 10'001u);
  ASSERT_EQ(set->ranges.size(), 11u);
  EXPECT_EQ(set->ranges.back().count, 1u);
  ExpectRangesCover(*set);
  // Sources are found by nearness, so where triangles meet one may be its neighbour's; but nearly
  // all ascend with the points.
  size_t back = 0, without = 0;
  for (size_t i = 0; i < set->size(); ++i) {
    without += set->sources[i] == kNoTriangle;
    if (i > 0) back += set->sources[i] < set->sources[i - 1];
  }
  EXPECT_EQ(without, 0u);
  EXPECT_LT(back, set->size() / 20);
  // Half of the area has half of the points, whichever object it belongs to.
  const SceneGeometry& geometry = hall.scene.geometry;
  double whole = 0, lower = 0;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    const auto [a, b, c] = geometry.Corners(id);
    const double area = Length(Cross(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a)));
    whole += area;
    if (id < geometry.triangles.size() / 2) lower += area;
  }
  const auto of_lower = std::count_if(set->sources.begin(), set->sources.end(), [&](uint32_t id) {
    return id < geometry.triangles.size() / 2;
  });
  EXPECT_NEAR(static_cast<double>(of_lower) / 10'001, lower / whole, 0.01);
}

TEST(SurfacePointsTest, ShuffledAreTheSamePoints) {
  Hall hall;
  const SurfaceOptions in_order{.count = 3000, .range = 3000};
  SurfaceOptions shuffled = in_order;
  shuffled.shuffled = true;
  auto one = SurfacePoints(hall.scene, in_order, hall.pool);
  auto other = SurfacePoints(hall.scene, shuffled, hall.pool);
  auto again = SurfacePoints(hall.scene, shuffled, hall.pool);
  ASSERT_TRUE(one.ok() && other.ok() && again.ok());
  size_t moved = 0;
  for (size_t i = 0; i < 3000; ++i) {
    moved += !Same(one->positions[i], other->positions[i]);
    EXPECT_TRUE(Same(other->positions[i], again->positions[i]));  // One fixed order.
  }
  EXPECT_GT(moved, 2900u);
  EXPECT_TRUE(other->sources.empty());
  const auto less = [](Vec3f a, Vec3f b) {
    return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z);
  };
  std::sort(one->positions.begin(), one->positions.end(), less);
  std::sort(other->positions.begin(), other->positions.end(), less);
  for (size_t i = 0; i < 3000; ++i) EXPECT_TRUE(Same(one->positions[i], other->positions[i])) << i;
}

TEST(LightsTest, TheSkyStandsAboveAndBoxLightsWithin) {
  const auto sky = SkyLights({0, 1, 0});
  ASSERT_TRUE(sky.ok()) << sky.status();
  EXPECT_EQ(sky->size(), 145u);
  Hall hall;
  const std::vector<Light> lights = BoxLights(hall.scene.geometry, 64);
  ASSERT_EQ(lights.size(), 64u);
  const SceneGeometry& geometry = hall.scene.geometry;
  for (const Light& light : lights) {
    for (int axis = 0; axis < 3; ++axis) {
      const double at = light.position[axis] - geometry.origin[axis];
      EXPECT_GE(at, geometry.bounds.lo[axis]);
      EXPECT_LE(at, geometry.bounds.hi[axis]);
    }
  }
}

}  // namespace
}  // namespace sightline::bench
