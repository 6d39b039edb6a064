// SPDX-License-Identifier: Apache-2.0
#include "core/query/points.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT
using ::testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();
ObjectInput UnitTriangle() {
  return {.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}};
}

PreparedPoints Prepare(const IndexedGeometry& scene, const std::vector<Vec3d>& positions,
                       const PointOptions& options = {}, const std::vector<Vec3d>& normals = {},
                       const std::vector<uint32_t>& sources = {}) {
  auto points = PreparePoints(scene, {positions, normals, sources}, options);
  EXPECT_TRUE(points.ok()) << points.status();
  return points.ok() ? *std::move(points) : PreparedPoints{};
}

std::vector<Vec3d> World(const SceneGeometry& geometry, std::span<const Vec3f> stored) {
  std::vector<Vec3d> world;
  for (Vec3f v : stored) world.push_back(ToDouble(v) + geometry.origin);
  return world;
}

TEST(PointsTest, RebasesInDoubleAndRoundsOnce) {
  const IndexedGeometry scene = MakeScene({UnitTriangle()}, Vec3d{4194304, 10, -0.5});
  const PreparedPoints p = Prepare(scene, {{4194304.3, 10, -5}});
  EXPECT_EQ(p.positions[0], (Vec3f{static_cast<float>(4194304.3 - 4194304.0), 0, -4.5f}));
  EXPECT_FALSE(std::signbit(p.positions[0].y));
  EXPECT_EQ(p.sources[0], kNoTriangle);
  EXPECT_EQ(p.valid[0], 1);
  EXPECT_EQ(p.invalid + p.attached + p.near_surface, 0u);
}

TEST(PointsTest, InvalidPointsAreZeroAndCounted) {
  const IndexedGeometry scene = MakeScene({UnitTriangle()}, Vec3d{-1, 0, 0});
  const double limit = kMaxCoordinate;
  const PreparedPoints p = Prepare(scene,
                                   {{kNan, 0, 0},
                                    {0, kInf, 0},
                                    {0, 0, -kInf},
                                    {limit, 0, 0},
                                    {0, -limit, 0},
                                    {0, 0, limit * 1.5}},
                                   {.attach_distance = 1});
  EXPECT_EQ(p.valid, (std::vector<uint8_t>{0, 0, 0, 0, 1, 0}));
  EXPECT_EQ(p.invalid, 5u);
  for (size_t i = 0; i < p.size(); ++i) {
    if (!p.valid[i]) {
      EXPECT_EQ(p.positions[i], Vec3f{});
    }
  }
}

