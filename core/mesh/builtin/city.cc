// SPDX-License-Identifier: Apache-2.0
//
// A town of 8 × 8 blocks around (500000, 4400000) in metres: apartment houses with windows, gabled
// houses, stepped and round towers near the middle, a park with trees, a church, trees and cars
// along the streets, on gently rolling ground near z = 30.
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/mesh/builtin/furniture.h"
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"
#include "core/mesh/builtin/vegetation.h"

namespace sightline {
namespace {

constexpr double kEast = 500000, kNorth = 4400000, kPitch = 96, kStreet = 20;
constexpr int kBlocks = 8, kParkI = 3, kParkJ = 2, kChurchI = 4, kChurchJ = 2;

double Ground(double x, double y, uint64_t seed) {
  return 30 + 7 * Fbm({x / 700, y / 700, 0.5}, 3, seed);
}
// A point of the town's own frame, on the map.
Vec3d OnMap(double x, double y, double z) { return {kEast + x, kNorth + y, z}; }
Vec3d Above(double x, double y, double clearance, uint64_t seed) {
  return OnMap(x, y, Ground(x, y, seed) + clearance);
}

// One axis of a facade: `bays` windows (or floors), each with an outer and an inner line on both of
// its sides and `panes` cells of glass between.
struct Facade {
  int bays, panes;
  double low, high;  // Where the opening lies within a bay.

