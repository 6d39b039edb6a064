// SPDX-License-Identifier: Apache-2.0
//
// The views that come with the scenes: the camera stands free and sees something, and the three
// lights leave about 90, 50 and 10 % of what it sees lit.
#include <cmath>
#include <string>

#include "core/mesh/builtin/builtin.h"
#include "core/mesh/builtin/deterministic_math.h"
#include "core/mesh/builtin/prng.h"
#include "gtest/gtest.h"
#include "tests/core/mesh/builtin/ray_probe.h"

namespace sightline {
namespace {

constexpr double kFar = 1e9;

class BuiltinViews : public testing::TestWithParam<std::string> {};

struct Seen {
  int pixels = 0;
  std::vector<Vec3d> points;  // Off the surface, on the camera's side.
};

Seen Look(const RayProbe& probe, const BuiltinView& view) {
  constexpr int kWidth = 96, kHeight = 54;
  const Vec3d forward = Unit(view.at - view.eye), right = Unit(Cross(forward, view.up));
  const Vec3d up = Cross(right, forward);
  const double half = std::tan(view.fov_y_degrees / 360 * 3.141592653589793);
  Seen seen;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      ++seen.pixels;
      const double sx = ((2 * x + 1.0) / kWidth - 1) * half * kWidth / kHeight;
      const double sy = (1 - (2 * y + 1.0) / kHeight) * half;
      const Vec3d direction = forward + right * sx + up * sy;
      const auto hit = probe.Cast(view.eye, direction, kFar);
      if (!hit.has_value()) continue;
      // A 2^-20th of the way is far above the roundings of doubles, and too little to be seen.
      const double off = hit->t * 0x1p-20;
      seen.points.push_back(view.eye + direction * hit->t + Unit(hit->normal) * off);
    }
  }
  return seen;
}

TEST_P(BuiltinViews, SeeSomethingAndAreLitAsPromised) {
  const absl::StatusOr<BuiltinScene> scene = MakeBuiltin({GetParam(), 0, kDefaultBuiltinSeed});
  ASSERT_TRUE(scene.ok()) << scene.status();
  const RayProbe probe(scene->objects);
  ASSERT_EQ(scene->views.size(), 3u);
  for (size_t v = 0; v < 3; ++v) {
    SCOPED_TRACE("view " + std::to_string(v));
    const BuiltinView& view = scene->views[v];
    EXPECT_EQ(view.up, (Vec3d{0, 0, 1}));
    EXPECT_GT(view.fov_y_degrees, 30);
    EXPECT_LT(view.fov_y_degrees, 90);
    const Seen seen = Look(probe, view);
    EXPECT_GT(seen.points.size(), 0.25 * seen.pixels);
    // Within a tenth in the first view, within a fifth in the others.
    const double share[] = {0.9, 0.5, 0.1};
    ASSERT_EQ(view.lights.size(), 3u);
    for (size_t l = 0; l < 3; ++l) {
      double lit = 0;
      for (const Vec3d& p : seen.points)
        lit += probe.Cast(p, view.lights[l] - p, 1).has_value() ? 0 : 1;
      EXPECT_NEAR(lit / static_cast<double>(seen.points.size()), share[l], v == 0 ? 0.1 : 0.2)
          << "light " << l;
    }
    const double elevation[] = {60, 30, 8};
    ASSERT_EQ(view.suns.size(), 3u);
    for (size_t s = 0; s < 3; ++s) {
      EXPECT_NEAR(Length(view.suns[s]), 1, 0x1p-50);
      EXPECT_NEAR(view.suns[s].z, std::sin(elevation[s] / 180 * 3.141592653589793), 0x1p-50);
    }
    EXPECT_EQ(view.area.center, view.lights[1]);
    EXPECT_GT(Length(Cross(view.area.u, view.area.v)), 0);
  }
}

// Nothing within 0.1 m of a camera at the smallest and at a larger size, with another seed too (the
// sphere is 1 m wide, and nothing else stands near its cameras).
TEST_P(BuiltinViews, StandFree) {
  uint64_t least = 0;
  for (const BuiltinInfo& info : BuiltinScenes())
    least = info.name == GetParam() ? info.min_triangles : least;
  for (const BuiltinSpec& spec :
       {BuiltinSpec{GetParam(), least, 1}, BuiltinSpec{GetParam(), 3 * least, 2}}) {
    SCOPED_TRACE(std::to_string(spec.target_triangles) + " triangles, seed " +
                 std::to_string(spec.seed));
    const absl::StatusOr<BuiltinScene> scene = MakeBuiltin(spec);
    ASSERT_TRUE(scene.ok()) << scene.status();
    const RayProbe probe(scene->objects);
    for (size_t v = 0; v < scene->views.size(); ++v) {
      Prng rng(3, "directions", v);
      for (int i = 0; i < 2000; ++i) {
        const double z = rng.Uniform(-1, 1), rho = std::sqrt(1 - z * z);
        const SinCos sc = SinCosTurns(rng.Uniform());
        const auto hit = probe.Cast(scene->views[v].eye, {rho * sc.cos, rho * sc.sin, z}, 0.1);
        ASSERT_FALSE(hit.has_value()) << "view " << v << ", " << hit->t << " m away";
      }
      EXPECT_GT(Look(probe, scene->views[v]).points.size(), 1000u) << "view " << v;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, BuiltinViews,
                         testing::Values("hall", "room", "office", "plants", "city", "forest",
                                         "sphere", "terrain", "box"),
                         [](const auto& info) { return info.param; });

}  // namespace
}  // namespace sightline
