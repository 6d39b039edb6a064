// SPDX-License-Identifier: Apache-2.0
//
// Potted plants of seven kinds on a floor and on benches, in front of a curved backdrop; the floor
// is z = 0.
#include <cmath>

#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/shapes.h"
#include "core/mesh/builtin/vegetation.h"

namespace sightline {
namespace {

struct Potted {
  Vec3d at;
  PlantKind kind;
  double height, pot_radius, pot_height;
};

constexpr Potted kPlants[] = {
    {{-1.75, 1.05, 0}, PlantKind::kTree, 1.6, 0.26, 0.42},
    {{1.8, 1.1, 0}, PlantKind::kTree, 1.35, 0.24, 0.4},
    {{0.1, 1.3, 0.0}, PlantKind::kBroadLeaves, 1.35, 0.27, 0.42},
    {{-0.9, 0.55, 0.45}, PlantKind::kFern, 0.55, 0.17, 0.26},
    {{0.0, 0.5, 0.45}, PlantKind::kCactus, 0.6, 0.15, 0.2},
    {{0.75, 0.55, 0.45}, PlantKind::kTrailing, 0.6, 0.15, 0.24},
    {{1.15, -0.15, 0}, PlantKind::kBlades, 0.85, 0.17, 0.28},
    {{-1.55, -0.05, 0}, PlantKind::kBroadLeaves, 0.65, 0.17, 0.26},
    {{-0.75, -0.3, 0}, PlantKind::kRosette, 0.3, 0.18, 0.18},
    {{0.35, -0.35, 0}, PlantKind::kFern, 0.42, 0.16, 0.22},
    {{1.8, -0.5, 0}, PlantKind::kRosette, 0.2, 0.12, 0.13},
    {{-0.15, -0.75, 0}, PlantKind::kCactus, 0.28, 0.1, 0.12},
    {{-1.4, -0.8, 0}, PlantKind::kBlades, 0.42, 0.11, 0.16},
    {{0.95, -0.9, 0}, PlantKind::kRosette, 0.13, 0.09, 0.13},
};

void MakeStage(SceneBuilder& scene) {
  // A floor that bends up into a wall, so that there is no horizon.
  const int across = scene.Steps(12, 2), along = scene.Steps(30, 8);
  AddSheet(scene.Object("backdrop"), across, along, [&](int i, int j) {
    const double s = Lerp(0, 11.4, static_cast<double>(j) / along);  // Metres along the curve.
    const double x = Lerp(-9, 9, static_cast<double>(i) / across);
    constexpr double kLevel = 5.4, kRadius = 1.2, kArc = 0.25 * 6.283185307179586 * kRadius;
    if (s <= kLevel) return Vec3d{x, -3.4 + s, 0};
    if (s >= kLevel + kArc) return Vec3d{x, -3.4 + kLevel + kRadius, kRadius + s - kLevel - kArc};
    const SinCos sc = SinCosTurns((s - kLevel) / kArc * 0.25);
    return Vec3d{x, -3.4 + kLevel + kRadius * sc.sin, kRadius * (1 - sc.cos)};
  });
  MeshBuilder& bench = scene.Object("bench");
  const int n = scene.Steps(5, 1);
  for (int i = 0; i < 3; ++i) {
    AddBlock(bench, ShapePlacement({-0.05, 0.36 + 0.17 * i, 0.425}), {1.35, 0.075, 0.025}, 0.012,
             n);
  }
  for (double x : {-1.2, 1.1}) {
    for (double y : {0.36, 0.7})
      AddBlock(bench, ShapePlacement({x, y, 0.2}), {0.04, 0.04, 0.2}, 0.012, n);
    AddBlock(bench, ShapePlacement({x, 0.53, 0.37}), {0.03, 0.13, 0.03}, 0.012, n);
  }
  MeshBuilder& can = scene.Object("watering-can");
  const ShapePlacement at({-2.15, -0.75, 0}, 0.1);
  const int round = scene.Steps(26, 6), fine = scene.Steps(2, 1);
  AddLathe(can, at,
           {{0.14, 0},
            {0.145, 0.02},
            {0.14, 0.15},
            {0.12, 0.26},
            {0.07, 0.3},
            {0.065, 0.295},
            {0.115, 0.25},
            {0.13, 0.04}},
           round, fine);
  const Joint spout[] = {{at.At({0.1, 0, 0.07}), 0.03},
                         {at.At({0.22, 0, 0.14}), 0.022},
                         {at.At({0.32, 0, 0.27}), 0.018},
                         {at.At({0.36, 0, 0.32}), 0.045}};
  AddTube(can, spout, scene.Steps(12, 4));
  Joint handle[9];
  for (int i = 0; i < 9; ++i) {
    const SinCos sc = SinCosTurns(Lerp(0.07, 0.52, i / 8.0));
    handle[i] = {at.At({-0.1 + 0.15 * sc.cos, 0, 0.2 + 0.17 * sc.sin}), 0.011};
  }
  AddTube(can, handle, scene.Steps(9, 4));
}

}  // namespace

void MakePlants(SceneBuilder& scene) {
  MakeStage(scene);
  int index = 0;
  for (const Potted& p : kPlants) {
    Prng rng(scene.seed(), "plants", static_cast<uint64_t>(index));
    const ShapePlacement at(p.at, rng.Uniform());
    AddPot(scene, scene.Object("pot", index), at, p.pot_radius, p.pot_height);
    const double root = (p.kind == PlantKind::kTrailing ? 0.98 : 0.83) * p.pot_height;
    AddPlant(scene, scene.Object("plant", index), at.Moved({0, 0, root}), p.kind, p.height, rng);
    ++index;
  }
}

std::vector<BuiltinView> PlantsViews(uint64_t) {
  return {
      MakeView({0.4, -3.3, 1.7}, {0, 0.5, 0.65}, 48,
               {{0.9, -3.2, 1.9}, {-1.25, 1.8, 0.9}, {0.33, 0.38, 0.47}}, {240, 290, 200}, 0.15),
      MakeView({-2.6, -2.0, 1.0}, {0.2, 0.4, 0.6}, 52,
               {{-2.75, -2.6, 0.9}, {-3, 1.55, 0.4}, {0.44, 0.69, 0.47}}, {240, 290, 200}, 0.15),
      MakeView({1.9, -1.7, 0.75}, {0.3, 0.7, 0.7}, 50,
               {{2.4, -2.15, 0.95}, {-0.6, 0.5, 1.9}, {-0.06, 0.37, 0.49}}, {240, 290, 200}, 0.15),
  };
}

}  // namespace sightline
