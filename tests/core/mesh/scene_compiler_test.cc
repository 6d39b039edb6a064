// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/scene_compiler.h"

#include <pmmintrin.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

ObjectInput OneTriangle(const std::string& name, double x, bool dynamic = false) {
  return {.name = name,
          .vertices = {{x, 0, 0}, {x + 0.1, 0, 0}, {x, 0.3, 0}},
          .indices = {0, 1, 2},
          .dynamic = dynamic};
}

class SceneCompilerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ObjectInput flat = OneTriangle("flat", 40);
    flat.vertices[2] = flat.vertices[1];
    const std::vector<ObjectInput> objects = {OneTriangle("first", 1000.7), flat,
                                              OneTriangle("moving", 30, /*dynamic=*/true)};
    absl::StatusOr<SceneGeometry> base = CompileScene(objects, std::nullopt, {});
    ASSERT_TRUE(base.ok()) << base.status();
    base_ = *std::move(base);
  }
  absl::StatusOr<SceneGeometry> Compile(const std::vector<ObjectSource>& sources) {
    return CompileSources(sources, &base_, std::nullopt, {}, nullptr);
  }
  SceneGeometry base_;
};

// Refused by the counts alone, whatever the limits say: no such array is made.
TEST_F(SceneCompilerTest, MoreThanAnySceneHasAreRefused) {
  const auto expect = [this](const std::vector<ObjectSource>& sources, const char* message) {
    const MeshLimits limits = {.max_triangles = uint64_t{1} << 40,
                               .max_vertices = uint64_t{1} << 40};
    const auto status = CompileSources(sources, &base_, std::nullopt, limits, nullptr).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_THAT(std::string(status.message()), HasSubstr(message));
  };
  base_.objects[0].vertex_count = kMaxGeometryItems - 4;
  expect({{.base_object = 0}, {.base_object = 1}, {.base_object = 2}},
         "715827884 vertices; max_vertices is 715827882: split it");
  base_.objects[0].triangle_count = kMaxGeometryItems + 1;
  expect({{.base_object = 0}}, "715827883 triangles; max_triangles is 715827882: split it");
}

TEST_F(SceneCompilerTest, KeptObjectsKeepTheirFloatsIdsMoveUp) {
  const ObjectInput added = OneTriangle("added", 7);
  const auto next = Compile({{.base_object = 1}, {.base_object = 0}, {.input = &added}});
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_EQ(next->origin, base_.origin);
  EXPECT_THAT(next->inert, ElementsAre(0));
  EXPECT_EQ(next->report.zero_area_triangles, 1u);
  EXPECT_EQ(next->Corners(1), base_.Corners(0));
  EXPECT_EQ(next->triangles[1], (std::array<uint32_t, 3>{3, 4, 5}));
  EXPECT_EQ(next->Corners(2)[0], ToFloat(added.vertices[0] - base_.origin));
  EXPECT_EQ(next->objects[1].name, "first");
  // Rounding is reported although the doubles of a kept object are gone.
  EXPECT_EQ(next->objects[1].largest_rounding, base_.objects[0].largest_rounding);
}

TEST_F(SceneCompilerTest, ANewTransformUsesTheKeptDoubles) {
  Affine3d transform;
  transform.m[3] = 1.0 / 3.0;
  const auto next = Compile({{.base_object = 2, .transform = &transform}});
  ASSERT_TRUE(next.ok()) << next.status();
  const Vec3d local{30, 0, 0};
  EXPECT_EQ(next->Corners(0)[0], ToFloat(transform.Apply(local) - base_.origin));
  EXPECT_EQ(next->objects[0].transform, transform);
  // Shared with the base, not copied.
  EXPECT_EQ(next->objects[0].source_vertices, base_.objects[2].source_vertices);
}

// Among vertices that are placed many at a time: each as if it were alone, and the first fault is
// the one that is named.
TEST_F(SceneCompilerTest, FaultsAndNonFiniteVerticesAmongMany) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  ObjectInput input{.name = "many", .indices = {0, 1, 2}};
  for (int i = 0; i < 300; ++i) input.vertices.push_back({i / 3.0, -0.0, i * i / 7.0});
  input.vertices[63].y = kNan;
  input.vertices[64].z = -std::numeric_limits<double>::infinity();
  for (const bool moved : {false, true}) {
    if (moved) input.transform.m[3] = 0.1;
    const absl::StatusOr<SceneGeometry> one = CompileScene({&input, 1}, Vec3d{1, 0, 3}, {});
    ASSERT_TRUE(one.ok()) << one.status();
    EXPECT_EQ(one->report.non_finite_vertices, 2u);
    double rounding = 0;
    for (size_t i = 0; i < input.vertices.size(); ++i) {
      if (!IsFinite(input.vertices[i])) {
        EXPECT_TRUE(std::isnan(one->vertices[i].x)) << i;
        continue;
      }
      const Vec3d world = input.transform.Apply(input.vertices[i]);
      const Vec3f stored = ToFloat(world - Vec3d{1, 0, 3});
      EXPECT_EQ(one->vertices[i], stored) << i;
      EXPECT_FALSE(std::signbit(one->vertices[i].y) && one->vertices[i].y == 0);
      rounding = std::max(rounding, MaxAbs(world - (Vec3d{1, 0, 3} + ToDouble(stored))));
    }
    EXPECT_EQ(one->report.largest_rounding, rounding);
  }
  // In bounds from an origin far out, but not in the world.
  ObjectInput far = OneTriangle("far", 0x1.2p40);
  EXPECT_FALSE(CompileScene({&far, 1}, Vec3d{0x1p39, 0, 0}, {}).ok());
  input.vertices[250].x = 1e15;
  input.vertices[131].x = -1e15;
  const absl::StatusOr<SceneGeometry> bad = CompileScene({&input, 1}, Vec3d{1, 2, 3}, {});
  EXPECT_THAT(bad.status().message(), HasSubstr("vertex 131"));
}

