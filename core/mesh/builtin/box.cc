// SPDX-License-Identifier: Apache-2.0
//
// After the Cornell box: 2 m along each side, open toward -y, with a lamp below the ceiling, a tall
// and a low block and a ball. Its walls share bit-equal vertices along their common edges.
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"

namespace sightline {

void MakeBox(SceneBuilder& scene) {
  // One lattice for all walls: u, v in steps of 2/n from -1.
  MeshBuilder& floor = scene.Object("floor");
  const int n = scene.Steps(16, 1);
  const auto line = [n](int i) { return Lerp(-1, 1, static_cast<double>(i) / n); };
  const auto level = [n](int i) { return Lerp(0, 2, static_cast<double>(i) / n); };
  AddSheet(floor, n, n, [&](int i, int j) { return Vec3d{line(i), line(j), 0}; });
  AddSheet(scene.Object("ceiling"), n, n, [&](int i, int j) {
    return Vec3d{line(i), line(n - j), 2};
  });
  AddSheet(scene.Object("wall-back"), n, n, [&](int i, int j) {
    return Vec3d{line(i), 1, level(j)};
  });
  AddSheet(scene.Object("wall-left"), n, n, [&](int i, int j) {
    return Vec3d{-1, line(i), level(j)};
  });
  AddSheet(scene.Object("wall-right"), n, n, [&](int i, int j) {
    return Vec3d{1, line(n - i), level(j)};
  });
  {
    MeshBuilder& open = scene.Object("lamp");
    AddBlock(open, ShapePlacement({0, 0, 1.97}), {0.28, 0.22, 0.012}, 0.006, scene.Steps(4, 1));
  }
  {
    MeshBuilder& open = scene.Object("block-tall");
    AddBlock(open, ShapePlacement({-0.36, 0.32, 0.6}, 0.05), {0.29, 0.29, 0.6}, 0.02,
             scene.Steps(9, 1));
  }
  {
    MeshBuilder& open = scene.Object("block-low");
    AddBlock(open, ShapePlacement({0.36, -0.28, 0.29}, -0.045), {0.29, 0.29, 0.29}, 0.02,
             scene.Steps(9, 1));
  }
  const uint64_t seed = scene.seed();
  {
    MeshBuilder& open = scene.Object("ball");
    AddBall(open, {0.36, -0.28, 0.58 + 0.23}, scene.Steps(15, 2), [&](Vec3d d) {
      return 0.23 - 0.02 * (1 + d.z) * (0.5 + 0.5 * GradientNoise(d * 3, seed));
    });
  }
}

std::vector<BuiltinView> BoxViews(uint64_t) {
  return {
      MakeView({0, -3.6, 1}, {0, 0, 1}, 40,
               {{-0.3, -0.5, 1.6}, {-0.75, 0.85, 0.85}, {0.082, -0.02, 1.986}}, {275, 260, 265},
               0.1),
      MakeView({0.75, -0.85, 1.65}, {-0.35, 0.5, 0.4}, 65,
               {{0.4, 0.15, 1.6}, {0.75, 0.05, 0.4}, {0.65, -0.5, 0.25}}, {275, 260, 265}, 0.1),
      MakeView({-0.85, -0.6, 0.35}, {0.4, 0.1, 0.7}, 70,
               {{-0.75, -0.15, 1.4}, {0.15, 0.15, 0.95}, {-0.8, 0.9, 0.75}}, {275, 260, 265}, 0.1),
  };
}

}  // namespace sightline
