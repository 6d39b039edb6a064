// SPDX-License-Identifier: Apache-2.0
//
// Where one scene holds what is as small as floats go and what is as large as scenes may be: bounds
// that are relative to one factor of a product then stand or fall by what underflows, or overflows,
// in the others. Every strategy, brute force among them, has to say what the definition says of
// each triangle by itself, without a float stage; and of first hits what brute force says.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/accel/indexed_geometry.h"
#include "core/geometry/camera.h"
#include "core/intersect/predicate.h"
#include "core/light/light.h"
#include "core/mesh/object.h"
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
using testing_support::IndexObjects;
using testing_support::InTurn;
using testing_support::SameBytes;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::Way;

constexpr int kLargest = 39;     // Coordinates are below 2^40.
constexpr int kSmallest = -148;  // A few of a float's least.

double PowerOfTwo(int exponent) { return std::ldexp(1.0, exponent); }

int Between(TestRng& rng, int low, int high) {
  return low + static_cast<int>(rng.Below(static_cast<uint64_t>(high - low) + 1));
}

// Within a cube from -1 to 1.
Vec3d InCube(TestRng& rng) { return {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)}; }

// As a stored point: no -0, and nothing beyond what a scene may hold.
Vec3f Stored(Vec3d v) {
  const double most = PowerOfTwo(40);
  for (int k = 0; k < 3; ++k) v[k] = std::clamp(v[k], -most, most);
  return ToFloat(v) + Vec3f{};
}

// Triangles with corners about `middle`, `size` away from it.
void AddTriangles(TestRng& rng, int count, Vec3d middle, double size, ObjectInput* object) {
  for (int i = 0; i < 3 * count; ++i) {
    object->indices.push_back(static_cast<uint32_t>(object->vertices.size()));
    object->vertices.push_back(ToDouble(Stored(middle + InCube(rng) * size)));
  }
}

IndexedGeometry Index(const ObjectInput& object, int max_leaf) {
  IndexedGeometry scene = IndexObjects({object}, Vec3d{}, max_leaf);
  AddKdTree({}, &scene);
  return scene;
}

LightSample At(Vec3d place, uint32_t light) { return {.value = Stored(place), .light = light}; }

ShadowResult Shade(const IndexedGeometry& scene, std::span<const Vec3f> points,
                   std::span<const LightSample> samples, const ShadowOutputs& outputs,
                   const Way& way) {
  ShadowResult result;
  const absl::Status status =
      ComputeShadows(scene, {points, {}, {}}, samples, {}, {}, outputs, way.Options(), &result);
  EXPECT_TRUE(status.ok()) << status;
  return result;
}

// Which samples each point is lit by, as the predicate has it of one triangle after the other.
std::vector<uint8_t> LitByDefinition(const IndexedGeometry& scene, std::span<const Vec3f> points,
                                     std::span<const LightSample> samples) {
  const size_t row = (points.size() + 7) / 8;
  std::vector<uint8_t> lit(samples.size() * row);
  for (size_t s = 0; s < samples.size(); ++s) {
    const Vec3f value = samples[s].value;
    for (size_t p = 0; p < points.size(); ++p) {
      const PredicateRay ray = samples[s].directional ? PredicateRay::Ray(points[p], value)
                                                      : PredicateRay::Segment(value, points[p]);
      const auto blocks = [&](const std::array<uint32_t, 3>& corners) {
        const auto& vertices = scene.geometry.vertices;
        return Blocks(ray, vertices[corners[0]], vertices[corners[1]], vertices[corners[2]]);
      };
      const auto& triangles = scene.geometry.triangles;
      if (std::none_of(triangles.begin(), triangles.end(), blocks)) {
        lit[s * row + p / 8] |= static_cast<uint8_t>(1u << p % 8);
      }
    }
  }
  return lit;
}

