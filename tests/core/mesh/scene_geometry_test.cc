// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/scene_geometry.h"

#include <bit>
#include <chrono>
#include <cmath>
#include <limits>

#include "core/base/parallel.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::TestRng;

constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

ObjectInput Quad(const std::string& name, Vec3d at = {}) {
  return {.name = name,
          .vertices = {at, at + Vec3d{1, 0, 0}, at + Vec3d{1, 1, 0}, at + Vec3d{0, 1, 0}},
          .indices = {0, 1, 2, 0, 2, 3}};
}

SceneGeometry Compile(const std::vector<ObjectInput>& objects,
                      std::optional<Vec3d> origin = std::nullopt) {
  absl::StatusOr<SceneGeometry> geometry = CompileScene(objects, origin, {});
  EXPECT_TRUE(geometry.ok()) << geometry.status();
  return geometry.ok() ? *std::move(geometry) : SceneGeometry();
}

void ExpectError(const std::vector<ObjectInput>& objects, absl::StatusCode code,
                 const std::vector<std::string>& parts, std::optional<Vec3d> origin = std::nullopt,
                 const MeshLimits& limits = {}) {
  const absl::Status status = CompileScene(objects, origin, limits).status();
  EXPECT_EQ(status.code(), code) << status;
  for (const std::string& part : parts) {
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }
}

TEST(CompileSceneTest, Nothing) {
  const SceneGeometry geometry = Compile({});
  EXPECT_EQ(geometry.origin, Vec3d());
  EXPECT_TRUE(geometry.bounds.empty());
  EXPECT_TRUE(geometry.uniform);
  // An object without vertices, and one with vertices but no triangle.
  const SceneGeometry empty = Compile({{.name = "a"}, {.name = "b", .vertices = {{5, 6, 7}}}});
  EXPECT_EQ(empty.origin, (Vec3d{5, 6, 7}));
  EXPECT_EQ(empty.triangles.size(), 0u);
  EXPECT_TRUE(empty.bounds.empty());
}

TEST(CompileSceneTest, NamesAreUtf8) {
  EXPECT_EQ(Compile({Quad("st\xC3\xBChl \xF0\x9F\xAA\x91")}).objects[0].name,
            "st\xC3\xBChl \xF0\x9F\xAA\x91");
  for (const char* name : {"\xFF", "chair\xC3", "\xED\xA0\x80"}) {
    const std::vector<ObjectInput> objects = {Quad("a"), Quad(name)};
    ExpectError(objects, absl::StatusCode::kInvalidArgument, {"object 1", "UTF-8"});
    EXPECT_THAT(std::string(CompileScene(objects, std::nullopt, {}).status().message()),
                ::testing::Not(HasSubstr(name)));
  }
}

TEST(CompileSceneTest, StoresFloatsRelativeToTheFirstVertex) {
  const Vec3d corner{447422.999, 4482345.125, 17.3};
  const SceneGeometry geometry =
      Compile({Quad("a", corner), Quad("b", corner + Vec3d{10, 0, 0.1})});
  EXPECT_EQ(geometry.origin, corner);
  ASSERT_EQ(geometry.vertices.size(), 8u);
  EXPECT_EQ(geometry.vertices[0], (Vec3f{0, 0, 0}));
  const Vec3d b = corner + Vec3d{10, 0, 0.1};
  EXPECT_EQ(geometry.vertices[4], ToFloat(b - corner));
  EXPECT_EQ(geometry.triangles[2], (std::array<uint32_t, 3>{4, 5, 6}));
  EXPECT_EQ(geometry.objects[1].first_triangle, 2u);
  EXPECT_EQ(geometry.objects[1].first_vertex, 4u);
  EXPECT_EQ(geometry.bounds.lo, (Vec3f{0, 0, 0}));
  EXPECT_LT(geometry.report.largest_rounding, 1e-6);
  EXPECT_EQ(geometry.report.triangles, 4u);
  EXPECT_EQ(geometry.report.vertices, 8u);
}

TEST(CompileSceneTest, AGivenOriginIsTakenAndRoundingReported) {
  const SceneGeometry geometry = Compile({Quad("a", {0x1p30 + 0.5, 0, 0})}, Vec3d{0, 0, 0});
  EXPECT_EQ(geometry.origin, (Vec3d{0, 0, 0}));
  EXPECT_EQ(geometry.report.largest_rounding, 1.5);  // 2^30 + 1.5 becomes 2^30.
}

