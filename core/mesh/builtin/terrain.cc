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
  const double u = x / 2600, v = y / 2600;
  // Where the coordinates are bent, ridges wind.
  const double bend_u = 0.35 * Fbm2(u * 1.3, v * 1.3, 2, seed + 1);
  const double bend_v = 0.35 * Fbm2(u * 1.3, v * 1.3, 2, seed + 2);
  const double high = SmoothStep(-0.35, 0.45, Fbm2(u * 0.8, v * 0.8, 2, seed + 3));
  const double ridges = Ridged2(u + bend_u, v + bend_v, 9, seed);
  const double hills = Fbm2((u + bend_u) * 3, (v + bend_v) * 3, 4, seed + 4);
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
               {Above(-1710, -3320, 1810, seed), Above(-3090, 1920, 2370, seed),
                Above(2570, 1500, 2430, seed)},
               {200, 120, 330}, 60),
      MakeView(Above(2900, 900, 260, seed), Above(-800, 1500, 0, seed), 55,
               {Above(140, -620, 2230, seed), Above(-1430, -2810, 1720, seed),
                Above(580, -2580, 600, seed)},
               {200, 120, 330}, 60),
      MakeView(Above(-500, 3400, 900, seed), Above(200, 300, 0, seed), 60,
               {Above(700, 3580, 1700, seed), Above(1040, -1690, 2340, seed),
                Above(-3080, -3640, 900, seed)},
               {200, 120, 120}, 60),
  };
}

}  // namespace sightline