// Any hit, and with `nearest` the first one and where.
void CheckShadows(const IndexedGeometry& scene, std::span<const Vec3f> points,
                  std::span<const LightSample> samples, bool nearest, TestRng& rng) {
  const ShadowOutputs outputs{.bits = !nearest, .blockers = nearest};
  ShadowResult truth = Shade(scene, points, samples, outputs, AllWays().front());
  if (!nearest) {
    const std::vector<uint8_t> lit = LitByDefinition(scene, points, samples);
    EXPECT_TRUE(SameBytes(truth.lit_bits, lit)) << "brute force";
    truth.lit_bits.assign(lit.begin(), lit.end());
  }
  for (const Way& way : InTurn(AllWays(scene.kd_tree.has_value()), rng)) {
    SCOPED_TRACE(way.Name());
    const ShadowResult result = Shade(scene, points, samples, outputs, way);
    EXPECT_TRUE(SameBytes(result.lit_bits, truth.lit_bits)) << "lit";
    EXPECT_TRUE(SameBytes(result.blocker, truth.blocker)) << "blockers";
    EXPECT_TRUE(SameBytes(result.blocker_t, truth.blocker_t)) << "blockers' distances";
  }
}

ObjectInput Triangles(std::span<const std::array<Vec3d, 3>> triangles) {
  ObjectInput object;
  for (const auto& triangle : triangles) {
    for (const Vec3d corner : triangle) {
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(corner);
    }
  }
  return object;
}

// What an edge's form loses by products of its triangle's length and the direction, which
// underflow, the points' distance scales: it had been taken for the least float alone.
TEST(MixedScalesTest, ParallelRaysFromAfarPassTrianglesOfNothing) {
  TestRng rng;
  const std::array<Vec3d, 3> triangle = {Vec3d{0x1.6p-117, -0x1.8p-115, -0x1.fp-118},
                                         Vec3d{0x1.3p-119, -0x1.8p-116, 0x1.8p-116},
                                         Vec3d{0x1.c9p-119, -0x1.8p-116, 0x1p-117}};
  const std::array<Vec3f, 3> points = {Vec3f{0x1.8p20f, -0x1p28f, 0x1.8p23f},
                                       Vec3f{0x1.8p21f, -0x1p29f, 0x1.8p24f},
                                       Vec3f{0x1.6ep23f, -0x1p31f, 0x1.a5p26f}};
  const LightSample sun = {.directional = true, .value = {-0x1.6ep-28f, 0x1p-20f, -0x1.a5p-25f}};
  CheckShadows(Index(Triangles({&triangle, 1}), 16), points, {&sun, 1}, /*nearest=*/false, rng);
}

TEST(MixedScalesTest, ParallelRaysFromAfarPassDenormalTriangles) {
  TestRng rng;
  const std::array<Vec3d, 3> triangle = {Vec3d{-0x1.b644p-132, 0x1.cp-133, -0x1.7p-132},
                                         Vec3d{-0x1.cp-132, 0x1.cp-133, -0x1.76f8p-132},
                                         Vec3d{-0x1.b678p-132, 0x1.cp-133, -0x1.76f8p-132}};
  const std::array<Vec3f, 2> points = {Vec3f{-0x1p38f, 0x1.8p37f, 0x1p38f},
                                       Vec3f{-0x1.8p-132f, 0x1.8p-133f, -0x1.8p-132f}};
  const LightSample sun = {.directional = true, .value = {0x1p-4f, -0x1.8p-5f, -0x1p-4f}};
  CheckShadows(Index(Triangles({&triangle, 1}), 16), points, {&sun, 1}, /*nearest=*/false, rng);
}