TEST(CompileSceneTest, OriginSkipsVerticesThatAreNotFinite) {
  ObjectInput spoiled = Quad("a", {8, 8, 8});
  spoiled.vertices[0].x = kNoNumber;
  spoiled.transform.m[3] = 100;
  const SceneGeometry geometry = Compile({{.name = "none"}, spoiled});
  EXPECT_EQ(geometry.origin, (Vec3d{109, 8, 8}));
}

TEST(CompileSceneTest, NoCoordinateIsMinusZero) {
  const ObjectInput object{.name = "a",
                           .vertices = {{-0.0, -1e-60, 0}, {1, -0.0, 0}, {0, 1, -1e-60}},
                           .indices = {0, 1, 2}};
  const SceneGeometry geometry = Compile({object}, Vec3d{0, 0, 0});
  for (const Vec3f& v : geometry.vertices) {
    for (int axis = 0; axis < 3; ++axis) EXPECT_FALSE(std::signbit(v[axis]));
  }
}

TEST(CompileSceneTest, TransformsPlaceObjects) {
  ObjectInput object = Quad("a");
  object.transform.m = {0, -2, 0, 10, 2, 0, 0, 20, 0, 0, 2, 30};
  const SceneGeometry geometry = Compile({object}, Vec3d{10, 20, 30});
  EXPECT_THAT(geometry.vertices,
              ElementsAre(Vec3f{0, 0, 0}, Vec3f{0, 2, 0}, Vec3f{-2, 2, 0}, Vec3f{-2, 0, 0}));
  EXPECT_EQ(geometry.objects[0].transform, object.transform);
  EXPECT_EQ(geometry.objects[0].source_vertices, nullptr);
  object.dynamic = true;
  const SceneGeometry dynamic = Compile({object});
  ASSERT_NE(dynamic.objects[0].source_vertices, nullptr);
  EXPECT_EQ(*dynamic.objects[0].source_vertices, object.vertices);
  EXPECT_GE(dynamic.MemoryBytes(), geometry.MemoryBytes() + 4 * sizeof(Vec3d));
}

TEST(CompileSceneTest, CountsAndKeepsWhatCannotBlock) {
  ObjectInput object{.name = "mixed",
                     .vertices = {{0, 0, 0},
                                  {1, 0, 0},
                                  {0, 1, 0},
                                  {kNoNumber, 0, 0},
                                  {0, kInfinity, 0},
                                  {2, 0, 0},
                                  {0, 0, 0},
                                  {900, 900, 900}},
                     .indices = {0, 1, 2,    // Good.
                                 0, 1, 3,    // Not finite.
                                 0, 1, 5,    // On a line.
                                 2, 6, 1,    // A duplicate of the first: vertex 6 is vertex 0.
                                 4, 3, 0,    // Not finite.
                                 7, 7, 0,    // Two corners the same.
                                 0, 1, 5}};  // A duplicate, but inert.
  const SceneGeometry geometry = Compile({object});
  EXPECT_EQ(geometry.triangles.size(), 7u);
  EXPECT_THAT(geometry.inert, ElementsAre(1, 2, 4, 5, 6));
  EXPECT_EQ(geometry.report.non_finite_vertices, 2u);
  EXPECT_EQ(geometry.report.non_finite_triangles, 2u);
  EXPECT_EQ(geometry.report.zero_area_triangles, 3u);
  EXPECT_EQ(geometry.report.inert_triangles, 5u);
  EXPECT_EQ(geometry.report.duplicate_triangles, 1u);
  EXPECT_TRUE(std::isnan(geometry.vertices[4].x) && std::isnan(geometry.vertices[4].z));
  // Inert triangles do not widen the bounds.
  EXPECT_EQ(geometry.bounds, (Box3f{{0, 0, 0}, {1, 1, 0}}));
}

// Two vertices that round to the same float make a triangle without area.
TEST(CompileSceneTest, AreaIsThatOfTheStoredFloats) {
  const ObjectInput object{.name = "thin",
                           .vertices = {{1e6, 0, 0}, {1e6 + 1e-4, 0, 0}, {1e6, 1, 0}},
                           .indices = {0, 1, 2}};
  EXPECT_THAT(Compile({object}, Vec3d{0, 0, 0}).inert, ElementsAre(0));
  EXPECT_TRUE(Compile({object}).inert.empty());
}

