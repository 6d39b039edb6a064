// SPDX-License-Identifier: Apache-2.0
//
// Mountains, 8 km × 8 km around the origin: one sheet, heights of some 100 to 1900 m.
#include <algorithm>

#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"

namespace sightline {
namespace {

constexpr double kHalf = 4000;

double Height(double x, double y, uint64_t seed) {
  const Vec3d p{x / 2600, y / 2600, 0.5};
  // Where the coordinates are bent, ridges wind.
  const double bend_x = 0.35 * Fbm(p * 1.3, 3, seed + 1), bend_y = 0.35 * Fbm(p * 1.3, 3, seed + 2);
  const Vec3d q{p.x + bend_x, p.y + bend_y, 0.5};
  const double high = SmoothStep(-0.35, 0.45, Fbm(p * 0.8, 2, seed + 3));
  const double ridges = Ridged(q, 9, seed);
  const double hills = Fbm(q * 3, 7, seed + 4);
  return 150 + 1900 * ridges * ridges * (0.25 + 0.75 * high) + 60 * hills;
}

Vec3d Above(double x, double y, double clearance, uint64_t seed) {
  return {x, y, Height(x, y, seed) + clearance};
}

}  // namespace

void MakeTerrain(SceneBuilder& scene) {
  MeshBuilder& mesh = scene.Object("terrain");
  const int nx = scene.Steps(500, 8), ny = scene.Steps(500, 8);
  AddSheet(mesh, nx, ny, [&](int i, int j) {
    const double x = Lerp(-kHalf, kHalf, static_cast<double>(i) / nx);
    const double y = Lerp(-kHalf, kHalf, static_cast<double>(j) / ny);
    return Vec3d{x, y, Height(x, y, scene.seed())};
  });
}

std::vector<BuiltinView> TerrainViews(uint64_t seed) {
  return {
      MakeView(Above(-3300, -3000, 420, seed), Above(600, 300, 0, seed), 45,
               {Above(-3000, -3000, 1500, seed), Above(0, -2000, 500, seed), Above(3000, 1000, 100, seed)}, {200, 120, 330}, 60),
      MakeView(Above(2900, 900, 260, seed), Above(-800, 1500, 0, seed), 55,
               {Above(2000, 1000, 1500, seed), Above(0, 2000, 500, seed), Above(-3000, 1000, 100, seed)}, {200, 120, 330}, 60),
      MakeView(Above(-500, 3400, 900, seed), Above(200, 300, 0, seed), 60,
               {Above(0, 3000, 1500, seed), Above(0, 2000, 500, seed), Above(1000, -3000, 100, seed)}, {200, 120, 330}, 60),
  };
}

}  // namespace sightline
