// SPDX-License-Identifier: Apache-2.0
//
// What is seen in mirrors: as the definition of core/query/mirrors.h says, ray by ray; as the scene
// itself looks from the mirrored eye, where both can be written down exactly; and what is refused.
#include "core/query/mirrors.h"

#include <bit>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/accel/kd_builder.h"
#include "core/intersect/hit.h"
#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::MakeBox;
using testing_support::MakeIcosphere;
using testing_support::MakeScene;
using testing_support::MakeTerrain;
using testing_support::RandomPlacement;
using testing_support::TestRng;

constexpr uint32_t kMirroredSide = 45;  // Four does not divide it.
constexpr TileRect kMirroredTile = {0, 0, kMirroredSide, kMirroredSide};
constexpr TileOutputs kOutputs = {
    .hits = true, .ids = true, .depth = true, .uv = true, .points = true, .mirrors = true};

ObjectInput Quad(Vec3d a, Vec3d b, Vec3d c, Vec3d d) {
  return {.vertices = {a, b, c, d}, .indices = {0, 1, 2, 0, 2, 3}};
}

Affine3d At(Vec3d p) { return {.m = {1, 0, 0, p.x, 0, 1, 0, p.y, 0, 0, 1, p.z}}; }

bool Bit(const std::vector<uint8_t>& bits, size_t i) { return (bits[i / 8] >> (i % 8) & 1) != 0; }

// Meshes of one kind have one name.
ObjectInput Named(std::string name, ObjectInput object) {
  object.name = std::move(name);
  return object;
}

// The whole picture.
TileResult Look(const IndexedGeometry& scene, const Camera& camera, std::span<const Mirror> mirrors,
                const QueryOptions& options = {}) {
  TileResult result;
  const absl::Status status = TraceTile(scene, camera, {0, 0, camera.width, camera.height}, {},
                                        mirrors, kOutputs, options, &result);
  EXPECT_TRUE(status.ok()) << status;
  return result;
}

// The definition, by looking at every triangle.
Hit MirroredHit(const SceneGeometry& geometry, const PredicateRay& ray, float near,
                const ObjectRecord& mirror) {
  Hit best;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    if (id >= mirror.first_triangle && id < mirror.first_triangle + mirror.triangle_count) continue;
    const auto [a, b, c] = geometry.Corners(id);
    if (!Blocks(ray, a, b, c)) continue;
    const Hit hit = {HitDistance(ray, a, b, c), id};
    if (hit.t > near && hit < best) best = hit;
  }
  return best;
}

IndexedGeometry WithKdTree(IndexedGeometry scene) {
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(scene.geometry, {}, pool);
  EXPECT_TRUE(tree.ok()) << tree.status();
  scene.kd_tree = *std::move(tree);
  return scene;
}

std::vector<QueryOptions> AllOptions() {
  std::vector<QueryOptions> all;
  for (const SimdTarget simd : {SimdTarget::kAvx2, SimdTarget::kAvx512}) {
    if (!SimdTargetAvailable(simd)) continue;
    for (const Strategy strategy : {Strategy::kAuto, Strategy::kSingle, Strategy::kPacket,
                                    Strategy::kShaft, Strategy::kBruteForce}) {
      all.push_back({.strategy = strategy, .simd = simd});
    }
    for (const Strategy strategy : {Strategy::kAuto, Strategy::kSingle, Strategy::kPacket}) {
      all.push_back({.strategy = strategy, .structure = Structure::kKdTree, .simd = simd});
    }
    for (const int n : {1, 2, 3, 5, 6}) {
      all.push_back({.strategy = Strategy::kRtt,
                     .rtt_antialiasing = n,
                     .rtt_shared_edges = n != 2,
                     .simd = simd});
    }
  }
  return all;
}