// What the length of a segment loses where it is multiplied by a rounding's share, the distance of
// a triangle's corner scales.
TEST(MixedScalesTest, ShortSegmentsPassFarSlivers) {
  TestRng rng;
  const std::array<Vec3d, 3> triangle = {Vec3d{0x1.d1ea34p38, -0x1.aa867cp35, 0},
                                         Vec3d{-0x1.27f6b4p38, 0x1.0ef136p35, 0},
                                         Vec3d{0x1.d27e82p38, -0x1.aefaacp35, 0}};
  const LightSample light = At({-0x1.76e9p-131, -0x1.7451cp-131, -0x1.8fa6p-134}, 0);
  const std::vector<Vec3f> points(8, Vec3f{-0x1.ea788p-131f, -0x1.315c8p-132f, 0x1.a53bp-131f});
  CheckShadows(Index(Triangles({&triangle, 1}), 16), points, {&light, 1}, /*nearest=*/false, rng);
}

// Triangles that lie across an axis, one edge of each past the middle by no more than a rounding of
// its ends.
ObjectInput SliversAcross(int axis, int far, TestRng& rng) {
  ObjectInput object;
  for (int i = Between(rng, 1, 12); i > 0; --i) {
    const Vec3d a = InCube(rng) * PowerOfTwo(far);
    for (Vec3d corner :
         {a, a * -rng.Uniform(0.1, 1), a + InCube(rng) * PowerOfTwo(far - Between(rng, 0, 20))}) {
      corner[axis] = 0;
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(ToDouble(Stored(corner)));
    }
  }
  return object;
}

// By one light of a sample or two, and by one of many: on one side of what is at 0 along an axis,
// the points on the other.
TEST(MixedScalesTest, ShortSegmentsThroughFarSlivers) {
  TestRng rng;
  for (int64_t round = ScaledCount(200); round > 0 && !HasFailure(); --round) {
    const int far = Between(rng, 20, kLargest - 1), near = Between(rng, -145, -90);
    const int axis = Between(rng, 0, 2);
    const auto beyond = [&](int scale, double side) {
      Vec3d v = InCube(rng) * PowerOfTwo(scale);
      v[axis] = side * std::abs(v[axis]);
      return v;
    };
    std::vector<Vec3f> points;
    for (uint64_t n = 16 + rng.Below(100); n > 0; --n) points.push_back(Stored(beyond(near, 1)));
    std::vector<LightSample> lights = {At(beyond(near, -1), 0), At(beyond(near + 3, -1), 1)};
    const Vec3d middle = beyond(near, -1), u = InCube(rng) * PowerOfTwo(near - Between(rng, 0, 6));
    const Vec3d v = InCube(rng) * PowerOfTwo(near - Between(rng, 0, 6));
    for (int i = Between(rng, 0, 16); i > 0; --i) {
      lights.push_back(At(middle + u * rng.Uniform(-1, 1) + v * rng.Uniform(-1, 1), 2));
    }
    SCOPED_TRACE(absl::StrCat("slivers of 2^", far, ", points within 2^", near));
    CheckShadows(Index(SliversAcross(axis, far, rng), 16), points, lights, /*nearest=*/false, rng);
  }
}

TEST(MixedScalesTest, ParallelRaysAgainstTinyTriangles) {
  TestRng rng;
  for (int64_t round = ScaledCount(60); round > 0 && !HasFailure(); --round) {
    const int size = Between(rng, -140, -40), toward = Between(rng, -19, 19);
    ObjectInput object;
    for (int i = Between(rng, 1, 6); i > 0; --i) {
      AddTriangles(rng, 1, InCube(rng) * PowerOfTwo(size - 1), PowerOfTwo(size), &object);
    }
    Vec3d along = InCube(rng);
    along = along * (1 / std::max({std::abs(along.x), std::abs(along.y), std::abs(along.z)}));
    const int farthest = Between(rng, 20, kLargest);
    std::vector<Vec3f> points;
    for (uint64_t n = 64 + rng.Below(240); n > 0; --n) {
      points.push_back(Stored(along * -PowerOfTwo(farthest - Between(rng, 0, 12))));
    }
    const LightSample sun = {.directional = true, .value = Stored(along * PowerOfTwo(toward))};
    SCOPED_TRACE(absl::StrCat("triangles of 2^", size, ", points within 2^", farthest));
    CheckShadows(Index(object, 16), points, {&sun, 1}, /*nearest=*/false, rng);
  }
}

