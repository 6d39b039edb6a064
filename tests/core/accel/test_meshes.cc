// SPDX-License-Identifier: Apache-2.0
#include "tests/core/accel/test_meshes.h"

#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "core/base/check.h"

namespace sightline::testing_support {
namespace {

using Corners = std::array<Vec3d, 3>;

SceneGeometry Compile(size_t n, const std::function<Corners(size_t)>& triangle) {
  ObjectInput object{.name = "mesh"};
  for (size_t i = 0; i < n; ++i) {
    for (const Vec3d& corner : triangle(i)) {
      object.indices.push_back(static_cast<uint32_t>(object.vertices.size()));
      object.vertices.push_back(corner);
    }
  }
  absl::StatusOr<SceneGeometry> geometry = CompileScene({&object, 1}, Vec3d{0, 0, 0}, {});
  SIGHTLINE_CHECK(geometry.ok()) << geometry.status();
  return *std::move(geometry);
}

Vec3d Point(TestRng& rng, double low, double high) {
  return {rng.Uniform(low, high), rng.Uniform(low, high), rng.Uniform(low, high)};
}

Corners Around(TestRng& rng, Vec3d centre, double size) {
  return {centre + Point(rng, -size, size), centre + Point(rng, -size, size),
          centre + Point(rng, -size, size)};
}

}  // namespace

SceneGeometry ScatteredTriangles(TestRng& rng, size_t n, double size) {
  return Compile(n, [&](size_t) { return Around(rng, Point(rng, 0, 1), size); });
}

std::vector<TestMesh> NastyMeshes(TestRng& rng, size_t n) {
  std::vector<TestMesh> meshes;
  meshes.push_back({"none", Compile(0, nullptr)});
  meshes.push_back({"one", Compile(1, [&](size_t) { return Around(rng, {}, 1); })});
  for (size_t few : {2u, 15u, 16u, 17u, 33u}) {
    meshes.push_back({"few", ScatteredTriangles(rng, few, 0.1)});
  }
  meshes.push_back({"small", ScatteredTriangles(rng, n, 0.01)});
  meshes.push_back({"large", ScatteredTriangles(rng, n, 1)});

  const Corners same = Around(rng, {}, 1);
  meshes.push_back({"identical", Compile(n, [&](size_t) { return same; })});
  // Their boxes differ, their boxes' centres do not.
  meshes.push_back({"concentric", Compile(n, [&](size_t i) {
                      const double s = 1 + static_cast<double>(i % 1000);
                      return Corners{Vec3d{-s, -s, -1}, Vec3d{s, s, 1}, Vec3d{-s, s, 0}};
                    })});
  meshes.push_back({"coplanar", Compile(n, [&](size_t) {
                      Corners t = Around(rng, Point(rng, 0, 1), 0.05);
                      for (Vec3d& corner : t) corner.z = 0.25;
                      return t;
                    })});
  meshes.push_back({"along a line", Compile(n, [&](size_t i) {
                      const double x = static_cast<double>(i);
                      return Corners{Vec3d{x, 0, 0}, Vec3d{x, 1, 0}, Vec3d{x, 0, 1}};
                    })});
  meshes.push_back({"needles", Compile(n, [&](size_t) {
                      const Vec3d a = Point(rng, 0, 1), b = Point(rng, 0, 1);
                      return Corners{a, b, b + Point(rng, -1e-6, 1e-6)};
                    })});
  // Each a fraction of the one before: splits peel one off at a time, so depth is at stake.
  meshes.push_back(
      {"geometric series", Compile(n, [&](size_t i) {
         const double s = std::ldexp(1.0, 40 - static_cast<int>(i % 160));
         return Corners{Vec3d{s, s / 2, 0}, Vec3d{s / 2, s, 0}, Vec3d{s / 2, s / 2, s / 4}};
       })});
  meshes.push_back({"scale ratio of 10^6", Compile(n, [&](size_t i) {
                      const double s = i % 2 == 0 ? 1e3 : 1e-3;
                      return Around(rng, Point(rng, 0, 1) * s, 0.1 * s);
                    })});
  meshes.push_back({"huge coordinates", Compile(n, [&](size_t) {
                      return Around(rng, Point(rng, -0x1p39, 0x1p39), 0x1p38);
                    })});
  meshes.push_back({"tiny coordinates",
                    Compile(n, [&](size_t) { return Around(rng, Point(rng, 0, 1e-40), 1e-41); })});
  meshes.push_back({"a third inert", Compile(n, [&](size_t i) {
                      Corners t = Around(rng, Point(rng, 0, 1), 0.1);
                      if (i % 6 == 1) t[2] = t[0];
                      if (i % 6 == 4) t[1].y = std::numeric_limits<double>::quiet_NaN();
                      return t;
                    })});
  meshes.push_back({"all inert", Compile(n, [&](size_t) { return Corners{}; })});
  return meshes;
}

}  // namespace sightline::testing_support