TEST(PointsTest, BadInputIsNamed) {
  const IndexedGeometry scene = MakeScene({UnitTriangle()});
  const std::vector<Vec3d> two(2), three(3);
  const std::vector<uint32_t> ids = {kNoTriangle, 1};
  const auto message = [&](const PointInput& input, const PointOptions& options) {
    const auto p = PreparePoints(scene, input, options);
    EXPECT_EQ(p.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(p.status().message());
  };
  EXPECT_THAT(message({two, three, {}}, {}), HasSubstr("normals: 3 entries for 2 points"));
  EXPECT_THAT(message({three, {}, ids}, {}), HasSubstr("source_triangles: 2 entries for 3 points"));
  EXPECT_THAT(message({two, {}, ids}, {}),
              HasSubstr("source_triangles[1] = 1, but the scene has 1"));
  EXPECT_THAT(message({two, {}, {}}, {.attach_distance = -2}), HasSubstr("attach_distance = -2"));
  EXPECT_THAT(message({two, {}, {}}, {.attach_distance = kInf}),
              HasSubstr("attach_distance = inf"));
  EXPECT_THAT(message({two, {}, {}}, {.attach_distance = kNan}),
              HasSubstr("attach_distance = nan"));
  EXPECT_THAT(message({two, {}, {}}, {.offset = 0.5}), HasSubstr("offset = 0.5 needs normals"));
  EXPECT_THAT(message({two, two, {}}, {.offset = kInf}), HasSubstr("offset = inf"));
  EXPECT_TRUE(PreparePoints(scene, {}, {.offset = 1}).ok());
}

TEST(PointsTest, StopsWhenCancelled) {
  const IndexedGeometry scene = MakeScene({UnitTriangle()});
  const std::vector<Vec3d> points(10);
  CancelToken cancel;
  EXPECT_TRUE(PreparePoints(scene, {points, {}, {}}, {}, &cancel).ok());
  cancel.Cancel();
  EXPECT_EQ(PreparePoints(scene, {points, {}, {}}, {}, &cancel).status().code(),
            absl::StatusCode::kCancelled);
  CancelToken late;
  late.set_deadline(CancelToken::Clock::now());
  EXPECT_EQ(PreparePoints(scene, {points, {}, {}}, {}, &late).status().code(),
            absl::StatusCode::kDeadlineExceeded);
}

// However many triangles lie about a point: the deadline passes among some dozens of points.
TEST(PointsTest, StopsAmongTheCopiesAboutOnePoint) {
  ObjectInput copies = UnitTriangle();
  for (int i = 0; i < 20000; ++i) copies.indices.insert(copies.indices.end(), {0, 1, 2});
  const IndexedGeometry scene = MakeScene({copies});
  const std::vector<Vec3d> points(100, Vec3d{0.25, 0.25, 0.125});
  // In all their boxes, and on none of them.
  const std::vector<Vec3d> beside(200, Vec3d{0.75, 0.75, 0});
  for (const auto& [positions, attach] : {std::pair(points, 1.0), std::pair(beside, 0.0)}) {
    CancelToken late;
    late.set_deadline(CancelToken::Clock::now() + std::chrono::microseconds(500));
    EXPECT_EQ(PreparePoints(scene, {positions, {}, {}}, {.attach_distance = attach}, &late)
                  .status()
                  .code(),
              absl::StatusCode::kDeadlineExceeded);
  }
}

TEST(PointsTest, OffsetMovesAlongNormalsOfAnyLength) {
  const IndexedGeometry scene = MakeScene({UnitTriangle()});
  const std::vector<Vec3d> at(7, {1, 2, 3});
  const std::vector<Vec3d> normals = {{0, 0, 2}, {1e-300, 0, 0}, {0, -1e300, 0}, {3, 0, 4},
                                      {0, 0, 0}, {kNan, 0, 1},   {kInf, 0, 0}};
  const PreparedPoints p = Prepare(scene, at, {.offset = 0.5}, normals);
  EXPECT_EQ(p.positions[0], (Vec3f{1, 2, 3.5f}));
  EXPECT_EQ(p.positions[1], (Vec3f{1.5f, 2, 3}));
  EXPECT_EQ(p.positions[2], (Vec3f{1, 1.5f, 3}));
  EXPECT_NEAR(p.positions[3].x, 1.3, 1e-6);
  EXPECT_NEAR(p.positions[3].z, 3.4, 1e-6);
  EXPECT_EQ(p.valid, (std::vector<uint8_t>{1, 1, 1, 1, 0, 0, 0}));
  EXPECT_EQ(p.invalid, 3u);
  EXPECT_EQ(Prepare(scene, {at[0]}, {.offset = -0.5}, {normals[0]}).positions[0],
            (Vec3f{1, 2, 2.5f}));
  // Without an offset nobody looks at a normal's length.
  EXPECT_EQ(Prepare(scene, at, {}, normals).invalid, 0u);
}

TEST(PointsTest, AttachesToTheNearestWithinReach) {
  ObjectInput two = UnitTriangle();
  for (Vec3d v : {Vec3d{0, 0, 1}, Vec3d{1, 0, 1}, Vec3d{0, 1, 1}}) two.vertices.push_back(v);
  two.indices = {0, 1, 2, 3, 4, 5};
  const IndexedGeometry scene = MakeScene({two});
  const std::vector<Vec3d> at = {
      {.2, .2, .25}, {.2, .2, .75}, {.2, .2, .5}, {.2, .2, -.25}, {.2, .2, 3}};
  const PreparedPoints p = Prepare(scene, at, {.attach_distance = 0.5});
  EXPECT_EQ(p.sources,
            (std::vector<uint32_t>{0, 1, 0, 0, kNoTriangle}));  // Lowest id among equals.
  EXPECT_EQ(p.attached, 4u);
  EXPECT_EQ(p.near_surface, 0u);
  // Clear of their sources by far: not moved.
  for (size_t i = 0; i < at.size(); ++i) EXPECT_EQ(p.positions[i], ToFloat(at[i]));
}

// A sliver's normal in doubles may be wrong in every bit, and by how much grows with the sliver's
// length: a point was put 243,290 away for the sake of that, or at infinity, and called valid.
TEST(PointsTest, AttachedToASliverMoveByRoundings) {
  for (const double thin : {0x1p-40, 0x1p-50, 0x1p-67, 0x1p-120}) {
    const IndexedGeometry scene =
        MakeScene({{.vertices = {{0, 1, 0}, {0, 0, -thin}, {thin, 0, 0}}, .indices = {0, 1, 2}}});
    const std::vector<Vec3d> at = {{0, 0.5, 0}, {0.25, 0.5, 0.125}, {0, 0.5, -0x1p-30}};
    const PreparedPoints p = Prepare(scene, at, {.attach_distance = 1});
    for (size_t i = 0; i < at.size(); ++i) {
      EXPECT_EQ(p.sources[i], 0u);
      EXPECT_NE(SideOf(scene.geometry, 0, p.positions[i]), 0);
      EXPECT_LE(Length(ToDouble(p.positions[i]) - at[i]), 1e-5) << thin << ", point " << i;
    }
  }
}

// A triangle that has an area, and whose cross product is zero in doubles: its plane is z = 0. A
// point 3 above it was called in its plane, in front, and moved by 4 through it, and called clear;
// a normal that points to the back, or the front, was not heeded.
TEST(PointsTest, SideOfPointsAttachedToASliverWithoutANormalInDoubles) {
  const Vec3d corners[] = {{6.1232e-17, 0, 0}, {10, 10, 0}, {20, 20, 0}};
  const PointOptions attach = {.attach_distance = 10};
  for (const bool turned : {false, true}) {
    const IndexedGeometry scene =
        MakeScene({{.vertices = {corners[0], corners[1 + turned], corners[2 - turned]},
                    .indices = {0, 1, 2}}});
    ASSERT_TRUE(scene.geometry.inert.empty());
    for (const double z : {3.0, -3.0, 1e-3, -1e-3}) {
      const Vec3d at = {0.5, 0.5, z};
      const PreparedPoints p = Prepare(scene, {at}, attach);
      EXPECT_EQ(p.sources[0], 0u);
      EXPECT_EQ(p.positions[0], ToFloat(at)) << "turned " << turned << ", z = " << z;
      EXPECT_EQ(p.near_surface, 0u);
    }
    for (const double up : {1.0, -1.0, 1e300, -1e-300}) {
      const PreparedPoints p = Prepare(scene, {{0.5, 0.5, 0}}, attach, {{0, 0, up}});
      EXPECT_GT(p.positions[0].z * up, 0) << "turned " << turned << ", up = " << up;
      EXPECT_LT(std::abs(p.positions[0].z), 1e-5);
    }
    // Without one, and with one that says nothing, the front.
    for (const Vec3d normal : {Vec3d{}, Vec3d{kNan, 0, 1}, Vec3d{1, -1, 0}}) {
      const PreparedPoints p = Prepare(scene, {{0.5, 0.5, 0}}, attach, {normal});
      EXPECT_EQ(SideOf(scene.geometry, 0, p.positions[0]), 1);
    }
    EXPECT_EQ(SideOf(scene.geometry, 0, Prepare(scene, {{0.5, 0.5, 0}}, attach).positions[0]), 1);
  }
}

TEST(PointsTest, GivenSourcesStay) {
  const IndexedGeometry scene = MakeScene({UnitTriangle()});
  const std::vector<Vec3d> at = {{.25, .25, 0}, {.25, .25, 0}};
  const PreparedPoints p = Prepare(scene, at, {.attach_distance = 1}, {}, {0, kNoTriangle});
  EXPECT_EQ(p.positions[0], (Vec3f{.25f, .25f, 0}));  // Its caller knows best.
  EXPECT_EQ(SideOf(scene.geometry, 0, p.positions[1]), 1);
  EXPECT_EQ(p.sources, (std::vector<uint32_t>{0, 0}));
  EXPECT_EQ(p.attached, 2u);
  EXPECT_EQ(p.near_surface, 0u);
}

// In the plane within rounding: the front, or the normal's side. Off it: where the point is.
TEST(PointsTest, SideOfAttachedPoints) {
  const IndexedGeometry scene =
      MakeScene({{.vertices = {{1000, 1000, 1000}, {1001, 1000, 1000.3}, {1000, 1001, 1000.7}},
                  .indices = {0, 1, 2}}});
  const auto [a, b, c] = scene.geometry.Corners(0);
  TestRng rng;
  for (int64_t i = ScaledCount(500); i-- > 0;) {
    const Vec3d q = (ToDouble(a) * 2.0 + ToDouble(b) + ToDouble(c)) * 0.25 +
                    RandomInBox(rng, {1, 1, 1}) * 0x1p-16;
    const Vec3d n = Cross(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a));
    const Vec3d on = q - n * (Dot(n, q - ToDouble(a)) / Dot(n, n));
    const PointOptions attach = {.attach_distance = 0.1};
    EXPECT_EQ(SideOf(scene.geometry, 0, Prepare(scene, {on}, attach).positions[0]), 1);
    EXPECT_EQ(SideOf(scene.geometry, 0, Prepare(scene, {on}, attach, {n * 3.0}).positions[0]), 1);
    EXPECT_EQ(SideOf(scene.geometry, 0, Prepare(scene, {on}, attach, {-n}).positions[0]), -1);
    const Vec3d behind = on - n * 0.01;
    EXPECT_EQ(SideOf(scene.geometry, 0, Prepare(scene, {behind}, attach, {n}).positions[0]), -1);
  }
}