// Balls, boxes and hills, half of them through the mirrors, which are flat objects at any angle.
TEST(MirrorsTest, EveryStrategySeesWhatTheDefinitionSays) {
  size_t behind = 0;  // Pixels that what stands behind mirrors would have changed.
  for (uint64_t seed = 0; seed < 4; ++seed) {
    SCOPED_TRACE(seed);
    TestRng rng(seed);
    std::vector<ObjectInput> objects = {MakeTerrain(8, 20, {-10, -10, -6})};
    for (int i = 0; i < 4; ++i) {
      const Vec3d at = {rng.Uniform(-5, 5), rng.Uniform(-5, 5), rng.Uniform(-4, 4)};
      const Affine3d placement = RandomPlacement(rng, at);
      objects.push_back(
          Named(std::to_string(i), i % 2 == 0 ? MakeIcosphere(2, rng.Uniform(0.5, 2), placement)
                                              : MakeBox({1, 0.7, 0.4}, placement)));
    }
    objects.push_back(Quad({-6, -6, -8}, {7, -6, -8}, {7, 6, -8.5}, {-6, 6, -8.5}));
    objects.push_back(Quad({4, -6, -6}, {8, 6, -6}, {8, 6, 6}, {4, -6, 6}));
    // Halfway from that wall to where it mirrors the eye.
    objects.push_back(Named("behind", MakeIcosphere(2, 2, At({10.8, -3.6, 2.5}))));
    const IndexedGeometry scene = WithKdTree(MakeScene(objects));
    // The second plane is not its object's at all: any plane is a mirror's.
    const std::vector<Mirror> mirrors = {
        {.object = 6},
        {.object = 5, .plane = MirrorPlane{{0.3, 0.1, -7}, {0.2, -0.1, 1.3}}},
        {.object = 1, .plane = MirrorPlane{{0, 0, 0}, {1, rng.Uniform(-1, 1), 0}}}};
    absl::StatusOr<Camera> camera =
        LookAt({rng.Uniform(-8, -4), rng.Uniform(-3, 3), rng.Uniform(1, 9)}, {2, 0, -5}, {0, 0, 1},
               70, kMirroredSide, kMirroredSide);
    ASSERT_TRUE(camera.ok()) << camera.status();
    const Vec3f eye = ToFloat(camera->eye);
    const absl::StatusOr<PreparedMirrors> prepared =
        PreparedMirrors::Prepare(scene.geometry, mirrors, eye);
    ASSERT_TRUE(prepared.ok()) << prepared.status();
    const TileResult direct = Look(scene, *camera, {}, {.strategy = Strategy::kBruteForce});
    const TileResult truth = Look(scene, *camera, mirrors, {.strategy = Strategy::kBruteForce});
    size_t seen = 0, hit_there = 0;
    for (uint32_t i = 0; i < kMirroredSide * kMirroredSide; ++i) {
      const Vec3f direction = PixelDirection(*camera, i % kMirroredSide, i / kMirroredSide);
      size_t m = 0;
      while (m < mirrors.size() && !prepared->all()[m].triangles().Holds(direct.triangle[i])) ++m;
      ASSERT_EQ(Bit(truth.mirror_bits, i), m < mirrors.size()) << i;
      Hit expected = {direct.depth[i], direct.triangle[i]};
      if (m < mirrors.size()) {
        const PreparedMirror& mirror = prepared->all()[m];
        const PredicateRay ray = PredicateRay::Ray(mirror.eye(), mirror.Direction(direction));
        const ObjectRecord& object = scene.geometry.objects[mirrors[m].object];
        expected = MirroredHit(scene.geometry, ray, direct.depth[i], object);
        ++seen;
        hit_there += expected.triangle != kNoTriangle;
        behind += MirroredHit(scene.geometry, ray, 0, object).triangle != expected.triangle;
      }
      ASSERT_EQ(truth.triangle[i], expected.triangle) << "pixel " << i;
      ASSERT_EQ(std::bit_cast<uint32_t>(truth.depth[i]), std::bit_cast<uint32_t>(expected.t)) << i;
    }
    EXPECT_GT(seen, 100u);
    EXPECT_GT(hit_there, 50u);
    for (const QueryOptions& options : AllOptions()) {
      SCOPED_TRACE(std::string(StrategyName(options.strategy)) + " on " +
                   std::string(SimdTargetName(options.simd)) + ", antialiasing " +
                   std::to_string(options.rtt_antialiasing));
      const TileResult result = Look(scene, *camera, mirrors, options);
      ASSERT_EQ(result.triangle, truth.triangle);
      ASSERT_EQ(result.hit_bits, truth.hit_bits);
      ASSERT_EQ(result.mirror_bits, truth.mirror_bits);
      ASSERT_EQ(result.point_pixel, truth.point_pixel);
      ASSERT_EQ(result.points.sources, truth.points.sources);
      for (uint32_t i = 0; i < kMirroredSide * kMirroredSide; ++i) {
        const auto bits = [](float x) { return std::bit_cast<uint32_t>(x); };
        ASSERT_EQ(bits(result.depth[i]), bits(truth.depth[i])) << i;
        ASSERT_EQ(bits(result.u[i]), bits(truth.u[i])) << i;
        ASSERT_EQ(bits(result.v[i]), bits(truth.v[i])) << i;
      }
      ASSERT_TRUE(result.points.positions == truth.points.positions);
      ASSERT_EQ(result.points.attached, truth.points.size());
      ASSERT_EQ(result.points.near_surface, truth.points.near_surface);
    }
  }
  EXPECT_GT(behind, 0u);
}