TEST(CompileSceneTest, NamesAreUniqueAndGivenWhereMissing) {
  const SceneGeometry geometry = Compile({Quad(""), Quad("object-2"), Quad(""), Quad("")});
  EXPECT_EQ(geometry.objects[0].name, "object-0");
  EXPECT_EQ(geometry.objects[1].name, "object-2");
  EXPECT_EQ(geometry.objects[2].name, "object-3");
  EXPECT_EQ(geometry.objects[3].name, "object-4");
  ExpectError({Quad("x"), Quad("y"), Quad("x")}, absl::StatusCode::kInvalidArgument,
              {"object 2 \"x\"", "unique"});
}

TEST(CompileSceneTest, UniformMeansNoMaskAndNoCulling) {
  EXPECT_TRUE(Compile({Quad("a"), Quad("b")}).uniform);
  ObjectInput masked = Quad("b");
  masked.mask = 0x7FFFFFFF;
  EXPECT_FALSE(Compile({Quad("a"), masked}).uniform);
  ObjectInput culled = Quad("b");
  culled.culling = Culling::kBack;
  const SceneGeometry geometry = Compile({Quad("a"), culled});
  EXPECT_FALSE(geometry.uniform);
  EXPECT_EQ(geometry.objects[1].culling, Culling::kBack);
}

TEST(CompileSceneTest, ErrorsNameObjectPositionAndValue) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  ObjectInput bad = Quad("bad");
  bad.indices[4] = 4;
  bad.indices[5] = 1000;
  ExpectError({Quad("good"), bad}, kInvalid, {"object 1 \"bad\"", "indices[4] = 4", "4 vertices"});
  bad = Quad("bad");
  bad.indices.pop_back();
  ExpectError({bad}, kInvalid, {"object 0 \"bad\"", "5 indices", "multiple of 3"});
  bad = Quad("bad");
  bad.transform.m[7] = kInfinity;
  ExpectError({bad}, kInvalid, {"object 0 \"bad\"", "transform[7] = inf"});
  bad = Quad("bad");
  bad.vertices[2].y = 1.5 * kMaxCoordinate;
  ExpectError({Quad("good"), bad}, kInvalid, {"object 1 \"bad\"", "vertex 2", "2^40"});
  bad = Quad("bad");
  bad.transform.m = {1e300, 1e300, 0, 0, 1e300, -1e300, 0, 0, 0, 0, 1, 0};
  bad.vertices[1] = {1e300, 1e300,
                     0};  // Placed at (inf, NaN, 0), though nothing given is not finite.
  ExpectError({bad}, kInvalid, {"vertex 1"});
  // Each within bounds, their difference not.
  ExpectError({Quad("good")}, kInvalid, {"vertex 2", "origin"}, Vec3d{0, -kMaxCoordinate, 0.5});
}

TEST(CompileSceneTest, OriginMustBeFiniteAndInBounds) {
  for (double bad : {kNoNumber, kInfinity, 2 * kMaxCoordinate}) {
    ExpectError({Quad("a")}, absl::StatusCode::kInvalidArgument, {"origin = "}, Vec3d{0, bad, 0});
  }
}

TEST(CompileSceneTest, TheLargestCoordinateIsTaken) {
  ObjectInput object = Quad("a");
  object.transform.m[0] = object.transform.m[5] = kMaxCoordinate;
  const SceneGeometry geometry = Compile({object}, Vec3d{0, 0, 0});
  EXPECT_EQ(geometry.bounds.hi.x, static_cast<float>(kMaxCoordinate));
}

TEST(CompileSceneTest, LimitsAreNamedWithTheirValue) {
  constexpr auto kExhausted = absl::StatusCode::kResourceExhausted;
  const std::vector<ObjectInput> objects = {Quad("a"), Quad("b")};
  ExpectError(objects, kExhausted, {"4 triangles", "max_triangles is 3"}, {}, {.max_triangles = 3});
  ExpectError(objects, kExhausted, {"8 vertices", "max_vertices is 7"}, {}, {.max_vertices = 7});
  ExpectError(objects, kExhausted, {"2 objects", "max_objects is 1"}, {}, {.max_objects = 1});
  EXPECT_TRUE(
      CompileScene(objects, {}, {.max_triangles = 4, .max_vertices = 8, .max_objects = 2}).ok());
}