TEST(PointsTest, NearSurfaceCountsWhatRoundingCannotTell) {
  const IndexedGeometry scene =
      MakeScene({MakeBox({1, 1, 1}, {{1, 0, 0, 4, 0, 1, 0, 4, 0, 0, 1, 4}})});
  const Vec3d on_face = {3.25, 4.5, 5};
  EXPECT_EQ(Prepare(scene, {on_face}).near_surface, 1u);
  EXPECT_EQ(Prepare(scene, {on_face + Vec3d{0, 0, 0x1p-21}}).near_surface, 1u);
  EXPECT_EQ(Prepare(scene, {on_face + Vec3d{0, 0, 0x1p-18}}).near_surface, 0u);
  EXPECT_EQ(Prepare(scene, {on_face}, {.count_near_surface = false}).near_surface, 0u);
  uint32_t source = 0;
  while (SideOf(scene.geometry, source, {3.25f, 4.5f, 5}) != 0) ++source;
  // Each face has two triangles, met on the diagonal; this point touches one of them only.
  EXPECT_EQ(Prepare(scene, {on_face}, {}, {}, {source}).near_surface +
                Prepare(scene, {on_face}, {}, {}, {source + 1}).near_surface,
            1u);
  EXPECT_EQ(Prepare(scene, {{5, 5, 5}}, {}, {}, {source}).near_surface, 1u);  // A corner.
  EXPECT_EQ(Prepare(scene, {{5, 5, 5}}, {.attach_distance = 0.1}).near_surface, 0u);
  // Inert triangles are no surface.
  const IndexedGeometry inert =
      MakeScene({{.vertices = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}}, .indices = {0, 1, 2}}});
  EXPECT_EQ(Prepare(inert, {{1, 0, 0}}).near_surface, 0u);
}