TEST_F(SceneCompilerTest, MovedVerticesAreLocal) {
  const std::vector<Vec3d> moved = {{1, 2, 3}, {4, 5, 6}, {7, 8, 10}};
  const auto next =
      Compile({{.base_object = 0, .vertices = &moved}, {.base_object = 2, .vertices = &moved}});
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_EQ(next->Corners(0)[2], ToFloat(moved[2] - base_.origin));
  EXPECT_EQ(next->objects[0].source_vertices, nullptr);
  ASSERT_NE(next->objects[1].source_vertices, nullptr);
  EXPECT_EQ(*next->objects[1].source_vertices, moved);
  EXPECT_EQ(next->report.duplicate_triangles, 1u);

  const std::vector<Vec3d> few(2);
  const absl::Status status = Compile({{.base_object = 0, .vertices = &few}}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), HasSubstr("3 vertices, but 2 were given"));
}

TEST_F(SceneCompilerTest, ReplacementsApplyToNewObjectsToo) {
  const ObjectInput added = OneTriangle("added", 7, /*dynamic=*/true);
  Affine3d transform;
  transform.m[7] = 2;
  const std::vector<Vec3d> moved = {{1, 2, 3}, {4, 5, 6}, {7, 8, 10}};
  const auto next = Compile({{.input = &added, .transform = &transform, .vertices = &moved}});
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_EQ(next->Corners(0)[0], ToFloat(Vec3d{1, 4, 3} - base_.origin));
  EXPECT_EQ(*next->objects[0].source_vertices, moved);
}

// The state of a host program's thread: what is compiled is the same to the bit.
TEST(SceneCompilerModeTest, CompilesAlikeInEveryStateOfTheCaller) {
  // Placed by a matrix whose products are all rounded; with denormal floats on both sides of the
  // origin, in more triangles than one block of the loops has.
  ObjectInput moved = OneTriangle("moved", 1000.7);
  moved.transform.m = {0.1, 0.7, 0.3, 0.123, 0.9, 0.2, 0.6, 4.567, 0.3, 0.8, 0.4, 8.901};
  ObjectInput tiny{.name = "tiny"};
  for (uint32_t i = 0; i < 120'000; ++i) {
    tiny.vertices.push_back({(i % 7 - 3.0) * 1e-40, (i % 11 - 5.0) * 1e-40, i * 1e-44});
    if (i % 3 == 2) tiny.indices.insert(tiny.indices.end(), {i - 2, i - 1, i});
  }
  const auto compile = [](const ObjectInput& object, unsigned state) {
    const std::vector<ObjectInput> objects = {object};
    const unsigned saved = _mm_getcsr();
    _mm_setcsr(saved | state);
    absl::StatusOr<SceneGeometry> geometry = CompileScene(objects, std::nullopt, {});
    _mm_setcsr(saved);
    EXPECT_TRUE(geometry.ok()) << geometry.status();
    return *std::move(geometry);
  };
  for (const ObjectInput& object : {moved, tiny}) {
    const SceneGeometry expected = compile(object, 0);
    for (const unsigned state :
         {unsigned{_MM_ROUND_UP}, unsigned{_MM_ROUND_DOWN},
          unsigned{_MM_FLUSH_ZERO_ON | _MM_DENORMALS_ZERO_ON},
          unsigned{_MM_ROUND_UP | _MM_FLUSH_ZERO_ON | _MM_DENORMALS_ZERO_ON}}) {
      const SceneGeometry geometry = compile(object, state);
      // By their bits: a comparison would not tell a denormal from zero if it flushed, too.
      // NOLINTBEGIN(bugprone-suspicious-memory-comparison)
      EXPECT_EQ(std::memcmp(&geometry.origin, &expected.origin, sizeof(Vec3d)), 0) << state;
      EXPECT_EQ(std::memcmp(&geometry.bounds, &expected.bounds, sizeof(Box3f)), 0) << state;
      // NOLINTEND(bugprone-suspicious-memory-comparison)
      ASSERT_EQ(geometry.vertices.size(), expected.vertices.size());
      EXPECT_EQ(std::memcmp(std::as_const(geometry).vertices.data(),
                            std::as_const(expected).vertices.data(),
                            expected.vertices.size() * sizeof(Vec3f)),
                0)
          << state;
      EXPECT_EQ(geometry.inert, expected.inert) << state;
      EXPECT_EQ(std::bit_cast<uint64_t>(geometry.report.largest_rounding),
                std::bit_cast<uint64_t>(expected.report.largest_rounding))
          << state;
    }
  }
}

}  // namespace
}  // namespace sightline
