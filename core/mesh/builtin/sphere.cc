// SPDX-License-Identifier: Apache-2.0
//
// One closed sphere of radius about 1 around the origin, with hills, ridges and craters: a cube's
// lattice pushed onto the surface, every edge shared by exactly two triangles.
#include <cmath>

#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"

namespace sightline {
namespace {

constexpr int kCraters = 60;

struct Crater {
  Vec3d center;
  double radius;  // As a chord on the unit sphere.
};

std::vector<Crater> Craters(uint64_t seed) {
  std::vector<Crater> craters;
  for (int i = 0; i < kCraters; ++i) {
    Prng rng(seed, "crater", static_cast<uint64_t>(i));
    const double z = rng.Uniform(-1, 1);
    const SinCos sc = SinCosTurns(rng.Uniform());
    const double rho = std::sqrt(1 - z * z), size = rng.Uniform();
    craters.push_back({{rho * sc.cos, rho * sc.sin, z}, 0.04 + 0.28 * size * size * size});
  }
  return craters;
}

// A bowl with a raised rim, as high as the crater is wide; 0 beyond 1.6 radii.
double CraterHeight(const Crater& crater, Vec3d direction) {
  const Vec3d d = direction - crater.center;
  const double x2 = Dot(d, d) / (crater.radius * crater.radius);
  if (x2 >= 1.6 * 1.6) return 0;
  const double bowl = x2 < 1 ? 0.28 * (x2 - 1) : 0.0;
  const double x = std::sqrt(x2);
  const double rim = 0.1 * SmoothStep(0.55, 1.0, x) * (1 - SmoothStep(1.0, 1.6, x));
  return crater.radius * (bowl + rim);
}

}  // namespace

void MakeSphere(SceneBuilder& scene) {
  MeshBuilder& mesh = scene.Object("sphere");
  const int n = scene.Steps(129, 4);
  const uint64_t seed = scene.seed();
  const std::vector<Crater> craters = Craters(seed);
  AddBall(mesh, {0, 0, 0}, n, [&](Vec3d d) {
    double height = 0.16 * Fbm(d * 1.6, 3, seed) + 0.05 * (Ridged(d * 3.1, 6, seed + 1) - 0.4);
    for (const Crater& crater : craters) height += CraterHeight(crater, d);
    return 1 + height;
  });
}

std::vector<BuiltinView> SphereViews(uint64_t) {
  return {
      MakeView({2.6, -2.2, 1.1}, {0, 0, 0}, 42,
               {{1.7, -3.3, 3.6}, {0.5, -2.3, -0.8}, {1.4, 4.1, 0.8}}, {310, 20, 240}, 0.1),
      MakeView({-1.6, -0.9, 1.2}, {-0.3, 0.1, 0.2}, 55,
               {{-1.4, -0.3, 1.6}, {-1, -3.1, -0.7}, {4.9, 0.4, 4.4}}, {210, 150, 280}, 0.1),
      MakeView({0.5, 1.9, -0.2}, {0.0, 0.3, 0.1}, 60,
               {{4.8, 3.2, -3.2}, {-1.4, 2, 2.5}, {4, -2.1, -2.3}}, {90, 40, 150}, 0.1),
  };
}

}  // namespace sightline