// In one piece, or in any order piece by piece: what a point becomes is its own affair.
TEST(PointsTest, PlacedInPiecesAsInOne) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene({MakeBox({1, 2, 3}, RandomPlacement(rng, {7, 8, 9})),
                                           MakeIcosphere(2, 2, RandomPlacement(rng, {8, 8, 9}))});
  std::vector<Vec3d> positions = World(scene.geometry, scene.geometry.vertices), normals;
  for (size_t i = positions.size(); i < 1000; ++i) {
    positions.push_back(Vec3d{7, 8, 9} + RandomDirection(rng) * rng.Uniform(0, 4));
  }
  std::vector<uint32_t> sources(positions.size(), kNoTriangle);
  for (size_t i = 0; i < positions.size(); ++i) {
    normals.push_back(RandomDirection(rng));
    if (rng.Chance(0.1)) positions[i].y = kNan;
    if (rng.Chance(0.1)) sources[i] = static_cast<uint32_t>(rng.Below(12));
  }
  for (const PointOptions& options :
       {PointOptions{}, PointOptions{.attach_distance = 0.5},
        PointOptions{.attach_distance = 0.5, .offset = 1e-3},
        PointOptions{.attach_distance = 0.5, .count_near_surface = false},
        PointOptions{.offset = -1e-3, .count_near_surface = false}}) {
    const PreparedPoints whole = Prepare(scene, positions, options, normals, sources);
    const PreparedPoints rebased = *RebasePoints(scene, {positions, normals, sources}, options);
    EXPECT_EQ(rebased.valid, whole.valid);
    EXPECT_EQ(rebased.invalid, whole.invalid);
    EXPECT_GT(whole.invalid, 0u);
    // Attached points are mostly cleared of what they touch.
    if (options.attach_distance == 0) {
      EXPECT_EQ(whole.near_surface > 0, options.count_near_surface);
    }
    std::vector<size_t> order(positions.size());
    std::iota(order.begin(), order.end(), 0);
    std::shuffle(order.begin(), order.end(), rng);
    uint64_t attached = 0, near_surface = 0;
    for (size_t begin = 0; begin < order.size();) {
      const size_t end = std::min(order.size(), begin + 1 + rng.Below(300));
      PreparedPoints piece;
      std::vector<Vec3d> of_piece;
      for (size_t k = begin; k < end; ++k) {
        piece.positions.push_back(rebased.positions[order[k]]);
        piece.sources.push_back(rebased.sources[order[k]]);
        piece.valid.push_back(rebased.valid[order[k]]);
        of_piece.push_back(normals[order[k]]);
      }
      ASSERT_TRUE(PlacePoints(scene, of_piece, options, nullptr, &piece).ok());
      for (size_t k = begin; k < end; ++k) {
        EXPECT_EQ(piece.positions[k - begin], whole.positions[order[k]]);
        EXPECT_EQ(piece.sources[k - begin], whole.sources[order[k]]);
      }
      attached += piece.attached;
      near_surface += piece.near_surface;
      begin = end;
    }
    // Without anything to place nobody counted: the first step has.
    EXPECT_EQ(WantsPlacing(options) ? attached : rebased.attached, whole.attached);
    EXPECT_EQ(near_surface, whole.near_surface);
  }
}