// A form's share of what is near the light's centre overflowed beside one that is far from it, and
// a sample whose sum was no number was taken for one that sees nothing.
TEST(MixedScalesTest, HugeLightsSeeBesideTheirCentre) {
  TestRng rng;
  const std::array<Vec3d, 3> triangle = {Vec3d{-0x1p38, -0x1p37, 0x1p33},
                                         Vec3d{0x1.8p34, -0x1.8p36, 0x1.8p37},
                                         Vec3d{-0x1.8p36, 0x1.8p36, -0x1.8p34}};
  const std::array<Vec3f, 2> points = {Vec3f{0x1p-43f, -0x1p-42f, 0x1p-40f},
                                       Vec3f{-0x1p37f, 0x1p36f, 0x1p39f}};
  const std::array<LightSample, 4> samples = {
      At({0x1p35, -0x1p35, 0}, 0), At({-0x1p35, 0x1p35, 0}, 0), At({0x1p35, 0x1p35, 0}, 0),
      At({-0x1.8p34, -0x1.8p32, 0}, 0)};
  CheckShadows(Index(Triangles({&triangle, 1}), 16), points, samples, /*nearest=*/false, rng);
}

TEST(MixedScalesTest, HugeLights) {
  TestRng rng;
  for (int64_t round = ScaledCount(60); round > 0 && !HasFailure(); --round) {
    ObjectInput object;
    for (int i = Between(rng, 1, 20); i > 0; --i) {
      const Vec3d middle = InCube(rng) * PowerOfTwo(Between(rng, 35, 38));
      AddTriangles(rng, 1, middle, PowerOfTwo(Between(rng, 34, 38)), &object);
    }
    // Its middle is where points may be, too.
    const double half = PowerOfTwo(Between(rng, 34, 38));
    std::vector<LightSample> samples = {At({half, half, 0}, 0), At({-half, half, 0}, 0),
                                        At({half, -half, 0}, 0), At({-half, -half, 0}, 0)};
    for (int i = Between(rng, 4, 12); i > 0; --i) {
      samples.push_back(At({half * rng.Uniform(-1, 1), half * rng.Uniform(-1, 1), 0}, 0));
    }
    const int least = Between(rng, -40, 0);
    std::vector<Vec3f> points;
    for (uint64_t n = 16 + rng.Below(48); n > 0; --n) {
      const int exponent =
          rng.Chance(0.3) ? Between(rng, least, least + 3) : Between(rng, 34, kLargest);
      const double z = PowerOfTwo(exponent) * rng.Uniform(0.5, 1);
      points.push_back(Stored({z * rng.Uniform(-0.4, 0.4), z * rng.Uniform(-0.4, 0.4), z}));
    }
    CheckShadows(Index(object, 1 + static_cast<int>(rng.Below(16))), points, samples,
                 /*nearest=*/false, rng);
  }
}

// A share of a long segment that is a denormal number is off by as much as it names, which the
// segment's length scales: a box that ended at the hit culled what is nearer.
TEST(MixedScalesTest, FirstHitsByShareOfNothing) {
  TestRng rng;
  for (int64_t round = ScaledCount(60); round > 0 && !HasFailure(); --round) {
    const double size = PowerOfTwo(Between(rng, -112, -92));
    const int axis = Between(rng, 0, 2);
    ObjectInput object;
    for (int i = Between(rng, 5, 40); i > 0; --i) {
      const size_t first = object.vertices.size();
      AddTriangles(rng, 2, InCube(rng) * (0.3 * size), 0.7 * size, &object);
      const double at = size * (1 + rng.Uniform(0, 1) * PowerOfTwo(-Between(rng, 0, 10)));
      for (size_t v = first; v < object.vertices.size(); ++v) object.vertices[v][axis] = at;
    }
    std::vector<Vec3f> points;
    for (int i = 0; i < 64; ++i) {
      Vec3d toward = InCube(rng) * 0.3;
      toward[axis] = 1;
      points.push_back(Stored(toward * PowerOfTwo(Between(rng, 36, kLargest))));
    }
    const LightSample light = At({}, 0);
    CheckShadows(Index(object, 1 + static_cast<int>(rng.Below(8))), points, {&light, 1},
                 /*nearest=*/true, rng);
  }
}