TEST(CompileSceneTest, StopsWhenCancelled) {
  CancelToken cancel;
  cancel.Cancel();
  const std::vector<ObjectInput> objects = {Quad("a")};
  EXPECT_EQ(CompileScene(objects, {}, {}, &cancel).status().code(), absl::StatusCode::kCancelled);
  // Before its first object is looked at.
  const std::vector<ObjectInput> no_name = {Quad("\xFF")};
  EXPECT_EQ(CompileScene(no_name, {}, {}, &cancel).status().code(), absl::StatusCode::kCancelled);
}

// A deadline that passes amid an object's doubles, which are kept: no machine copies 48 MB in that
// time. The fault of the next object would be found right after them.
TEST(CompileSceneTest, StopsAmidADynamicObject) {
  std::vector<ObjectInput> objects = {{.name = "o", .dynamic = true}, Quad("\xFF")};
  objects[0].vertices.resize(2'000'000);
  CancelToken late;
  late.set_deadline(CancelToken::Clock::now() + std::chrono::microseconds(100));
  EXPECT_EQ(CompileScene(objects, {}, {}, &late).status().code(),
            absl::StatusCode::kDeadlineExceeded);
}

TEST(SceneGeometryTest, ObjectOfSkipsEmptyObjects) {
  const ObjectInput none{.name = "none"}, none2{.name = "none2"}, none3{.name = "none3"};
  const SceneGeometry geometry = Compile({none, Quad("a"), none2, Quad("b"), none3});
  EXPECT_EQ(geometry.ObjectOf(0), 1u);
  EXPECT_EQ(geometry.ObjectOf(1), 1u);
  EXPECT_EQ(geometry.ObjectOf(2), 3u);
  EXPECT_EQ(geometry.ObjectOf(3), 3u);
}

// Large enough for many blocks, with objects that begin and end within them.
TEST(CompileSceneTest, SameBytesWithAnyNumberOfThreads) {
  TestRng rng;
  std::vector<ObjectInput> objects(60);
  for (size_t i = 0; i < objects.size(); ++i) {
    const size_t vertices = i % 7 == 0 ? 0 : 3 + rng.Below(4000);
    for (size_t k = 0; k < vertices; ++k) {
      objects[i].vertices.push_back({rng.Uniform(0, 9), rng.Uniform(0, 9), rng.Uniform(0, 9)});
      if (rng.Chance(0.01)) objects[i].vertices.back().z = kNoNumber;
    }
    for (size_t k = 0; k < 2 * vertices; ++k) {
      for (int c = 0; c < 3; ++c) {
        objects[i].indices.push_back(static_cast<uint32_t>(rng.Below(vertices)));
      }
    }
  }
  std::optional<SceneGeometry> first;
  for (int threads : {1, 2, 4}) {
    ThreadPool pool(threads);
    SceneGeometry geometry;
    pool.ParallelFor(1, 1, [&](size_t, size_t) { geometry = Compile(objects); });
    if (!first.has_value()) first = geometry;
    EXPECT_EQ(geometry.triangles, first->triangles);
    EXPECT_EQ(geometry.inert, first->inert);
    EXPECT_EQ(geometry.bounds, first->bounds);
    EXPECT_EQ(geometry.report.duplicate_triangles, first->report.duplicate_triangles);
    EXPECT_EQ(geometry.report.largest_rounding, first->report.largest_rounding);
    ASSERT_EQ(geometry.vertices.size(), first->vertices.size());
    for (size_t i = 0; i < geometry.vertices.size(); ++i) {
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(std::bit_cast<uint32_t>(geometry.vertices[i][axis]),
                  std::bit_cast<uint32_t>(first->vertices[i][axis]));
      }
    }
  }
  EXPECT_GT(first->report.non_finite_triangles, 0u);
  EXPECT_GT(first->report.zero_area_triangles, 0u);
}

// The first fault in input order is reported, whichever thread meets one first.
TEST(CompileSceneTest, TheFirstOfManyFaultsIsReported) {
  ThreadPool pool(4);
  ObjectInput object{.name = "many"};
  object.vertices.assign(3, Vec3d{1, 2, 3});
  object.indices.assign(300'000, 0);
  for (size_t i = 12'345; i < object.indices.size(); i += 1000) object.indices[i] = 7;
  absl::Status status;
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    status = CompileScene({&object, 1}, std::nullopt, {}).status();
  });
  EXPECT_THAT(std::string(status.message()), HasSubstr("indices[12345] = 7"));
}

}  // namespace
}  // namespace sightline