// A point between two sheets nearer than rounding can tell apart cannot be cleared of both, and
// says so.
TEST(PointsTest, NearSurfaceCountsWhatCannotBeCleared) {
  const float z = 1000, next = std::nextafter(z, 2000.0f);
  ObjectInput sheets{
      .vertices =
          {{-9, -9, z}, {9, -9, z}, {0, 12, z}, {-9, -9, next}, {9, -9, next}, {0, 12, next}},
      .indices = {0, 1, 2, 3, 5, 4}};  // Fronts face each other.
  const IndexedGeometry scene = MakeScene({sheets});
  const PreparedPoints p = Prepare(scene, {{0, 0, z}}, {.attach_distance = 1});
  EXPECT_EQ(p.sources[0], 0u);
  EXPECT_EQ(p.near_surface, 1u);
  EXPECT_EQ(SideOf(scene.geometry, 0, p.positions[0]), 1);
}

// The trap: a mesh's own vertices as points. On a convex mesh one is lit by all that is in front of
// any of its triangles, and not from the far side. (Between the two lies what a point a few
// roundings off the surface sees over its horizon.)
TEST(PointsTest, AttachedVerticesOfConvexMeshes) {
  for (Vec3d centre : kCentres) {
    for (int level = 0; level <= 2; ++level) {
      TestRng rng(level);
      const IndexedGeometry scene =
          MakeScene({MakeIcosphere(level, 100, RandomPlacement(rng, centre))});
      ASSERT_TRUE(IsExactlyConvex(scene.geometry));
      const PreparedPoints p =
          Prepare(scene, World(scene.geometry, scene.geometry.vertices), {.attach_distance = 1});
      EXPECT_EQ(p.attached, p.size());
      EXPECT_EQ(p.near_surface, 0u);
      int lit = 0, dark = 0;
      for (uint32_t v = 0; v < p.size(); ++v) {
        for (int k = 0; k < 24; ++k) {
          const Vec3f light = ToFloat(centre + RandomDirection(rng) * rng.Uniform(110, 500));
          bool front = false;
          for (uint32_t id = 0; id < scene.geometry.triangles.size(); ++id) {
            const auto& t = scene.geometry.triangles[id];
            if (t[0] != v && t[1] != v && t[2] != v) continue;
            ASSERT_EQ(SideOf(scene.geometry, id, p.positions[v]), 1);
            front |= SideOf(scene.geometry, id, light) > 0;
          }
          const Vec3d up = ToDouble(p.positions[v]) - centre, to = ToDouble(light) - centre;
          const bool far = Dot(up, to) < -0.7 * Length(up) * Length(to);
          if (!front && !far) continue;
          (front ? lit : dark)++;
          ASSERT_EQ(
              IsLit(scene.geometry, PredicateRay::Segment(light, p.positions[v]), p.sources[v]),
              front);
        }
      }
      EXPECT_GT(lit, 10);
      EXPECT_GT(dark, 10);
    }
  }
}