// At x = 0 eye and directions are mirrored without rounding: the mirror shows what a camera behind
// it sees, the mirror gone and what stands behind it, too.
TEST(MirrorsTest, AMirrorShowsWhatItsMirroredEyeSees) {
  const ObjectInput mirror = Quad({0, -40, -40}, {0, 40, -40}, {0, 40, 40}, {0, -40, 40});
  const ObjectInput ball = MakeIcosphere(3, 2, At({4, 3.5, 0}));
  const ObjectInput box = MakeBox({1, 1, 1}, At({5, -3, 1}));
  const ObjectInput behind = Named("behind", MakeIcosphere(3, 2, At({-6, 1, 0})));
  const Camera camera = {.eye = {9, 0.25, 0.5},
                         .right = {0, 1, 0},
                         .up = {0, 0, 1},
                         .forward = {-1, 0, 0},
                         .tan_half_fov_y = 0.75,
                         .width = kMirroredSide,
                         .height = kMirroredSide};
  Camera mirrored = camera;
  mirrored.eye.x = -9;
  mirrored.forward = {1, 0, 0};
  const Mirror mirrors[] = {{.object = 0}};
  const TileResult in_mirror = Look(MakeScene({mirror, ball, box, behind}), camera, mirrors);
  // The same triangle ids: the mirror is out of sight, as is what stood behind it.
  const ObjectInput away = Quad({900, -1, -1}, {900, 1, -1}, {900, 1, 1}, {900, -1, 1});
  const TileResult from_behind = Look(MakeScene({away, ball, box}), mirrored, {});
  size_t seen = 0, mirrors_seen = 0;
  for (uint32_t i = 0; i < kMirroredSide * kMirroredSide; ++i) {
    if (!Bit(in_mirror.mirror_bits, i)) continue;  // Something stands before the mirror.
    ++mirrors_seen;
    const bool is_away = from_behind.triangle[i] < 2;
    ASSERT_EQ(in_mirror.triangle[i], is_away ? kNoTriangle : from_behind.triangle[i]) << i;
    if (is_away || in_mirror.triangle[i] == kNoTriangle) continue;
    ASSERT_EQ(in_mirror.depth[i], from_behind.depth[i]) << i;
    ++seen;
  }
  EXPECT_GT(mirrors_seen, kMirroredSide * kMirroredSide / 2);
  EXPECT_GT(seen, 50u);
}

