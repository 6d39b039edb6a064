// SPDX-License-Identifier: Apache-2.0
//
// What must not change an answer: an exact move of everything, the size of the triangles that are
// seen. Asked in world coordinates, through everything that prepares points, segments and lights.
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/query/points.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AddKdTree;
using testing_support::AllWays;
using testing_support::Bit;
using testing_support::IndexObjects;
using testing_support::SameBytes;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::Way;

// A problem in world coordinates, all multiples of 2^-8 within ±64.
struct Problem {
  std::vector<ObjectInput> objects;
  std::optional<Vec3d> origin;
  std::vector<Vec3d> points;
  std::vector<std::array<Vec3d, 2>> segments;
  std::vector<Light> lights;
  Vec3d eye, at;

  Problem Moved(Vec3d by) const {
    Problem moved = *this;
    for (ObjectInput& object : moved.objects) {
      for (Vec3d& v : object.vertices) v = v + by;
    }
    if (moved.origin) moved.origin = *moved.origin + by;
    for (Vec3d& p : moved.points) p = p + by;
    for (auto& ends : moved.segments) ends = {ends[0] + by, ends[1] + by};
    for (Light& light : moved.lights) light.position = light.position + by;
    moved.eye = eye + by;
    moved.at = at + by;
    return moved;
  }
};

struct Answer {
  TileResult tile;
  ShadowResult shadows;
  SegmentResult segments;
  PreparedPoints points;
};

Answer Solve(const Problem& problem, const Way& way) {
  Answer answer;
  IndexedGeometry scene = IndexObjects(problem.objects, problem.origin);
  AddKdTree({}, &scene);
  const QueryOptions options = way.Options();
  std::vector<LightSample> samples;
  for (uint32_t i = 0; i < problem.lights.size(); ++i) {
    EXPECT_TRUE(AppendSamples(problem.lights[i], i, scene.geometry.origin, &samples).ok());
  }
  const absl::StatusOr<Camera> camera = LookAt(problem.eye, problem.at, {0, 0, 1}, 70, 40, 30);
  EXPECT_TRUE(camera.ok()) << camera.status();
  if (!camera.ok()) return answer;
  EXPECT_TRUE(
      TraceTile(scene, *camera, {0, 0, 40, 30}, samples,
                {.hits = true, .ids = true, .depth = true, .uv = true, .lit = true, .points = true},
                options, &answer.tile)
          .ok());
  absl::StatusOr<PreparedPoints> points =
      PreparePoints(scene, {.positions = problem.points}, {.attach_distance = 0x1p-10});
  EXPECT_TRUE(points.ok()) << points.status();
  if (!points.ok()) return answer;
  answer.points = *std::move(points);
  EXPECT_TRUE(ComputeShadows(scene, PointRange::All(answer.points), samples, {}, {},
                             {.bits = true, .blockers = true}, options, &answer.shadows)
                  .ok());
  PreparedSegments segments;
  EXPECT_TRUE(PrepareSegments(scene, problem.segments, {}, {}, &segments).ok());
  EXPECT_TRUE(
      TestSegments(scene, segments, {.bits = true, .first_hits = true}, options, &answer.segments)
          .ok());
  return answer;
}

void ExpectSame(const Answer& a, const Answer& b) {
  EXPECT_TRUE(SameBytes(a.tile.hit_bits, b.tile.hit_bits));
  EXPECT_TRUE(SameBytes(a.tile.triangle, b.tile.triangle));
  EXPECT_TRUE(SameBytes(a.tile.depth, b.tile.depth));
  EXPECT_TRUE(SameBytes(a.tile.u, b.tile.u));
  EXPECT_TRUE(SameBytes(a.tile.v, b.tile.v));
  EXPECT_TRUE(SameBytes(a.tile.lit_bits, b.tile.lit_bits));
  EXPECT_TRUE(SameBytes(a.tile.points.positions, b.tile.points.positions));
  EXPECT_TRUE(SameBytes(a.points.positions, b.points.positions));
  EXPECT_TRUE(SameBytes(a.points.sources, b.points.sources));
  EXPECT_EQ(a.points.near_surface, b.points.near_surface);
  EXPECT_TRUE(SameBytes(a.shadows.lit_bits, b.shadows.lit_bits));
  EXPECT_TRUE(SameBytes(a.shadows.blocker, b.shadows.blocker));
  EXPECT_TRUE(SameBytes(a.shadows.blocker_t, b.shadows.blocker_t));
  EXPECT_TRUE(SameBytes(a.segments.blocked_bits, b.segments.blocked_bits));
  EXPECT_TRUE(SameBytes(a.segments.triangle, b.segments.triangle));
  EXPECT_TRUE(SameBytes(a.segments.t, b.segments.t));
}