// Points anywhere on a rotated box, corners and edges favoured, known by world coordinates alone:
// rounding has put them before or behind their faces.
TEST(PointsTest, AttachedPointsOnRotatedBoxes) {
  ForEachRotatedBox(0.5, [](TestRng& rng, Vec3d centre, Vec3d half, const Affine3d& placement) {
    const IndexedGeometry scene = MakeScene({MakeBox(half, placement)});
    std::vector<Vec3d> at;
    for (int64_t i = ScaledCount(300); i-- > 0;) {
      at.push_back(PointNearRim(rng, scene.geometry.Corners(rng.Below(12))));
    }
    const PreparedPoints p = Prepare(scene, at, {.attach_distance = 0.5});
    EXPECT_EQ(p.attached, p.size());
    EXPECT_EQ(p.near_surface, 0u);
    for (size_t i = 0; i < p.size(); ++i) {
      const Vec3f light = ToFloat(centre + RandomDirection(rng) * 20.0);
      const uint32_t source = p.sources[i];
      if (SideOf(scene.geometry, source, light) <= 0 ||
          SideOf(scene.geometry, source ^ 1, light) <= 0)
        continue;
      ASSERT_TRUE(IsLit(scene.geometry, PredicateRay::Segment(light, p.positions[i]), source));
    }
  });
}

void ExpectLitInside(const IndexedGeometry& scene, const PreparedPoints& p, TestRng& rng,
                     const Affine3d& placement, Vec3d half) {
  EXPECT_EQ(p.attached, p.size());
  int unlit = 0;
  for (size_t i = 0; i < p.size(); ++i) {
    for (int k = 0; k < 4; ++k) {
      const Vec3f light = ToFloat(placement.Apply(RandomInBox(rng, half * 0.9)));
      unlit += !IsLit(scene.geometry, PredicateRay::Segment(light, p.positions[i]), p.sources[i]);
    }
  }
  EXPECT_EQ(unlit, 0);
}

// Rooms: fronts inward are enough; fronts outward need normals (or an offset). Corners, edges,
// walls.
TEST(PointsTest, AttachedPointsInRooms) {
  ForEachRotatedBox(2, [](TestRng& rng, Vec3d centre, Vec3d half, const Affine3d& placement) {
    const ObjectInput box = MakeBox(half, placement);
    const IndexedGeometry inward = MakeScene({Flipped(box)}), outward = MakeScene({box});
    std::vector<Vec3d> at = World(inward.geometry, inward.geometry.vertices), normals;
    for (int64_t i = ScaledCount(300); i-- > 0;) {
      at.push_back(PointNearRim(rng, inward.geometry.Corners(rng.Below(12))));
    }
    // Toward the middle: in front of every wall a point may touch.
    for (Vec3d p : at) normals.push_back(centre - p);
    const PointOptions attach = {.attach_distance = 0.5};
    const PreparedPoints inside = Prepare(inward, at, attach);
    EXPECT_EQ(inside.near_surface, 0u);
    ExpectLitInside(inward, inside, rng, placement, half);
    ExpectLitInside(outward, Prepare(outward, at, attach, normals), rng, placement, half);
    // Without: outside, where the lights in the room do not reach.
    const PreparedPoints outside = Prepare(outward, at, attach);
    const Vec3f light = ToFloat(centre);
    for (size_t i = 0; i < outside.size(); ++i) {
      EXPECT_EQ(SideOf(outward.geometry, outside.sources[i], outside.positions[i]), 1);
    }
    // A corner is in front of all walls there, and more than its source is in the way.
    for (size_t i = 0; i < 8; ++i) {
      EXPECT_FALSE(
          IsLit(outward.geometry, PredicateRay::Segment(light, outside.positions[i]), kNoTriangle));
    }
  });
}

