// SPDX-License-Identifier: Apache-2.0
//
// A good geometry, spoiled in one place at a time: every fault is found and named.
#include "core/mesh/geometry_validation.h"

#include <functional>
#include <limits>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

constexpr float kNanFloat = std::numeric_limits<float>::quiet_NaN();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class GeometryValidationTest : public ::testing::Test {
 protected:
  // Two quads; of the second one triangle is not finite and one has no area.
  void SetUp() override {
    const std::vector<ObjectInput> objects = {
        {.name = "floor",
         .vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
         .indices = {0, 1, 2, 0, 2, 3}},
        {.name = "empty"},
        {.name = "wall",
         .vertices = {{0, 0, 0}, {0.1, 0, 1}, {kNan, 0, 0}, {0, 0, 2}},
         .indices = {0, 1, 3, 0, 1, 2, 0, 1, 1},
         .mask = 3,
         .dynamic = true}};
    absl::StatusOr<SceneGeometry> geometry = CompileScene(objects, Vec3d{0.25, 0, 0}, {});
    ASSERT_TRUE(geometry.ok()) << geometry.status();
    geometry_ = *std::move(geometry);
    const absl::Status status = ValidateGeometry(geometry_);
    ASSERT_TRUE(status.ok()) << status;
    ASSERT_EQ(geometry_.inert.size(), 2u);
  }

  void ExpectFault(const std::string& part, const std::function<void(SceneGeometry&)>& spoil) {
    SceneGeometry spoiled = geometry_;
    spoil(spoiled);
    const absl::Status status = ValidateGeometry(spoiled);
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss) << "instead of " << part;
    EXPECT_THAT(std::string(status.message()), HasSubstr(part));
  }

  SceneGeometry geometry_;
};

TEST_F(GeometryValidationTest, EmptyIsGood) {
  EXPECT_TRUE(ValidateGeometry(SceneGeometry()).ok());
  EXPECT_TRUE(ValidateGeometry(*CompileScene({}, std::nullopt, {})).ok());
}

// Told by the counts alone: what lies behind such arrays is not looked at.
TEST_F(GeometryValidationTest, AtMostSoManyOfEach) {
  alignas(64) static constexpr char kNothing[64] = {};
  const auto owner = std::make_shared<int>();
  constexpr size_t kTooMany = kMaxGeometryItems + 1;
  ExpectFault("715827883 vertices, and a scene has at most 715827882", [&](SceneGeometry& g) {
    g.vertices =
        AlignedVector<Vec3f>::Borrow({reinterpret_cast<const Vec3f*>(kNothing), kTooMany}, owner);
  });
  using Triangle = std::array<uint32_t, 3>;
  ExpectFault("715827883 triangles, and a scene has at most 715827882", [&](SceneGeometry& g) {
    g.triangles = AlignedVector<Triangle>::Borrow(
        {reinterpret_cast<const Triangle*>(kNothing), kTooMany}, owner);
  });
}

TEST_F(GeometryValidationTest, Objects) {
  ExpectFault("origin", [](SceneGeometry& g) { g.origin.x = kNan; });
  ExpectFault("origin", [](SceneGeometry& g) { g.origin.z = 2 * kMaxCoordinate; });
  ExpectFault("object 2 has no name", [](SceneGeometry& g) { g.objects[2].name = "floor"; });
  ExpectFault("object 1 has no name", [](SceneGeometry& g) { g.objects[1].name.clear(); });
  ExpectFault("object 2 does not begin", [](SceneGeometry& g) { g.objects[2].first_triangle = 1; });
  ExpectFault("object 1 does not begin", [](SceneGeometry& g) { --g.objects[0].vertex_count; });
  ExpectFault("its objects have", [](SceneGeometry& g) { g.objects[2].triangle_count = 5; });
  ExpectFault("culling 3",
              [](SceneGeometry& g) { g.objects[0].culling = static_cast<Culling>(3); });
  ExpectFault("transform", [](SceneGeometry& g) { g.objects[0].transform.m[3] = kNan; });
  ExpectFault("rounding", [](SceneGeometry& g) { g.objects[0].largest_rounding = -1; });
  ExpectFault("largest rounding", [](SceneGeometry& g) { g.report.largest_rounding = 17; });
  ExpectFault("keeps 1 local vertices", [](SceneGeometry& g) {
    g.objects[2].source_vertices = std::make_shared<std::vector<Vec3d>>(1);
  });
  ExpectFault("uniform", [](SceneGeometry& g) { g.uniform = true; });
}

TEST_F(GeometryValidationTest, Vertices) {
  ExpectFault("vertex 1 is not finite", [](SceneGeometry& g) { g.vertices[1].y = kNanFloat; });
  ExpectFault("beyond 2^40", [](SceneGeometry& g) { g.vertices[1].y = 0x1.01p40f; });
  ExpectFault("vertex 0 has a coordinate -0", [](SceneGeometry& g) { g.vertices[0].z = -0.0f; });
  ExpectFault("triangle 3 can be hit", [](SceneGeometry& g) { g.vertices[6] = {1, 2, 3}; });
}

TEST_F(GeometryValidationTest, Triangles) {
  ExpectFault("names vertex 4", [](SceneGeometry& g) { g.triangles[0][0] = 4; });
  ExpectFault("names vertex 4000000000",
              [](SceneGeometry& g) { g.triangles[0][0] = 4'000'000'000u; });
  ExpectFault("names vertex 3", [](SceneGeometry& g) { g.triangles[2][2] = 3; });
  ExpectFault("bounds", [](SceneGeometry& g) { g.bounds.hi.x += 1; });
}

TEST_F(GeometryValidationTest, Inert) {
  ExpectFault("out of range", [](SceneGeometry& g) { g.inert = {3, 5}; });
  ExpectFault("out of order", [](SceneGeometry& g) { g.inert = {4, 3}; });
  ExpectFault("out of order", [](SceneGeometry& g) { g.inert = {3, 3}; });
  ExpectFault("triangle 4 can never be hit", [](SceneGeometry& g) { g.inert = {3}; });
  ExpectFault("triangle 3 can never be hit", [](SceneGeometry& g) { g.inert = {4}; });
  ExpectFault("triangle 0 can be hit", [](SceneGeometry& g) { g.inert = {0, 3, 4}; });
}

TEST_F(GeometryValidationTest, Report) {
  ExpectFault("report", [](SceneGeometry& g) { ++g.report.triangles; });
  ExpectFault("report", [](SceneGeometry& g) { ++g.report.vertices; });
  ExpectFault("report", [](SceneGeometry& g) { ++g.report.non_finite_vertices; });
  ExpectFault("report", [](SceneGeometry& g) { ++g.report.non_finite_triangles; });
  ExpectFault("report", [](SceneGeometry& g) { ++g.report.zero_area_triangles; });
  ExpectFault("report", [](SceneGeometry& g) { ++g.report.inert_triangles; });
  ExpectFault("report", [](SceneGeometry& g) { g.report.duplicate_triangles = 4; });
}

TEST_F(GeometryValidationTest, CanBeCancelled) {
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_EQ(ValidateGeometry(geometry_, &cancel).code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace sightline