// Walls across an axis, as far from the origin as a few of a float's least numbers, each leaf's one
// by itself.
ObjectInput WallsNextToTheOrigin(int axis, double side, TestRng& rng) {
  ObjectInput object;
  const double half = PowerOfTwo(Between(rng, 0, 38));
  for (int i = Between(rng, 5, 40); i > 0; --i) {
    const double at = side * static_cast<double>(1 + rng.Below(200)) * PowerOfTwo(-149);
    for (Vec3d corner : {Vec3d{-half, -half, -half}, Vec3d{3 * half, -half, 3 * half},
                         Vec3d{-half, 3 * half, -half}}) {
      corner[(axis + 2) % 3] = axis == 1 ? corner[0] : corner[1];
      corner[(axis + 1) % 3] = axis == 1 ? corner[1] : corner[0];
      corner[axis] = at;
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(corner);
    }
  }
  return object;
}

// The inverse of a depth below 2^-128 is beyond all floats, and the depth that no ray looks beyond
// came out as none at all: what is nearer was not looked at.
TEST(MixedScalesTest, FirstHitsNextToTheOrigin) {
  TestRng rng;
  for (int64_t round = ScaledCount(12); round > 0 && !HasFailure(); --round) {
    const int axis = Between(rng, 0, 2);
    const double side = rng.Chance(0.5) ? 1 : -1;
    const IndexedGeometry scene =
        Index(WallsNextToTheOrigin(axis, side, rng), 1 + static_cast<int>(rng.Below(16)));
    const double far = PowerOfTwo(Between(rng, -60, kLargest));
    std::vector<Vec3f> points;
    for (int i = 0; i < 256; ++i) {
      const int column = i % 16, row = i / 16;
      Vec3d p = Vec3d{column - 7.5, row - 7.5, row - 7.5} * (far / 32);
      p[axis] = side * far;
      points.push_back(Stored(p));
    }
    const LightSample light = At({}, 0);
    CheckShadows(scene, points, {&light, 1}, /*nearest=*/true, rng);

    Vec3d along, up;
    along[axis] = side;
    up[(axis + 1) % 3] = 1;
    const absl::StatusOr<Camera> camera = LookAt({}, along, up, 90, 128, 64);
    ASSERT_TRUE(camera.ok()) << camera.status();
    TileResult truth;
    for (const Way& way : AllWays(/*kd_tree=*/true)) {
      SCOPED_TRACE(way.Name());
      TileResult tile;
      const absl::Status status = TraceTile(scene, *camera, {0, 0, 128, 64}, {},
                                            {.ids = true, .depth = true}, way.Options(), &tile);
      ASSERT_TRUE(status.ok()) << status;
      if (truth.triangle.empty()) truth = tile;
      EXPECT_TRUE(SameBytes(tile.triangle, truth.triangle)) << "ids";
      EXPECT_TRUE(SameBytes(tile.depth, truth.depth)) << "depths";
    }
  }
}

