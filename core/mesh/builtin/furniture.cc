// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/furniture.h"

#include <algorithm>

namespace sightline {

void AddChair(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Prng& rng) {
  const int round = scene.Steps(8, 4), fine = scene.Steps(2, 1), block = scene.Steps(4, 1);
  const double back = rng.Uniform(0.90, 1.02);
  AddBlock(mesh, place.Moved({0, 0, 0.45}), {0.22, 0.21, 0.025}, 0.02, block);
  for (double x : {-0.18, 0.18}) {
    AddLathe(mesh, place.Moved({x, -0.17, 0}),
             {{0.014, 0}, {0.022, 0.2}, {0.016, 0.35}, {0.02, 0.43}}, round, fine);
    const Joint leg[] = {{place.At({x, 0.20, 0}), 0.016},
                         {place.At({x, 0.18, 0.25}), 0.02},
                         {place.At({x, 0.18, 0.5}), 0.02},
                         {place.At({x, 0.21, 0.75}), 0.018},
                         {place.At({x, 0.25, back}), 0.015}};
    AddTube(mesh, leg, round);
    AddTube(mesh, {{place.At({x, -0.165, 0.16}), 0.009}, {place.At({x, 0.185, 0.16}), 0.009}},
            round);
  }
  AddTube(mesh, {{place.At({-0.18, 0.0, 0.16}), 0.009}, {place.At({0.18, 0.0, 0.16}), 0.009}},
          round);
  const int slats = 3 + rng.Below(3);
  for (int i = 0; i < slats; ++i) {
    const double t = static_cast<double>(i + 1) / slats;
    const double z = Lerp(0.55, back - 0.05, t);
    const int across = scene.Steps(5, 2);
    AddSolid(mesh, across, 1, 1, [&](int a, int j, int k) {
      const double u = static_cast<double>(2 * a - across) / across;
      const double bow = 0.03 * (1 - u * u) + Lerp(0.175, 0.235, (z - 0.5) / 0.5);
      return place.At({0.175 * u, bow + 0.012 * j, z + 0.05 * (k - 0.5)});
    });
  }
}

void AddTable(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d size) {
  const double x = size.x / 2, y = size.y / 2, top = size.z;
  AddBlock(mesh, place.Moved({0, 0, top - 0.02}), {x, y, 0.02}, 0.012, scene.Steps(5, 1));
  const double lx = x - 0.09, ly = y - 0.09;
  AddBox(mesh, place, {-lx, -ly - 0.012, top - 0.13}, {lx, -ly + 0.012, top - 0.035});
  AddBox(mesh, place, {-lx, ly - 0.012, top - 0.13}, {lx, ly + 0.012, top - 0.035});
  const int round = scene.Steps(14, 5), fine = scene.Steps(2.5, 1);
  for (double sx : {-1.0, 1.0}) {
    for (double sy : {-1.0, 1.0}) {
      AddLathe(mesh, place.Moved({sx * lx, sy * ly, 0}),
               {{0.022, 0},
                {0.03, 0.03},
                {0.02, 0.08},
                {0.032, top * 0.35},
                {0.038, top * 0.6},
                {0.024, top * 0.74},
                {0.04, top * 0.8},
                {0.04, top - 0.03}},
               round, fine);
    }
  }
}

void AddVase(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double height,
             Prng& rng) {
  const double belly = height * rng.Uniform(0.22, 0.36);
  const double at = rng.Uniform(0.3, 0.6);
  const double neck = belly * rng.Uniform(0.35, 0.6);
  const double foot = belly * rng.Uniform(0.45, 0.7);
  const double wall = 0.06 * belly;
  AddLathe(mesh, place,
           {{foot, 0},
            {foot * 0.95, 0.04 * height},
            {belly, at * height},
            {neck, 0.82 * height},
            {neck * 1.35, height},
            {neck * 1.25, height * 1.01},
            {neck - wall, 0.82 * height},
            {belly - 2 * wall, at * height},
            {foot - 2 * wall, 0.1 * height}},
           scene.Steps(20, 6), scene.Steps(3, 1), 10, 0.04);
}

void AddBooks(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d space,
              Prng& rng) {
  double x = -space.x / 2;
  while (true) {
    const double thick = rng.Uniform(0.014, 0.05);
    const double high = space.z * rng.Uniform(0.6, 0.95);
    const double deep = space.y * rng.Uniform(0.65, 0.95);
    const double lean = rng.Below(9) == 0 ? 0.02 : 0.0;
    if (x + thick + lean > space.x / 2) return;
    const double left = x;
    const double round = 0.25 * thick;
    const int n = scene.Steps(1.6, 1);
    // The spine (toward -y) is rounded; the whole book leans a little.
    AddSolid(mesh, n, n, n, [&](int i, int j, int k) {
      const double u = static_cast<double>(i) / n, v = static_cast<double>(j) / n;
      const double w = static_cast<double>(k) / n;
      const double bulge = n > 1 ? round * 4 * u * (1 - u) * (1 - v) : 0.0;
      return place.At(
          {left + thick * u + lean * w, space.y / 2 - deep * (1 - v) - bulge, high * w});
    });
    x += thick + lean + 0.0015;
    if (rng.Below(14) == 0) x += rng.Uniform(0.02, 0.12);
  }
}

void AddShelves(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d size,
                int boards) {
  const double x = size.x / 2, y = size.y / 2;
  const int n = scene.Steps(1.5, 1);
  AddBox(mesh, place, {-x, -y, 0}, {-x + 0.025, y, size.z}, 1, n, n);
  AddBox(mesh, place, {x - 0.025, -y, 0}, {x, y, size.z}, 1, n, n);
  AddBox(mesh, place, {-x + 0.025, y - 0.01, 0}, {x - 0.025, y, size.z}, n, 1, n);
  for (int i = 0; i <= boards; ++i) {
    const double z = (size.z - 0.025) * i / boards;
    AddBox(mesh, place, {-x + 0.025, -y, z}, {x - 0.025, y - 0.01, z + 0.025}, n, n, 1);
  }
}

void AddCushion(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double size,
                Prng& rng) {
  const int n = scene.Steps(12, 3);
  const double crease = rng.Uniform(0.02, 0.06);
  const double lean = rng.Uniform(0.2, 0.4);
  const double phase = rng.Uniform();
  AddSolid(mesh, n, n, 2, [&](int i, int j, int k) {
    const double u = static_cast<double>(2 * i - n) / n, v = static_cast<double>(2 * j - n) / n;
    // Thick in the middle, pinched at the seam, with the corners drawn out.
    const double pinch = 1 - 0.12 * ((1 - u * u) * v * v + (1 - v * v) * u * u);
    const double thick = 0.012 + 0.11 * (1 - u * u) * (1 - v * v);
    const double fold = crease * SinCosTurns(phase + u * 0.7 + v * 0.4).sin * (1 - u * u);
    const double depth = (1 - k) * size * (thick + 0.3 * fold * (1 - v * v));
    const double up = 0.5 * size * (v * pinch + 1);
    return place.At({0.5 * size * u * pinch, lean * up + depth, up - 0.25 * depth});
  });
}

void AddCup(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place) {
  AddLathe(mesh, place,
           {{0.026, 0},
            {0.034, 0.01},
            {0.04, 0.05},
            {0.041, 0.09},
            {0.037, 0.09},
            {0.035, 0.05},
            {0.024, 0.012}},
           scene.Steps(14, 5), scene.Steps(2, 1));
  const Joint handle[] = {{place.At({0.038, 0, 0.072}), 0.005},
                          {place.At({0.06, 0, 0.072}), 0.005},
                          {place.At({0.068, 0, 0.05}), 0.005},
                          {place.At({0.058, 0, 0.03}), 0.005},
                          {place.At({0.036, 0, 0.026}), 0.005}};
  AddTube(mesh, handle, scene.Steps(6, 3));
}

void AddLamp(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double height) {
  const int round = scene.Steps(22, 6), fine = scene.Steps(2, 1);
  const double r = 0.16 * height;
  AddLathe(mesh, place,
           {{r * 0.75, 0},
            {r * 0.72, 0.012 * height},
            {r * 0.15, 0.03 * height},
            {0.012 * height, 0.08 * height},
            {0.012 * height, 0.4 * height},
            {0.016 * height, 0.45 * height},
            {0.01 * height, 0.5 * height},
            {0.01 * height, 0.78 * height}},
           round, fine);
  // The shade: a closed band, open above and below.
  AddSolid(mesh, round, 1, fine + 1, [&](int i, int j, int k) {
    const double t = static_cast<double>(k) / (fine + 1);
    const double rho = Lerp(r, 0.6 * r, t) - 0.004 * height * j;
    // One narrow gap keeps the band a simple solid.
    const SinCos sc = SinCosTurns(static_cast<double>(i) / round * 0.998);
    return place.At({rho * sc.sin, rho * sc.cos, Lerp(0.74, 1.0, t) * height});
  });
}

void AddBowl(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double radius,
             int count, Prng& rng) {
  const double r = radius;
  AddLathe(mesh, place,
           {{0.45 * r, 0},
            {0.5 * r, 0.05 * r},
            {0.85 * r, 0.3 * r},
            {r, 0.6 * r},
            {0.95 * r, 0.61 * r},
            {0.78 * r, 0.32 * r},
            {0.4 * r, 0.12 * r}},
           scene.Steps(24, 6), scene.Steps(2, 1));
  for (int i = 0; i < count; ++i) {
    const SinCos sc = SinCosTurns(i * 0.381966011 + rng.Uniform(0, 0.05));
    const double size = r * rng.Uniform(0.22, 0.28);
    const double out = i == 0 ? 0.0 : r * 0.42;
    const double dent = rng.Uniform(0.05, 0.15);
    AddBall(mesh, place.At({out * sc.cos, out * sc.sin, 0.45 * r + (i == 0 ? 0.25 * r : 0.0)}),
            scene.Steps(7, 2), [&](Vec3d d) { return size * (1 - dent * d.z * d.z * d.z * d.z); });
  }
}

bool FloorPlan::Place(Prng& rng, Vec3d lo, Vec3d hi, double radius, Vec3d* at) {
  for (int attempt = 0; attempt < 24; ++attempt) {
    const double x = rng.Uniform(lo.x, hi.x);
    const double y = rng.Uniform(lo.y, hi.y);
    const bool free = std::none_of(discs_.begin(), discs_.end(), [&](const Disc& d) {
      const double dx = x - d.x, dy = y - d.y, apart = radius + d.radius;
      return dx * dx + dy * dy < apart * apart;
    });
    if (!free) continue;
    Reserve(x, y, radius);
    *at = {x, y, lo.z};
    return true;
  }
  return false;
}

}  // namespace sightline
