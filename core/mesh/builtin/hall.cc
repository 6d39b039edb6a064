// SPDX-License-Identifier: Apache-2.0
//
// A columned hall, 40 m long (x), with a nave under a barrel vault that is open along its crown,
// two aisles with windows, tables, chairs, crates, balls, vases and chandeliers. The floor is z =
// 0.
#include <algorithm>
#include <string>

#include "core/mesh/builtin/furniture.h"
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"

namespace sightline {
namespace {

constexpr double kHalfLength = 20, kAisle = 9, kNave = 4.4, kBay = 4, kSpring = 5.2, kVault = 8.2;
constexpr int kBays = 10;
const ShapePlacement kHall({0, 0, 0});

// A slab that spans `from`..`to` of half a turn about (y = 0, z = kVault), from x0 to x1.
void AddVaultBand(SceneBuilder& scene, MeshBuilder& mesh, double x0, double x1, double from,
                  double to, double inner, double outer) {
  const int around = scene.Steps(60 * (to - from) + 1, 2);
  AddSolid(mesh, 1, around, 1, [&](int i, int j, int k) {
    // Angles fall as j grows, so that (x, along, outward) is right-handed.
    const SinCos sc = SinCosTurns(Lerp(to, from, static_cast<double>(j) / around));
    const double r = k == 0 ? inner : outer;
    return Vec3d{i == 0 ? x0 : x1, r * sc.cos, kVault + r * sc.sin};
  });
}

// The wall piece above one arch: from the arch's curve up to a level line.
void AddArch(SceneBuilder& scene, MeshBuilder& mesh, double x, double y) {
  const int around = scene.Steps(14, 4), up = scene.Steps(3, 1);
  AddSolid(mesh, around, 1, up, [&](int i, int j, int k) {
    const SinCos sc = SinCosTurns(0.5 - 0.5 * i / around);
    const double t = static_cast<double>(k) / up;
    const double low_x = 1.68 * sc.cos, low_z = kSpring + 1.68 * sc.sin;
    return Vec3d{x + Lerp(low_x, 2 * sc.cos, t), y + (j - 0.5) * 0.7, Lerp(low_z, 7.3, t)};
  });
}

void MakeWalls(SceneBuilder& scene) {
  {
    MeshBuilder& open = scene.Object("floor");
    AddBox(open, kHall, {-kHalfLength, -kAisle, -0.3}, {kHalfLength, kAisle, 0}, scene.Steps(20, 1),
           scene.Steps(9, 1), 1);
  }
  for (double side : {-1.0, 1.0}) {
    const std::string name = side < 0 ? "wall-south" : "wall-north";
    const double y0 = side < 0 ? -kAisle - 0.6 : kAisle, y1 = y0 + 0.6;
    MeshBuilder& wall = scene.Object(name);
    const int n = scene.Steps(10, 1);
    AddBox(wall, kHall, {-kHalfLength, y0, 0}, {kHalfLength, y1, 1.6}, n, 1, 2);
    AddBox(wall, kHall, {-kHalfLength, y0, 5.2}, {kHalfLength, y1, 7.3}, n, 1, 2);
    for (int i = 0; i <= kBays; ++i) {
      const double x = -kHalfLength + kBay * i;
      AddBox(wall, kHall, {std::max(x - 1.1, -kHalfLength), y0, 1.6},
             {std::min(x + 1.1, kHalfLength), y1, 5.2}, 1, 1, scene.Steps(3, 1));
      if (i < kBays) {  // A mullion and a transom in every window.
        AddBox(wall, kHall, {x + 1.96, y0 + 0.25, 1.6}, {x + 2.04, y0 + 0.35, 5.2});
        AddBox(wall, kHall, {x + 1.1, y0 + 0.27, 3.6}, {x + 2.9, y0 + 0.33, 3.66});
      }
    }
    MeshBuilder& roof = scene.Object(side < 0 ? "aisle-roof-south" : "aisle-roof-north");
    const double in = side * (kNave - 0.35), out = side * (kAisle + 0.6);
    AddBox(roof, kHall, {-kHalfLength, std::min(in, out), 7.3},
           {kHalfLength, std::max(in, out), 7.5}, n, n, 1);
    MeshBuilder& attic = scene.Object(side < 0 ? "attic-south" : "attic-north");
    AddBox(attic, kHall, {-kHalfLength, side * kNave - 0.35, 7.5},
           {kHalfLength, side * kNave + 0.35, kVault + 0.3}, n, 1, 1);
    AddBox(attic, kHall, {-kHalfLength, side * (kNave - 0.35) - 0.08, 7.6},
           {kHalfLength, side * (kNave - 0.35) + 0.08, 7.75}, n, 1, 1);
  }
  for (double side : {-1.0, 1.0}) {
    MeshBuilder& end = scene.Object(side < 0 ? "wall-west" : "wall-east");
    const double x0 = side < 0 ? -kHalfLength - 0.6 : kHalfLength, x1 = x0 + 0.6;
    const int n = scene.Steps(6, 1);
    AddBox(end, kHall, {x0, -kAisle - 0.6, 0}, {x1, -1.4, 7.5}, 1, n, n);
    AddBox(end, kHall, {x0, 1.4, 0}, {x1, kAisle + 0.6, 7.5}, 1, n, n);
    AddBox(end, kHall, {x0, -1.4, 4.2}, {x1, 1.4, 7.5}, 1, n, n);
    AddBox(end, kHall, {x0, -1.4, -0.3}, {x1, 1.4, 0}, 1, n, 1);
    // The gable under the vault.
    const int around = scene.Steps(30, 6);
    AddSolid(end, 1, around, 2, [&](int i, int j, int k) {
      const SinCos sc = SinCosTurns(0.5 - 0.5 * j / around);
      const double y = (kNave + 0.2) * sc.cos;
      return Vec3d{i == 0 ? x0 : x1, y,
                   Lerp(7.5, kVault + 0.05 + (kNave + 0.15) * sc.sin, k / 2.0)};
    });
  }
}

void MakeVault(SceneBuilder& scene) {
  for (int i = 0; i < kBays; ++i) {
    MeshBuilder& panel = scene.Object("vault", i);
    const double x = -kHalfLength + kBay * i;
    if (i % 2 == 1) {  // Open along the crown.
      AddVaultBand(scene, panel, x, x + kBay, 0, 0.18, kNave, kNave + 0.2);
      AddVaultBand(scene, panel, x, x + kBay, 0.32, 0.5, kNave, kNave + 0.2);
    } else {
      AddVaultBand(scene, panel, x, x + kBay, 0, 0.5, kNave, kNave + 0.2);
    }
  }
  for (int i = 0; i <= kBays; ++i) {
    const double x = -kHalfLength + kBay * i;
    AddVaultBand(scene, scene.Object("rib", i), x - 0.18, x + 0.18, 0, 0.5, kNave - 0.25,
                 kNave + 0.1);
  }
}

void MakeColumns(SceneBuilder& scene) {
  for (int i = 0; i < 2 * (kBays - 1); ++i) {
    const int bay = 1 + i / 2;
    const double y = i % 2 == 0 ? -kNave : kNave;
    const double x = -kHalfLength + kBay * bay;
    MeshBuilder& mesh = scene.Object("column", i);
    const ShapePlacement foot({x, y, 0});
    AddBox(mesh, foot, {-0.55, -0.55, 0}, {0.55, 0.55, 0.25});
    AddLathe(mesh, foot,
             {{0.52, 0.25},
              {0.52, 0.34},
              {0.44, 0.42},
              {0.47, 0.5},
              {0.39, 0.6},
              {0.385, 1.6},
              {0.37, 3.0},
              {0.34, 4.3},
              {0.36, 4.4},
              {0.34, 4.5},
              {0.4, 4.75},
              {0.5, 4.95}},
             scene.Steps(64, 8), scene.Steps(2.4, 1), 16, 0.09);
    AddBlock(mesh, foot.Moved({0, 0, 5.08}), {0.55, 0.55, 0.13}, 0.05, scene.Steps(5, 1));
  }
  int arch = 0;
  for (double y : {-kNave, kNave}) {
    for (int i = 0; i < kBays; ++i) AddArch(scene, scene.Object("arch", arch++), -18 + kBay * i, y);
  }
}

void MakeChandelier(SceneBuilder& scene, int index, double x) {
  MeshBuilder& mesh = scene.Object("chandelier", index);
  const ShapePlacement at({x, 0, 6.0});
  const int round = scene.Steps(8, 3), fine = scene.Steps(2, 1);
  AddTorus(mesh, at, 1.2, 0.05, scene.Steps(48, 8), round);
  AddTorus(mesh, at.Moved({0, 0, 0.7}), 0.5, 0.04, scene.Steps(28, 6), round);
  AddTube(mesh, {{at.At({0, 0, 0.7}), 0.03}, {at.At({0, 0, kVault + kNave - 6.2}), 0.03}}, round);
  for (int i = 0; i < 12; ++i) {
    const SinCos sc = SinCosTurns(i / 12.0);
    AddTube(mesh,
            {{at.At({1.2 * sc.cos, 1.2 * sc.sin, 0}), 0.012},
             {at.At({0.5 * sc.cos, 0.5 * sc.sin, 0.7}), 0.012}},
            3);
    AddLathe(mesh, at.Moved({1.2 * sc.cos, 1.2 * sc.sin, 0.03}),
             {{0.07, 0}, {0.09, 0.05}, {0.03, 0.06}, {0.03, 0.28}}, round, fine);
  }
}

// Long tables in the nave, chairs on both sides, things on top.
void MakeTables(SceneBuilder& scene) {
  int chairs = 0, things = 0;
  for (int t = 0; t < 3; ++t) {
    const double x = -9 + 9.0 * t, y = t % 2 == 0 ? 1.6 : -1.6;
    AddTable(scene, scene.Object("table", t), ShapePlacement({x, y, 0}), {5, 1.1, 0.76});
    for (int c = 0; c < 12; ++c) {
      Prng rng(scene.seed(), "hall-chair", static_cast<uint64_t>(chairs));
      const int place = c / 2;
      const double side = c % 2 == 0 ? -1.0 : 1.0;
      const double cx = x - 2.1 + 0.84 * place + rng.Uniform(-0.08, 0.08);
      const double cy = y + side * (0.62 + rng.Uniform(0, 0.3));
      const double yaw = (side < 0 ? 0.5 : 0.0) + rng.Uniform(-0.06, 0.06);
      AddChair(scene, scene.Object("chair", chairs++), ShapePlacement({cx, cy, 0}, yaw), rng);
    }
    for (int v = 0; v < 5; ++v) {
      Prng rng(scene.seed(), "hall-table", static_cast<uint64_t>(things));
      MeshBuilder& mesh = scene.Object("tableware", things++);
      const double along = x - 2 + v + rng.Uniform(-0.2, 0.2);
      const ShapePlacement at({along, y, 0.76}, rng.Uniform());
      if (v % 2 == 0) {
        AddVase(scene, mesh, at, rng.Uniform(0.25, 0.45), rng);
      } else {
        AddBowl(scene, mesh, at, 0.22, 6, rng);
      }
    }
  }
}

void MakeScatter(SceneBuilder& scene, FloorPlan& plan) {
  const int balls = scene.Items(34, 12, 300);
  for (int i = 0; i < balls; ++i) {
    Prng rng(scene.seed(), "hall-ball", static_cast<uint64_t>(i));
    const double r = rng.Uniform(0.12, 0.55);
    Vec3d at;
    if (!plan.Place(rng, {-19, -8.4, 0}, {19, 8.4, 0}, r, &at)) continue;
    const int n = 1 + static_cast<int>(r * 14);
    {
      MeshBuilder& open = scene.Object("ball", i);
      AddBall(open, {at.x, at.y, r}, r, scene.Steps(n, 2));
    }
  }
  // Crates in the aisles, in stacks of up to three.
  const int stacks = scene.Items(110, 30, 700);
  for (int i = 0; i < stacks; ++i) {
    Prng rng(scene.seed(), "hall-crates", static_cast<uint64_t>(i));
    const double side = rng.Below(2) == 0 ? -1.0 : 1.0;
    const double half = rng.Uniform(0.18, 0.42);
    Vec3d at;
    if (!plan.Place(rng, {-19, side * 7 - 1.5, 0}, {19, side * 7 + 1.5, 0}, 1.3 * half, &at))
      continue;
    MeshBuilder& mesh = scene.Object("crates", i);
    const int high = 1 + rng.Below(3);
    double z = 0;
    for (int k = 0; k < high; ++k) {
      const double h = half * (1 - 0.15 * k);
      const double tall = h * rng.Uniform(0.6, 1.0);
      AddBlock(mesh, ShapePlacement({at.x, at.y, z + tall}, rng.Uniform()), {h, h * 0.9, tall},
               0.04, scene.Steps(3, 1));
      z += 2 * tall;
    }
  }
  const int vases = scene.Items(16, 6, 120);
  for (int i = 0; i < vases; ++i) {
    Prng rng(scene.seed(), "hall-vase", static_cast<uint64_t>(i));
    const double height = rng.Uniform(0.5, 1.4);
    Vec3d at;
    if (!plan.Place(rng, {-19, -8.4, 0}, {19, 8.4, 0}, 0.38 * height, &at)) continue;
    AddVase(scene, scene.Object("vase", i), ShapePlacement(at), height, rng);
  }
}

// Weathered busts on pedestals at the aisle ends.
void MakeBusts(SceneBuilder& scene, FloorPlan& plan) {
  for (int i = 0; i < 4; ++i) {
    const Vec3d at{i < 2 ? -18.6 : 18.6, i % 2 == 0 ? -6.7 : 6.7, 0};
    plan.Reserve(at.x, at.y, 0.8);
    MeshBuilder& mesh = scene.Object("bust", i);
    const ShapePlacement foot(at);
    AddLathe(mesh, foot, {{0.5, 0}, {0.5, 0.1}, {0.36, 0.2}, {0.34, 1.0}, {0.45, 1.1}, {0.45, 1.2}},
             scene.Steps(32, 6), scene.Steps(2, 1));
    const uint64_t seed = scene.seed() + static_cast<uint64_t>(i);
    AddBall(mesh, foot.At({0, 0, 1.85}), scene.Steps(34, 4), [&](Vec3d d) {
      const double neck = SmoothStep(-0.2, -0.9, d.z) * 0.12;
      return 0.55 * (1 + 0.28 * Fbm(d * 1.7, 5, seed) - neck) * (1 + 0.18 * std::abs(d.z));
    });
  }
}

}  // namespace

void MakeHall(SceneBuilder& scene) {
  MakeWalls(scene);
  MakeVault(scene);
  MakeColumns(scene);
  MakeTables(scene);
  for (int i = 0; i < 4; ++i) MakeChandelier(scene, i, -14 + 8.0 * i);
  FloorPlan plan;
  // The cameras, the columns, the tables with their chairs.
  plan.Reserve(-18.5, -2.4, 1.6);
  plan.Reserve(16.5, 6.6, 1.6);
  plan.Reserve(2.5, -7.2, 1.6);
  for (int i = 0; i < 2 * (kBays - 1); ++i) {
    const int bay = 1 + i / 2;
    plan.Reserve(-kHalfLength + kBay * bay, i % 2 == 0 ? -kNave : kNave, 0.8);
  }
  for (int t = 0; t < 3; ++t) {
    for (int k = -2; k <= 2; ++k)
      plan.Reserve(-9 + 9.0 * t + 1.2 * k, t % 2 == 0 ? 1.6 : -1.6, 1.5);
  }
  MakeBusts(scene, plan);
  MakeScatter(scene, plan);
}

std::vector<BuiltinView> HallViews(uint64_t) {
  return {
      MakeView({-18.5, -2.4, 1.9}, {10, 0.8, 3.2}, 60,
               {{-15.9, -2.7, 2.4}, {0.8, 1.5, 6.3}, {11.7, 5.4, 6.6}}, {60, 270, 150}, 0.4),
      MakeView({16.5, 6.6, 1.7}, {-6, -2, 2.4}, 60,
               {{16.9, 7, 5.4}, {6.2, 7.6, 6.5}, {-17.4, 4.6, 5}}, {330, 90, 270}, 0.4),
      MakeView({2.5, -7.2, 3.4}, {-8, 3.5, 1.5}, 60,
               {{2.9, -7.6, 6.1}, {-5.1, -0.5, 6.9}, {17.2, 5.1, 2.7}}, {60, 270, 240}, 0.4),
  };
}

}  // namespace sightline