// Offsets of origins that are next to nothing apart are off by as much as they are, which the
// normal of a huge triangle scales: blocks were left out that it darkens.
TEST(MixedScalesTest, ParallelRaysFromOnePlacePassHugeTriangles) {
  TestRng rng;
  const std::array<Vec3d, 3> triangle = {Vec3d{}, Vec3d{0x1p40, 0, 0}, Vec3d{0, 0x1p40, 0}};
  std::vector<Vec3f> points(256, Stored(Vec3d{25, 25, -1} * PowerOfTwo(-149)));
  std::fill_n(points.begin() + 112, 32, Stored(Vec3d{7, 8, -9} * PowerOfTwo(-149)));
  const LightSample sun = {.directional = true, .value = {0.575f, 0.759f, 0.937f}};
  CheckShadows(Index(Triangles({&triangle, 1}), 16), points, {&sun, 1}, /*nearest=*/false, rng);
}

TEST(MixedScalesTest, ParallelRaysFromNextToOnePlace) {
  TestRng rng;
  for (int64_t round = ScaledCount(300); round > 0 && !HasFailure(); --round) {
    ObjectInput object;
    const double unit = PowerOfTwo(Between(rng, -149, -140));
    const auto nearby = [&] {
      const auto some = [&rng] { return static_cast<double>(Between(rng, -30, 30)); };
      return Vec3d{some(), some(), some()} * unit;
    };
    for (int i = Between(rng, 1, 4); i > 0; --i) {
      // Of corners that each have a scale of their own, one among the points.
      const size_t first = object.vertices.size();
      AddTriangles(rng, 1, {}, PowerOfTwo(kLargest), &object);
      object.vertices[first] = nearby();
      object.vertices[first + 2] = object.vertices[first + 2] * PowerOfTwo(-Between(rng, 0, 20));
    }
    std::vector<Vec3f> points;
    while (points.size() < 256) {
      points.insert(points.end(), size_t{1} << Between(rng, 0, 6), Stored(nearby()));
    }
    points.resize(256);
    const LightSample sun = {.directional = true, .value = Stored(InCube(rng))};
    CheckShadows(Index(object, 16), points, {&sun, 1}, /*nearest=*/false, rng);
  }
}

// What a triangle of nothing leans along a light is off by as much as a float's least, which the
// light's distance scales and the points' nearness to its centre: samples were left out.
TEST(MixedScalesTest, LinesOfLightThroughPointsPassTrianglesOfNothing) {
  TestRng rng;
  const double least = PowerOfTwo(-149), x = 0x1.c67p+9, y = 0x1.2p-61, z = 0x1.da9p+9;
  const std::array<Vec3d, 3> triangle = {Vec3d{0, least, least}, Vec3d{0, -least, 0},
                                         Vec3d{0, 0, -least}};
  std::vector<Vec3f> points(16, Stored({x, y, z}));
  points.resize(32, Stored({x, 2 * y, z}));
  const std::array<LightSample, 4> samples = {
      At({-x, -y, -z}, 0), At({0x1.54d4p+11, -y, 0x1.63ecp+11}, 0),
      At({0x1.c67p+10, -y, 0x1.da9p+10}, 0), At({0x1.c67p+8, -y, 0x1.da9p+8}, 0)};
  CheckShadows(Index(Triangles({&triangle, 1}), 16), points, samples, /*nearest=*/false, rng);
}

TEST(MixedScalesTest, LinesOfLightNextToPoints) {
  TestRng rng;
  for (int64_t round = ScaledCount(200); round > 0 && !HasFailure(); --round) {
    const double scale = PowerOfTwo(Between(rng, 4, 20));
    const double x = scale * rng.Uniform(0.5, 1), z = scale * rng.Uniform(0.5, 1);
    const double y = PowerOfTwo(-Between(rng, 58, 64)) * rng.Uniform(1, 2);
    const Vec3f light = Stored({-x, -y, -z});  // Its opposite in 0 is the line's middle, but for y.
    std::vector<LightSample> samples = {At(ToDouble(light), 0)};
    for (const double share : {3.0, 2.0, 0.5, 1.5}) {
      samples.push_back(At({-light.x * share, light.y, -light.z * share}, 0));
    }
    std::vector<Vec3f> points(16, light * -1.0f);
    points.resize(32, Stored({-light.x, -2.0 * light.y, -light.z}));
    ObjectInput object;
    const double least = PowerOfTwo(-149);
    for (int i = Between(rng, 1, 6); i > 0; --i) {
      for (int corner = 0; corner < 3; ++corner) {
        const auto some = [&rng] { return static_cast<double>(Between(rng, -2, 2)); };
        object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
        object.vertices.push_back(Vec3d{some(), some(), some()} * least);
      }
    }
    CheckShadows(Index(object, 16), points, samples, /*nearest=*/false, rng);
  }
}