// A mirror that takes part of a tile is looked into by a tile, which fares as from the mirrored
// eye: there all that is seen is one wall.
TEST(MirrorsTest, TilesAtAMirrorsEdgeStayTiles) {
  const ObjectInput mirror = {.vertices = {{0, -5, -5}, {0, 6, -3}, {0, -1, 7}},
                              .indices = {0, 1, 2}};
  const ObjectInput wall = {.vertices = {{20, -900, -900}, {20, 900, -900}, {20, 0, 900}},
                            .indices = {0, 1, 2}};
  const IndexedGeometry scene = WithKdTree(MakeScene({mirror, wall}));
  const Mirror mirrors[] = {{.object = 0}};
  for (const uint32_t side : {kMirroredSide, 64u}) {
    const Camera camera = {.eye = {9, 0.25, 0.5},
                           .right = {0, 1, 0},
                           .up = {0, 0, 1},
                           .forward = {-1, 0, 0},
                           .tan_half_fov_y = 0.75,
                           .width = side,
                           .height = side};
    const TileResult truth = Look(scene, camera, mirrors, {.strategy = Strategy::kBruteForce});
    for (const SimdTarget simd : {SimdTarget::kAvx2, SimdTarget::kAvx512}) {
      if (!SimdTargetAvailable(simd)) continue;
      for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
        SCOPED_TRACE(absl::StrCat(side, ", antialiasing ", n, ", ", SimdTargetName(simd)));
        QueryOptions options{.strategy = Strategy::kRtt, .rtt_antialiasing = n, .simd = simd};
        options.count_answers = true;
        const TileResult direct = Look(scene, camera, {}, options),
                         seen = Look(scene, camera, mirrors, options);
        EXPECT_EQ(seen.triangle, truth.triangle);
        EXPECT_EQ(seen.depth, truth.depth);
        EXPECT_EQ(seen.u, truth.u);
        EXPECT_EQ(seen.v, truth.v);
        EXPECT_EQ(seen.mirror_bits, truth.mirror_bits);
        const uint32_t tile = RttTileSide(n), row = (side + tile - 1) / tile;
        std::vector<uint64_t> mirrored(size_t{row} * row);  // Pixels, by tile.
        uint64_t pixels = 0, tiles = 0, cut = 0;
        for (uint32_t i = 0; i < side * side; ++i) {
          if (!Bit(seen.mirror_bits, i)) continue;
          ++mirrored[i / side / tile * row + i % side / tile];
          ++pixels;
        }
        for (const uint64_t of_tile : mirrored) {
          tiles += of_tile > 0;
          cut += of_tile > 0 && of_tile < uint64_t{tile} * tile;
        }
        EXPECT_GT(cut, 1u);
        EXPECT_EQ(seen.primary.tiles - direct.primary.tiles, tiles);
        EXPECT_EQ(seen.primary.tiles_answered - direct.primary.tiles_answered, tiles);
        // Pixels' rays alone count as such.
        EXPECT_EQ(seen.primary.rays, side * side + pixels);
        uint64_t answers = 0;
        for (const uint64_t by : seen.primary.answered_by) answers += by;
        EXPECT_EQ(answers, seen.primary.rays);
      }
    }
  }
}

// What a light reaches is asked at the place that the mirror shows.
TEST(MirrorsTest, LightsFallOnWhatIsSeen) {
  // The ceiling is seen in the floor's mirror; a lamp between them is shaded from half of it.
  const ObjectInput floor = Quad({-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0});
  const ObjectInput ceiling = Quad({-20, -20, 8}, {20, -20, 8}, {20, 20, 8}, {-20, 20, 8});
  const ObjectInput shade = Quad({0, -20, 5}, {20, -20, 5}, {20, 20, 5}, {0, 20, 5});
  const IndexedGeometry scene = MakeScene({floor, ceiling, shade});
  const Camera camera = testing_support::LookingDown({-6, 0, 6}, 0.5, kMirroredSide);
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({-0.001, 0, 4}), 0, {}, &samples).ok());
  TileResult result;
  const Mirror mirrors[] = {{.object = 0}};
  const absl::Status status = TraceTile(scene, camera, kMirroredTile, samples, mirrors,
                                        {.ids = true, .lit = true, .mirrors = true}, {}, &result);
  ASSERT_TRUE(status.ok()) << status;
  size_t lit = 0, dark = 0;
  for (uint32_t i = 0; i < kMirroredSide * kMirroredSide; ++i) {
    if (!Bit(result.mirror_bits, i) || result.triangle[i] / 2 != 1) continue;
    // Where on the ceiling: depth 6 to the floor, and 8 up again.
    const double x = -6 + 14 * PixelDirection(camera, i % kMirroredSide, i / kMirroredSide).x;
    if (std::abs(x) < 0.01) continue;
    ASSERT_EQ(Bit(result.lit_bits, i), x < 0) << x;
    (x < 0 ? lit : dark) += 1;
  }
  EXPECT_GT(lit, 100u);
  EXPECT_GT(dark, 100u);
}