TEST(InvarianceTest, AnExactOffsetChangesNoAnswer) {
  TestRng rng;
  const auto point = [&](double range) {
    Vec3d p;
    for (int k = 0; k < 3; ++k) p[k] = std::round(rng.Uniform(-range, range) * 256) / 256;
    return p;
  };
  for (int64_t round = ScaledCount(6, 3); round > 0; --round) {
    Problem problem;
    ObjectInput object;
    for (uint32_t i = 0; i < 3 * 200; ++i) {
      object.vertices.push_back(i % 3 == 0 ? point(20) : object.vertices[i - i % 3] + point(4));
      object.indices.push_back(i);
    }
    problem.objects = {object};
    if (round % 2 == 0) problem.origin = point(50);  // Else the first vertex: it moves by itself.
    for (int i = 0; i < 300; ++i) {
      // Some are vertices: their triangles are found again.
      problem.points.push_back(i % 3 == 0 ? object.vertices[rng.Below(600)] : point(25));
      problem.segments.push_back(
          {point(30), i % 4 == 0 ? object.vertices[rng.Below(600)] : point(30)});
    }
    problem.lights = {Light::Point(point(40)), Light::Point(object.vertices[7]),
                      Light::Directional({1, 2, 1})};
    problem.eye = point(40);
    problem.at = problem.eye + Vec3d{8, 4, 1};
    for (const Way& way : AllWays(/*kd_tree=*/true)) {
      if (way.strategy == Strategy::kAuto || way.simd != AllWays().back().simd) continue;
      SCOPED_TRACE(way.Name());
      const Answer home = Solve(problem, way);
      EXPECT_GT(home.points.attached, 0u);
      for (const Vec3d by : {Vec3d{1'000'000, 4'400'000, 256}, Vec3d{-0x1p30, 0x1p-8, 0x1p35}}) {
        ExpectSame(home, Solve(problem.Moved(by), way));
      }
      if (testing::Test::HasFailure()) return;
    }
  }
}

// An eye a man's height above one triangle of 20 km, or two that meet right below it.
TEST(InvarianceTest, AHugeGroundIsSeenAndLitToTheHorizon) {
  for (const bool two : {false, true}) {
    SCOPED_TRACE(two ? "two triangles" : "one triangle");
    ObjectInput ground;
    if (two) {
      ground.vertices = {
          {-10'000, -10'000, 0}, {10'000, -10'000, 0}, {10'000, 10'000, 0}, {-10'000, 10'000, 0}};
      ground.indices = {0, 1, 2, 0, 2, 3};
    } else {
      ground.vertices = {{-10'000, -8'000, 0}, {10'000, -8'000, 0}, {0, 12'000, 0}};
      ground.indices = {0, 1, 2};
    }
    IndexedGeometry scene = IndexObjects({ground}, std::nullopt);
    AddKdTree({}, &scene);
    std::vector<LightSample> samples;
    ASSERT_TRUE(AppendSamples(Light::Point({3, 4, 2}), 0, scene.geometry.origin, &samples).ok());
    ASSERT_TRUE(
        AppendSamples(Light::Directional({1, 1, 0.01}), 1, scene.geometry.origin, &samples).ok());
    const Vec3d eye{3, 3, 1.75};
    const uint32_t width = 64, height = 48;
    const absl::StatusOr<Camera> camera = LookAt(eye, {50, 70, 1.5}, {0, 0, 1}, 60, width, height);
    ASSERT_TRUE(camera.ok());
    const double stored_height = ToFloat(eye - scene.geometry.origin).z;
    for (const Way& way : AllWays(/*kd_tree=*/true)) {
      SCOPED_TRACE(way.Name());
      TileResult tile;
      ASSERT_TRUE(TraceTile(scene, *camera, {0, 0, width, height}, samples,
                            {.hits = true, .depth = true, .lit = true, .points = true},
                            way.Options(), &tile)
                      .ok());
      size_t seen = 0;
      const size_t row = (size_t{width} * height + 7) / 8;
      for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x) {
          const size_t pixel = y * width + x;
          const Vec3f d = PixelDirection(*camera, x, y);
          const double t = -stored_height / d.z;  // z = 0 is stored exactly.
          const Vec3d at = eye + ToDouble(d) * t;
          const bool hit = Bit(tile.hit_bits, pixel);
          if (d.z >= 0) {
            ASSERT_FALSE(hit) << "above the horizon";
          } else if (Length(at) < 4'000) {  // Well within both grounds.
            ASSERT_TRUE(hit) << "pixel " << x << ", " << y;
          }
          if (!hit) continue;
          ++seen;
          ASSERT_NEAR(tile.depth[pixel], t, std::abs(t) * 0x1p-22) << "pixel " << x << ", " << y;
          ASSERT_TRUE(tile.lit_bits[pixel / 8] >> (pixel % 8) & 1) << "self-shadow of a lamp";
          ASSERT_TRUE(tile.lit_bits[row + pixel / 8] >> (pixel % 8) & 1) << "self-shadow of a sun";
        }
      }
      EXPECT_GT(seen, size_t{width} * height / 4);
      ASSERT_EQ(tile.points.size(), seen);
      for (const Vec3f& p : tile.points.positions) {
        ASSERT_GT(p.z, 0) << "on the eye's side";
        ASSERT_LT(p.z, 0.01) << "not far from the ground";
      }
    }
  }
}

}  // namespace
}  // namespace sightline