// Anything beside anything: triangles, points and lights about one place, each as large, or as far,
// as it happens.
TEST(MixedScalesTest, EverythingOfAScaleOfItsOwn) {
  TestRng rng;
  for (int64_t round = ScaledCount(40); round > 0 && !HasFailure(); --round) {
    const auto any = [&rng] {
      switch (rng.Below(4)) {
        case 0:
          return Between(rng, kSmallest, -100);
        case 1:
          return Between(rng, -100, -20);
        case 2:
          return Between(rng, -20, 20);
        default:
          return Between(rng, 20, kLargest);
      }
    };
    ObjectInput object;
    std::vector<int> scales;
    for (int i = Between(rng, 1, 12); i > 0; --i) {
      scales.push_back(any());
      const double size = PowerOfTwo(scales.back());
      const double spread = rng.Chance(0.5) ? size : 0.3 * size;
      for (int k = Between(rng, 1, 6); k > 0; --k) {
        AddTriangles(rng, 1, InCube(rng) * size, spread, &object);
      }
    }
    const auto some = [&] { return rng.Chance(0.5) ? scales[rng.Below(scales.size())] : any(); };
    std::vector<Vec3f> points;
    const Vec3d axis = InCube(rng);
    const double width = rng.Chance(0.5) ? 0.2 : 1;
    // Now and then enough for two packets, and a part of a third.
    for (uint64_t n = rng.Chance(0.2) ? 512 + rng.Below(200) : 16 + rng.Below(180); n > 0; --n) {
      const int scale = std::min(kLargest, some() + Between(rng, 0, 2));
      points.push_back(Stored((axis + InCube(rng) * width) * PowerOfTwo(scale)));
    }
    std::vector<LightSample> samples;
    const int kind = Between(rng, 0, 3);
    if (kind == 0) {  // Many lights.
      for (uint32_t i = 0; i < 40; ++i) samples.push_back(At(InCube(rng) * PowerOfTwo(some()), i));
    } else if (kind == 1) {  // One that is broad.
      const Vec3d middle = rng.Chance(0.5) ? InCube(rng) * PowerOfTwo(some()) : Vec3d{};
      const Vec3d u = InCube(rng) * PowerOfTwo(std::min(38, any()));
      const Vec3d v = InCube(rng) * PowerOfTwo(std::min(38, any()));
      for (int i = Between(rng, 4, 16); i > 0; --i) {
        samples.push_back(At(middle + u * rng.Uniform(-1, 1) + v * rng.Uniform(-1, 1), 0));
      }
    } else if (kind == 2) {
      samples.push_back(At({}, 0));
    } else {  // Opposite to points.
      for (uint32_t i = 0; i < 20; ++i) {
        samples.push_back(At(ToDouble(points[rng.Below(points.size())]) * -1.0, i));
      }
    }
    const IndexedGeometry scene = Index(object, 2 + static_cast<int>(rng.Below(15)));
    CheckShadows(scene, points, samples, /*nearest=*/false, rng);
    if (rng.Chance(0.25)) CheckShadows(scene, points, {samples.data(), 1}, /*nearest=*/true, rng);
  }
}

}  // namespace
}  // namespace sightline