  int cells() const { return bays == 0 ? 1 : bays * (3 + panes) + 1; }
  bool Inset(int i) const {
    if (bays == 0 || i == 0 || i == cells()) return false;
    const int r = (i - 1) % (3 + panes);
    return r >= 1 && r <= 1 + panes;
  }
  // 0 .. 1 along the wall.
  double At(int i) const {
    if (i == 0) return 0;
    if (i == cells()) return 1;
    const int bay = (i - 1) / (3 + panes), r = (i - 1) % (3 + panes);
    constexpr double kReveal = 0.02;
    const double inner =
        r == 0           ? low
        : r == 2 + panes ? high
                         : Lerp(low + kReveal, high - kReveal, static_cast<double>(r - 1) / panes);
    return (bay + inner) / bays;
  }
};

// How a facade is divided, by the detail: not at all, by bands of glass around each floor, by
// windows with panes.
struct Glazing {
  int panes;  // Of a window; 0: bands.
  bool plain;
  double pitch;   // From window to window, metres.
  double storey;  // From floor to floor, metres.
};
// The share of houses with bands, then with windows, grows with the detail; then the panes do.
Glazing GlazingOf(const SceneBuilder& scene, double pitch, double storey) {
  return {.panes = scene.Steps(0.8, 0),
          .plain = scene.Steps(7, 0) == 0,
          .pitch = pitch,
          .storey = storey};
}

// A house of half sizes (x, y) and height z, its windows sunk into the walls, a parapet around its
// roof.
void AddHouse(MeshBuilder& mesh, const ShapePlacement& place, Vec3d size, const Glazing& glazing) {
  const bool windows = glazing.panes > 0;
  const int panes = std::max(glazing.panes, 1);
  const auto bays = [&](double length, double pitch) {
    return windows ? std::max(1, static_cast<int>(std::floor(length / pitch + 0.5))) : 0;
  };
  const Facade x{bays(2 * size.x, glazing.pitch), panes, 0.24, 0.76};
  const Facade y{bays(2 * size.y, glazing.pitch), panes, 0.24, 0.76};
  const int floors = glazing.plain && !windows
                         ? 0
                         : std::max(1, static_cast<int>(std::floor(size.z / glazing.storey + 0.5)));
  const Facade z{floors, panes, 0.28, 0.86};
  const int nx = windows ? x.cells() : 3, ny = windows ? y.cells() : 3, nz = z.cells();
  constexpr double kSunk = 0.28, kParapet = 0.9, kFoot = 3;
  const auto across = [&](const Facade& f, int i, int n, double half) {
    if (windows) return half * (2 * f.At(i) - 1);
    return i == 0   ? -half
           : i == n ? half
           : i == 1 ? 0.5 - half
                    : half - 0.5;  // The parapet's inner edge.
  };
  AddSolid(mesh, nx, ny, nz, [&](int i, int j, int k) {
    Vec3d p{across(x, i, nx, size.x), across(y, j, ny, size.y), size.z * z.At(k)};
    if (k == 0) p.z = -kFoot;  // Foundations reach below sloping ground.
    const bool top = k == nz, inner_x = i > 0 && i<nx, inner_y = j> 0 && j < ny;
    if (top && inner_x && inner_y) p.z -= kParapet;
    if (z.Inset(k)) {
      // Bands run from corner to corner.
      if (!inner_y && (windows ? x.Inset(i) : inner_x)) p.y += j == 0 ? kSunk : -kSunk;
      if (!inner_x && (windows ? y.Inset(j) : inner_y)) p.x += i == 0 ? kSunk : -kSunk;
    }
    return place.At(p);
  });
}

// A gable with its ridge along x on top of walls of height z.
void AddGable(MeshBuilder& mesh, const ShapePlacement& place, Vec3d size, double rise, int n) {
  AddSolid(mesh, n, 2, 1, [&](int i, int j, int k) {
    const double eave = 0.5;
    const double drop = rise * eave / size.y;
    const double x = Lerp(-size.x - eave, size.x + eave, static_cast<double>(i) / n);
    const double y = (j - 1) * (size.y + eave);
    const double z = j == 1 ? rise : -drop;
    return place.At({x, y, size.z + z + (k == 0 ? -0.3 : 0.05)});
  });
}

void AddRoofThings(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d size,
                   Prng& rng) {
  const int things = 1 + rng.Below(4), n = scene.Steps(1.5, 1);
  for (int i = 0; i < things; ++i) {
    const double x = rng.Uniform(-0.7, 0.7) * size.x, y = rng.Uniform(-0.7, 0.7) * size.y;
    const double w = rng.Uniform(0.5, 1.6), h = rng.Uniform(0.5, 1.4);
    const ShapePlacement at = place.Moved({x, y, size.z - 0.9});
    if (rng.Below(3) == 0) {
      AddLathe(mesh, at, {{w, 0}, {w, h}, {0.9 * w, 1.1 * h}}, scene.Steps(10, 5), 1);
    } else {
      AddBlock(mesh, at.Moved({0, 0, h}), {w, 0.7 * w, h}, 0.1, n);
    }
  }
}

void MakeBuilding(SceneBuilder& scene, const std::string& name, Vec3d foot, Vec3d half,
                  double central, Prng& rng) {
  MeshBuilder& mesh = scene.Object(name);
  const ShapePlacement place(foot);
  const Glazing glazing = GlazingOf(scene, 3.4, 3.2);
  const double draw = rng.Uniform();
  const double tall = rng.Uniform();
  if (draw < 0.30 * central) {  // A tower in steps.
    Vec3d size{0.9 * half.x, 0.9 * half.y, 0};
    const double height = 35 + 70 * tall * central;
    double base = 0;
    for (int step = 0; step < 3; ++step) {
      size.z = height * (0.5 - 0.12 * step);
      AddHouse(mesh, place.Moved({0, 0, base}), size, GlazingOf(scene, 6.8, 6.4));
      base += size.z - 0.9;
      if (step == 2)
        AddRoofThings(scene, mesh, place.Moved({0, 0, base - size.z + 0.9}), size, rng);
      size = {size.x * 0.78, size.y * 0.78, size.z};
    }
    AddTube(mesh, {{place.At({0, 0, base}), 0.35}, {place.At({0, 0, base + 14}), 0.08}},
            scene.Steps(6, 3));
  } else if (draw < 0.38 * central) {  // A round tower.
    const double r = 0.85 * std::min(half.x, half.y), height = 30 + 50 * tall * central;
    const double storey = scene.Steps(7, 0) == 0 ? 13.6 : 3.4;
    const int floors = static_cast<int>(height / storey);
    std::vector<Turn> turns{{r, -3}};
    for (int f = 0; f < floors; ++f) {
      const double z = storey * f;
      turns.insert(
          turns.end(),
          {{r, z + 0.2}, {0.95 * r, z + 0.5}, {0.95 * r, z + storey - 0.5}, {r, z + storey - 0.2}});
    }
    turns.insert(turns.end(), {{1.03 * r, storey * floors + 0.4},
                               {0.98 * r, storey * floors + 1.2},
                               {0.5 * r, storey * floors + 1.6}});
    AddLathe(mesh, place, turns, scene.Steps(26, 8), 1);
  } else if (draw < 0.62 || half.x < 9) {  // Flat roofs.
    const Vec3d size{half.x, half.y,
                     3.2 * std::floor(3 + 5 * tall + 3 * central * rng.Uniform()) + 1};
    AddHouse(mesh, place, size, glazing);
    AddRoofThings(scene, mesh, place, size, rng);
  } else {  // Gables, with chimneys.
    const Vec3d size{half.x - 0.5, half.y - 0.5, 3.2 * std::floor(2 + 3 * tall) + 1};
    AddHouse(mesh, place, size, glazing);
    const double rise = 0.5 * size.y * rng.Uniform(0.7, 1.2);
    AddGable(mesh, place, {size.x, size.y, size.z}, rise, scene.Steps(3, 1));
    for (int c = 0; c < 2; ++c) {
      const double x = rng.Uniform(-0.8, 0.8) * size.x;
      AddBox(mesh, place, {x - 0.4, 0.6, size.z}, {x + 0.4, 1.4, size.z + rise + 0.9});
    }
  }
}

void MakeChurch(SceneBuilder& scene, Vec3d foot) {
  MeshBuilder& mesh = scene.Object("church");
  const ShapePlacement at(foot, 0.02);
  const Glazing glazing{.panes = scene.Steps(2, 1), .plain = false, .pitch = 5, .storey = 5};
  const int round = scene.Steps(48, 10), fine = scene.Steps(3, 1);
  AddHouse(mesh, at, {26, 9, 14}, glazing);
  AddGable(mesh, at, {26, 9, 14}, 8, scene.Steps(12, 1));
  AddHouse(mesh, at.Moved({4, 0, 0}), {8, 20, 13}, glazing);
  AddLathe(mesh, at.Moved({4, 0, 0}),
           {{9, 12},
            {9, 22},
            {9.6, 23},
            {9.3, 24},
            {8.6, 28},
            {6.5, 32},
            {3.2, 34.6},
            {1.3, 35.2},
            {1.3, 38},
            {0.15, 41}},
           round, fine, 12, 0.02);
  AddHouse(mesh, at.Moved({-28, 0, 0}), {5, 5, 34}, glazing);
  AddLathe(mesh, at.Moved({-28, 0, 33}), {{4.6, 0}, {3.6, 3}, {2.0, 12}, {0.9, 20}, {0.1, 25}},
           scene.Steps(16, 8), fine);
}

void MakeTree(SceneBuilder& scene, MeshBuilder& mesh, Vec3d foot, Prng& rng) {
  const double height = rng.Uniform(6, 12);
  std::vector<Twig> twigs;
  AddWood(scene, mesh, ShapePlacement(foot, rng.Uniform()),
          {height, 0.36 * height, 0.02 * height, false, scene.Items(60, 3, 9), 0}, rng, &twigs);
  AddLeaves(mesh, twigs,
            {.count = scene.Swarm(4000, 12),
             .area = 0.9 * height * height,
             .slenderness = 1.6,
             .max_length = 0.16 * height,
             .spread = 0.05 * height,
             .cells = 0},
            rng);
}

void AddCar(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& at) {
  const int n = scene.Steps(6, 1);
  AddBlock(mesh, at.Moved({0, 0, 0.62}), {2.1, 0.86, 0.34}, 0.16, n);
  AddSolid(mesh, n, n, 1, [&](int i, int j, int k) {
    const double u = static_cast<double>(2 * i - n) / n, v = static_cast<double>(2 * j - n) / n;
    return at.At({-0.15 + u * (k == 0 ? 1.35 : 0.8), v * (k == 0 ? 0.8 : 0.66),
                  k == 0 ? 0.9 : 1.45 - 0.05 * u * u});
  });
  for (double x : {-1.3, 1.3}) {
    for (double y : {-0.8, 0.8}) AddBall(mesh, at.At({x, y, 0.32}), 0.32, n);
  }
}

void MakeStreetThings(SceneBuilder& scene, int index, double x, double y) {
  const uint64_t seed = scene.seed();
  MeshBuilder& trees = scene.Object("street-trees", index);
  Prng rng(seed, "city-trees", static_cast<uint64_t>(index));
  const double edge = 0.5 * (kPitch - kStreet) + 2.2;
  for (int t = 0; t < 3; ++t) {
    const double along = -28 + 22 * t + rng.Uniform(-4, 4);
    MakeTree(scene, trees, Above(x + along, y - edge, -0.1, seed), rng);
  }
  MeshBuilder& cars = scene.Object("cars", index);
  for (int c = 0; c < 4; ++c) {
    const double along = -34 + 18 * c + rng.Uniform(-3, 3);
    const bool north = rng.Below(2) == 0;
    const Vec3d at =
        north ? Above(x - edge - 2.5, y + along, 0, seed) : Above(x + along, y - edge - 3, 0, seed);
    AddCar(scene, cars, ShapePlacement(at, north ? 0.25 : 0.0));
  }
}

// Splits a block's rectangle into lots until both sides are short enough, and builds on each.
void MakeLots(SceneBuilder& scene, const std::string& block, int* count, Vec3d lo, Vec3d hi,
              double central, Prng& rng) {
  const double width = hi.x - lo.x, depth = hi.y - lo.y;
  const double longest = std::max(width, depth);
  if (longest > 40 || (longest > 26 && rng.Uniform() < 0.7)) {
    const double at = rng.Uniform(0.42, 0.58);
    Vec3d first_hi = hi, second_lo = lo;
    if (width >= depth) {
      first_hi.x = second_lo.x = Lerp(lo.x, hi.x, at);
    } else {
      first_hi.y = second_lo.y = Lerp(lo.y, hi.y, at);
    }
    MakeLots(scene, block, count, lo, first_hi, central, rng);
    MakeLots(scene, block, count, second_lo, hi, central, rng);
    return;
  }
  const double yard = rng.Uniform() < 0.45 ? 0.0 : rng.Uniform(0.04, 0.14) * std::min(width, depth);
  const Vec3d half{width / 2 - yard, depth / 2 - yard, 0};
  const Vec3d foot = Above((lo.x + hi.x) / 2, (lo.y + hi.y) / 2, 0, scene.seed());
  MakeBuilding(scene, absl::StrCat(block, "-", (*count)++), foot, half, central, rng);
}

void MakePark(SceneBuilder& scene, double x, double y) {
  const uint64_t seed = scene.seed();
  FloorPlan plan;
  plan.Reserve(0, 0, 14);
  const ShapePlacement pond(Above(x, y, 0, seed));
  {
    MeshBuilder& open = scene.Object("pond-rim");
    AddTorus(open, pond, 12, 0.6, scene.Steps(60, 10), scene.Steps(8, 4));
  }
  {
    MeshBuilder& open = scene.Object("fountain");
    AddLathe(open, pond,
             {{4, -0.5},
              {4, 0.8},
              {3.6, 0.9},
              {1.0, 0.8},
              {0.6, 2.2},
              {2.2, 2.8},
              {2.1, 2.9},
              {0.4, 2.7},
              {0.3, 4.2},
              {0.9, 4.5},
              {0.1, 4.4}},
             scene.Steps(40, 8), scene.Steps(2, 1));
  }
  for (int g = 0; g < 5; ++g) {
    MeshBuilder& grove = scene.Object("grove", g);
    for (int i = 0; i < 8; ++i) {
      Prng rng(seed, "city-park", static_cast<uint64_t>(g * 8 + i));
      Vec3d at;
      if (!plan.Place(rng, {-36, -36, 0}, {36, 36, 0}, 3, &at)) continue;
      MakeTree(scene, grove, Above(x + at.x, y + at.y, -0.1, seed), rng);
    }
  }
}

}  // namespace

void MakeCity(SceneBuilder& scene) {
  const uint64_t seed = scene.seed();
  constexpr double kHalf = 0.5 * kBlocks * kPitch + 150;
  MeshBuilder& ground = scene.Object("ground");
  const int n = scene.Steps(250, 12);
  AddSheet(ground, n, n, [&](int i, int j) {
    const double x = Lerp(-kHalf, kHalf, static_cast<double>(i) / n),
                 y = Lerp(-kHalf, kHalf, static_cast<double>(j) / n);
    return Above(x, y, 0, seed);
  });
  for (int j = 0; j < kBlocks; ++j) {
    for (int i = 0; i < kBlocks; ++i) {
      const double x = (i - 0.5 * (kBlocks - 1)) * kPitch, y = (j - 0.5 * (kBlocks - 1)) * kPitch;
      const int index = j * kBlocks + i;
      if (i == kParkI && j == kParkJ) {
        MakePark(scene, x, y);
        continue;
      }
      MakeStreetThings(scene, index, x, y);
      if (i == kChurchI && j == kChurchJ) {
        MakeChurch(scene, Above(x, y, 0, seed));
        continue;
      }
      Prng rng(seed, "city-block", static_cast<uint64_t>(index));
      const double central = 1 / (1 + (x * x + (y + 50) * (y + 50)) / (180.0 * 180.0));
      const double edge = 0.5 * (kPitch - kStreet);
      int lots = 0;
      MakeLots(scene, absl::StrCat("house-", index), &lots, {x - edge, y - edge, 0},
               {x + edge, y + edge, 0}, central, rng);
    }
  }
}

std::vector<BuiltinView> CityViews(uint64_t seed) {
  return {
      MakeView(
          Above(-340, -480, 130, seed), Above(30, 0, 15, seed), 45,
          {Above(-300, -471, 134, seed), Above(-218, -61, 322, seed), Above(376, 211, 233, seed)},
          {240, 200, 320}, 4),
      MakeView(
          Above(-96, -330, 2.2, seed), Above(-90, 100, 12, seed), 60,
          {Above(-91, -343, 61, seed), Above(-331, -336, 311, seed), Above(131, 358, 223, seed)},
          {240, 200, 320}, 4),
      MakeView(
          Above(150, 250, 70, seed), Above(0, -110, 5, seed), 55,
          {Above(162, 233, 71, seed), Above(-145, 376, 203, seed), Above(-278, -495, 343, seed)},
          {60, 100, 20}, 4),
  };
}

}  // namespace sightline