// Prepared once, mirrors serve every tile of the camera.
TEST(MirrorsTest, PreparedMirrorsShowTheSame) {
  const ObjectInput floor = Quad({-9, -9, 0}, {9, -9, 0}, {9, 9, 0}, {-9, 9, 0});
  const IndexedGeometry scene = MakeScene({floor, MakeIcosphere(2, 4, At({1, 2, 12}))});
  const Camera camera = testing_support::LookingDown({0, 0, 6}, 0.9, kMirroredSide);
  const Mirror mirrors[] = {{.object = 0}};
  const TileResult expected = Look(scene, camera, mirrors);
  ASSERT_GT(expected.points.size(), 100u);
  const auto prepared = PrepareMirrors(scene.geometry, mirrors, camera);
  ASSERT_TRUE(prepared.ok()) << prepared.status();
  TileResult seen;
  ASSERT_TRUE(TraceTile(scene, camera, kMirroredTile, {}, *prepared, kOutputs, {}, &seen).ok());
  EXPECT_EQ(seen.triangle, expected.triangle);
  EXPECT_EQ(seen.depth, expected.depth);
  EXPECT_EQ(seen.mirror_bits, expected.mirror_bits);
  EXPECT_TRUE(seen.points.positions == expected.points.positions);
  Camera far = camera;
  far.eye.z = 0x1p41;
  EXPECT_THAT(std::string(PrepareMirrors(scene.geometry, mirrors, far).status().message()),
              HasSubstr("camera.eye"));
}

// The plane of a mirror that gives none takes all of its object's triangles: a token is seen.
TEST(MirrorsTest, LookingForAPlaneStops) {
  const IndexedGeometry scene = MakeScene({Quad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0})});
  const Mirror mirrors[] = {{.object = 0}};
  CancelToken cancel;
  EXPECT_TRUE(PreparedMirrors::Prepare(scene.geometry, mirrors, {0, 0, 5}, &cancel).ok());
  cancel.Cancel();
  EXPECT_EQ(PreparedMirrors::Prepare(scene.geometry, mirrors, {0, 0, 5}, &cancel).status().code(),
            absl::StatusCode::kCancelled);
}

TEST(MirrorsTest, WhatIsNoMirrorIsRefused) {
  ObjectInput flat = Quad({0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  ObjectInput ball = MakeIcosphere(1, 1, {});
  ball.name = "ball";
  const ObjectInput nothing = {.vertices = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}}, .indices = {0, 1, 2}};
  const IndexedGeometry scene = MakeScene({flat, ball, nothing});
  const auto expect = [&](const std::vector<Mirror>& mirrors, const char* what) {
    const auto prepared = PreparedMirrors::Prepare(scene.geometry, mirrors, {0, 0, 5});
    EXPECT_EQ(prepared.status().code(), absl::StatusCode::kInvalidArgument) << what;
    EXPECT_THAT(std::string(prepared.status().message()), HasSubstr(what));
  };
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  expect({{.object = 3}}, "mirrors[0].object = 3: the scene has 3 objects");
  expect({{.object = 0}, {.object = 0}}, "mirrors[1].object");
  expect({{.object = 1}}, "\"ball\" is not flat");
  expect({{.object = 2}}, "no triangle to be a mirror");
  expect({{.object = 0, .plane = MirrorPlane{{0, kNan, 0}, {0, 0, 1}}}}, "point is not finite");
  expect({{.object = 0, .plane = MirrorPlane{{0, 0, 0}, {0, 0, 0}}}}, "not the normal");
  expect({{.object = 0, .plane = MirrorPlane{{0, 0, 0}, {0, kNan, 0}}}}, "not the normal");
  expect({{.object = 0, .plane = MirrorPlane{{0, 0, 0}, {0, 1e200, 0}}}}, "not the normal");
  expect({{.object = 0, .plane = MirrorPlane{{0, 0, 1.5e12}, {0, 0, 1}}}}, "beyond 2^40");
  expect(std::vector<Mirror>(kMaxMirrors + 1), "65");
  EXPECT_TRUE(PreparedMirrors::Prepare(
                  scene.geometry,
                  std::vector<Mirror>{{.object = 1, .plane = MirrorPlane{{0, 0, 0}, {0, 0, 2}}},
                                      {.object = 0}},
                  {0, 0, 5})
                  .ok());
}

}  // namespace
}  // namespace sightline