// A wavy ground of gentle slopes under steep suns: nothing shadows anything, vertices and edges
// included.
TEST(PointsTest, AttachedPointsOnTerrain) {
  for (Vec3d centre : kCentres) {
    for (double size : {16.0, 4000.0}) {
      TestRng rng;
      const IndexedGeometry scene = MakeScene({MakeTerrain(16, size, centre)});
      std::vector<Vec3d> at = World(scene.geometry, scene.geometry.vertices);
      for (int64_t i = ScaledCount(500); i-- > 0;) {
        at.push_back(
            PointNearRim(rng, scene.geometry.Corners(rng.Below(scene.geometry.triangles.size()))));
      }
      const PreparedPoints p = Prepare(scene, at, {.attach_distance = size * 0.01});
      EXPECT_EQ(p.attached, p.size());
      EXPECT_EQ(p.near_surface, 0u);
      for (size_t i = 0; i < p.size(); ++i) {
        for (int k = 0; k < 4; ++k) {
          Vec3d sun = RandomDirection(rng);
          sun.z = std::abs(sun.z) + 1.5;  // 56 degrees and higher.
          ASSERT_TRUE(
              IsLit(scene.geometry, PredicateRay::Ray(p.positions[i], ToFloat(sun)), p.sources[i]));
        }
      }
    }
  }
}

// Placed once, it is placed: what is read back and sent again stays.
TEST(PointsTest, PlacedPointsStayPut) {
  TestRng rng;
  const IndexedGeometry scene =
      MakeScene({MakeIcosphere(1, 10, RandomPlacement(rng, {300, 200, 100}))});
  std::vector<Vec3d> at = World(scene.geometry, scene.geometry.vertices);
  const PreparedPoints once = Prepare(scene, at, {.attach_distance = 1});
  const PreparedPoints again = Prepare(scene, World(scene.geometry, once.positions),
                                       {.attach_distance = 1}, {}, once.sources);
  EXPECT_EQ(again.positions, once.positions);
  EXPECT_EQ(again.sources, once.sources);
}

// Neither the cut into ranges nor the tree shows.
TEST(PointsTest, DependsOnThePointAlone) {
  TestRng rng;
  const ObjectInput box = MakePatchedBox(rng, {3, 4, 5}, RandomPlacement(rng, kCentres[1]));
  BvhBuildOptions small;
  small.max_leaf_triangles = 2;
  const IndexedGeometry scene = MakeScene({box}), other = MakeScene({box}, Vec3d{}, small);
  std::vector<Vec3d> at;
  at.reserve(300);
  for (int i = 0; i < 300; ++i) {
    at.push_back(
        PointNearRim(rng, scene.geometry.Corners(rng.Below(scene.geometry.triangles.size()))));
  }
  const PointOptions attach = {.attach_distance = 0.5};
  const PreparedPoints whole = Prepare(scene, at, attach), elsewhere = Prepare(other, at, attach);
  EXPECT_EQ(elsewhere.positions, whole.positions);
  EXPECT_EQ(elsewhere.sources, whole.sources);
  EXPECT_EQ(elsewhere.near_surface, whole.near_surface);
  uint64_t near = 0;
  for (size_t i = 0; i < at.size(); ++i) {
    const PreparedPoints one = Prepare(scene, {at[i]}, attach);
    EXPECT_EQ(one.positions[0], whole.positions[i]);
    EXPECT_EQ(one.sources[0], whole.sources[i]);
    near += one.near_surface;
  }
  EXPECT_EQ(near, whole.near_surface);
}

}  // namespace
}  // namespace sightline
