// SPDX-License-Identifier: Apache-2.0
//
// A clearing in a mixed forest: 160 m × 160 m of hilly ground around the origin, conifers,
// broad-leaved trees, ferns, stones and fallen trunks. The ground is near z = 0.
#include <algorithm>
#include <vector>

#include "core/mesh/builtin/furniture.h"
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"
#include "core/mesh/builtin/vegetation.h"

namespace sightline {
namespace {

constexpr double kHalf = 80;

double Ground(double x, double y, uint64_t seed) {
  const double hills = 5.0 * Fbm({x / 60, y / 60, 0.5}, 4, seed);
  const double rough = 0.25 * Fbm({x / 3, y / 3, 7.5}, 3, seed);
  const double rim = (x * x + y * y) / (kHalf * kHalf);
  return hills + rough + 3.0 * rim;
}

Vec3d Above(double x, double y, double clearance, uint64_t seed) {
  return {x, y, Ground(x, y, seed) + clearance};
}

void MakeTree(SceneBuilder& scene, int index, Vec3d at, Prng& rng) {
  const bool conifer = rng.Uniform() < 0.55;
  const bool young = rng.Uniform() < 0.25;
  const double height = (young ? 0.4 : 1.0) * (conifer ? rng.Uniform(15, 25) : rng.Uniform(11, 18));
  const TreeShape shape = {.height = height,
                           .crown_radius = conifer ? 0.19 * height : 0.36 * height,
                           .trunk_radius = 0.017 * height,
                           .conifer = conifer,
                           .branches = conifer ? scene.Items(60, 6, 26) : scene.Items(30, 4, 11),
                           .twigs = conifer ? 4 : scene.Items(18, 1, 6)};
  std::vector<Twig> twigs;
  const ShapePlacement place(at, rng.Uniform());
  AddWood(scene, scene.Object("tree", index), place, shape, rng, &twigs);
  MeshBuilder& leaves = scene.Object(conifer ? "needles" : "leaves", index);
  const double area = (conifer ? 1.9 : 3.2) * shape.crown_radius * height;
  // Near the middle of the clearing leaves are looked at from close by: there are more of them.
  const double near = 1 + 2.5 / (1 + (at.x * at.x + at.y * at.y) / 600);
  AddLeaves(leaves, twigs,
            {.count = scene.Swarm((conifer ? 1500 : 1300) * near * (young ? 0.4 : 1.0), 40),
             .area = area,
             .slenderness = conifer ? 7.0 : 1.7,
             .max_length = 0.05 * height,
             .spread = conifer ? 0.1 : 0.25,
             .cells = 0},
            rng);
}

void MakeUndergrowth(SceneBuilder& scene, FloorPlan& plan) {
  const uint64_t seed = scene.seed();
  const int ferns = scene.Items(110, 30, 700);
  for (int i = 0; i < ferns; ++i) {
    Prng rng(seed, "forest-fern", static_cast<uint64_t>(i));
    const double half = i % 3 == 0 ? 60 : 22;
    Vec3d at;
    if (!plan.Place(rng, {-half, -half, 0}, {half, half, 0}, 0.5, &at)) continue;
    const ShapePlacement foot(Above(at.x, at.y, -0.02, seed), rng.Uniform());
    {
      MeshBuilder& open = scene.Object("fern", i);
      AddFern(open, foot, rng.Uniform(0.4, 1.0), 9, scene.Items(8, 5, 60), scene.Steps(0.3, 0),
              rng);
    }
  }
  const int stones = scene.Items(60, 20, 300);
  for (int i = 0; i < stones; ++i) {
    Prng rng(seed, "forest-stone", static_cast<uint64_t>(i));
    const double u = rng.Uniform();
    const double r = 0.15 + 1.3 * u * u * u;
    Vec3d at;
    if (!plan.Place(rng, {-45, -45, 0}, {45, 45, 0}, r, &at)) continue;
    const uint64_t shape = rng.Next();
    {
      MeshBuilder& open = scene.Object("stone", i);
      AddBall(open, Above(at.x, at.y, 0.1 * r, seed), scene.Steps(5 + 5 * r, 2), [&](Vec3d d) {
        return r * (1 + 0.55 * Fbm(d * 1.3, 5, shape)) * (0.75 + 0.25 * (1 - d.z * d.z));
      });
    }
  }
  for (int i = 0; i < 7; ++i) {
    Prng rng(seed, "forest-log", static_cast<uint64_t>(i));
    Vec3d at;
    if (!plan.Place(rng, {-30, -30, 0}, {30, 30, 0}, 1.5, &at)) continue;
    const SinCos sc = SinCosTurns(rng.Uniform());
    const double length = rng.Uniform(4, 9), radius = rng.Uniform(0.15, 0.32);
    constexpr int kJoints = 12;
    std::vector<Joint> joints;
    for (int k = 0; k <= kJoints; ++k) {
      const double s = length * (k / 12.0 - 0.5);
      joints.push_back({Above(at.x + s * sc.cos, at.y + s * sc.sin, 0.6 * radius, seed),
                        radius * (1.1 - 0.03 * k)});
    }
    {
      MeshBuilder& open = scene.Object("log", i);
      AddTube(open, joints, scene.Steps(12, 5));
    }
  }
}

// Tufts of grass on the clearing, a few objects of many blades.
void MakeGrass(SceneBuilder& scene) {
  const uint64_t seed = scene.seed();
  for (int patch = 0; patch < 16; ++patch) {
    MeshBuilder& mesh = scene.Object("grass", patch);
    const int blades = scene.Swarm(2600, 60);
    if (mesh.counting()) {
      mesh.Begin(0, blades * LeafTriangles(0));
      continue;
    }
    Prng rng(seed, "forest-grass", static_cast<uint64_t>(patch));
    const int column = patch % 4, row = patch / 4;
    for (int i = 0; i < blades; ++i) {
      const double x = -22 + 11 * column + rng.Uniform(0, 11);
      const double y = -22 + 11 * row + rng.Uniform(0, 11);
      const SinCos sc = SinCosTurns(rng.Uniform());
      const double lean = rng.Uniform(0.1, 0.7);
      const double length = rng.Uniform(0.12, 0.4);
      AddLeaf(mesh, Above(x, y, -0.02, seed), Unit({lean * sc.cos, lean * sc.sin, 1}),
              {-sc.sin, sc.cos, 0}, {length, 0.02, 0.25, 0.2}, 0);
    }
  }
}

}  // namespace

void MakeForest(SceneBuilder& scene) {
  const uint64_t seed = scene.seed();
  MeshBuilder& ground = scene.Object("ground");
  const int nx = scene.Steps(130, 16), ny = scene.Steps(130, 16);
  AddSheet(ground, nx, ny, [&](int i, int j) {
    const double x = Lerp(-kHalf, kHalf, static_cast<double>(i) / nx);
    const double y = Lerp(-kHalf, kHalf, static_cast<double>(j) / ny);
    return Vec3d{x, y, Ground(x, y, seed)};
  });
  FloorPlan plan;
  // The cameras stand free, and so does the middle of the clearing.
  plan.Reserve(-14, -20, 5);
  plan.Reserve(24, 6, 5.5);
  plan.Reserve(0, 0, 8);
  plan.Reserve(-7, -10, 5);
  plan.Reserve(12, 3, 5);
  constexpr int kTrees = 230;
  for (int i = 0; i < kTrees; ++i) {
    Prng rng(seed, "forest-tree", static_cast<uint64_t>(i));
    Vec3d at;
    if (!plan.Place(rng, {-74, -74, 0}, {74, 74, 0}, 2.4, &at)) continue;
    MakeTree(scene, i, Above(at.x, at.y, -0.15, seed), rng);
  }
  MakeUndergrowth(scene, plan);
  MakeGrass(scene);
}

std::vector<BuiltinView> ForestViews(uint64_t seed) {
  return {
      MakeView(
          Above(-14, -20, 2.0, seed), Above(4, 8, 4.5, seed), 60,
          {Above(-14.5, -21, 2, seed), Above(-33.5, 22, 35.5, seed), Above(16, 50.5, 7.5, seed)},
          {200, 120, 330}, 0.8),
      MakeView(
          Above(24, 6, 1.7, seed), Above(-6, -2, 4, seed), 58,
          {Above(22.5, 4.5, 2.5, seed), Above(9, -65, 50.5, seed), Above(20, -53.5, 9.5, seed)},
          {200, 120, 330}, 0.8),
      MakeView(
          Above(-70, -75, 48, seed), Above(5, 5, 2, seed), 50,
          {Above(-68.5, -75, 47.5, seed), Above(-15, -26.5, 56, seed), Above(16, 50.5, 7.5, seed)},
          {200, 120, 330}, 0.8),
  };
}

}  // namespace sightline
