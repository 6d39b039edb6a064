// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/builtin/vegetation.h"

#include <algorithm>
#include <cmath>

namespace sightline {
namespace {

constexpr double kGoldenTurn = 0.38196601125010515;  // Leaves around a stem: 1 - 1/phi turns.

// A random unit vector; more level than upright when `flat` > 1.
Vec3d Wild(Prng& rng, double flat) {
  const SinCos sc = SinCosTurns(rng.Uniform());
  const double z = rng.Uniform(-1, 1) / flat;
  const double rho = std::sqrt(1 - z * z);
  return {rho * sc.cos, rho * sc.sin, z};
}

// A direction at `lift` from the horizontal (sine), `turns` around z.
Vec3d Around(double turns, double lift) {
  const SinCos sc = SinCosTurns(turns);
  const double rho = std::sqrt(1 - lift * lift);
  return {rho * sc.cos, rho * sc.sin, lift};
}

// A bent tube from `from` along `direction`, rising or sagging by `bend` (m) at its end.
Vec3d AddBough(MeshBuilder& mesh, Vec3d from, Vec3d direction, double length, double bend,
               double thick, double thin, int joints, int segments) {
  std::vector<Joint> path(joints + 1);
  for (int i = 0; i <= joints; ++i) {
    const double t = static_cast<double>(i) / joints;
    Vec3d p = from + direction * (length * t);
    p.z += bend * t * t;
    path[i] = {p, Lerp(thick, thin, t)};
  }
  AddTube(mesh, path, segments);
  return path.back().at;
}

}  // namespace

void AddWood(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place,
             const TreeShape& shape, Prng& rng, std::vector<Twig>* twigs) {
  const int round = scene.Steps(6, 4), joints = scene.Steps(6, 3);
  const double sway = 0.03 * shape.height, phase = rng.Uniform();
  const auto stem = [&](double t) {
    const SinCos sc = SinCosTurns(phase + 0.6 * t);
    return place.At({sway * t * sc.cos, sway * t * sc.sin, shape.height * t});
  };
  const auto thickness = [&](double t) {
    const double flare = t < 0.06 ? (0.06 - t) * 8 : 0.0;
    return shape.trunk_radius * (1 - 0.93 * t + flare);
  };
  const double top = shape.conifer ? 1.0 : 0.85;
  std::vector<Joint> trunk(joints + 1);
  for (int i = 0; i <= joints; ++i) {
    const double t = top * i / joints;
    trunk[i] = {stem(t), thickness(t)};
  }
  AddTube(mesh, trunk, round);

  const int thin_round = std::max(3, round / 2), thin_joints = std::max(2, joints / 3);
  const double turn = rng.Uniform();
  for (int b = 0; b < shape.branches; ++b) {
    const double u = (b + 0.5) / shape.branches;
    const double t = shape.conifer ? Lerp(0.1, 0.97, u) : Lerp(0.28, 0.84, u);
    const Vec3d from = stem(t);
    const double around = turn + b * kGoldenTurn + rng.Uniform(-0.04, 0.04);
    double reach, lift, bend;
    if (shape.conifer) {
      reach = shape.crown_radius * (1.04 - u) * rng.Uniform(0.85, 1.1);
      lift = Lerp(-0.1, 0.45, u);
      bend = -0.12 * reach;
    } else {
      const double belly = std::sqrt(Clamp(1 - (u - 0.35) * (u - 0.35) * 1.9, 0.08, 1));
      reach = shape.crown_radius * belly * rng.Uniform(0.75, 1.05);
      lift = Lerp(0.25, 0.85, u);
      bend = 0.1 * reach;
    }
    const double thick = std::min(0.75 * thickness(t), 0.045 * reach + 0.005);
    const Vec3d out = Around(around, lift);
    const Vec3d end =
        AddBough(mesh, from, out, reach, bend, thick, 0.25 * thick, thin_joints, thin_round);
    twigs->push_back({Lerp(from, end, 0.35), end});
    for (int k = 0; k < shape.twigs; ++k) {
      const double s = Lerp(0.35, 0.95, (k + 0.5) / shape.twigs);
      Vec3d root = from + out * (reach * s);
      root.z += bend * s * s;
      const double side = (k & 1) == 0 ? 0.14 : -0.14;
      const double turned = around + side + rng.Uniform(-0.05, 0.05);
      const double raised =
          shape.conifer ? lift - 0.05 : Clamp(lift + rng.Uniform(-0.5, 0.4), -0.3, 0.95);
      const double length =
          reach * (shape.conifer ? 0.42 * (1.2 - s) : 0.45) * rng.Uniform(0.8, 1.2);
      const Vec3d twig = Around(turned, raised);
      // Those of conifers are hidden by their needles.
      const Vec3d tip = shape.conifer ? root + twig * length
                                      : AddBough(mesh, root, twig, length, 0.1 * bend, 0.3 * thick,
                                                 0.12 * thick, 2, 3);
      twigs->push_back({root, tip});
    }
  }
}

void AddLeaves(MeshBuilder& mesh, const std::vector<Twig>& twigs, const LeafCloud& cloud,
               Prng& rng) {
  if (mesh.counting()) {
    mesh.Begin(0, cloud.count * LeafTriangles(cloud.cells));
    return;
  }
  // A leaf covers about 0.6 length · width.
  const double one = cloud.area / cloud.count;
  const double length = std::min(std::sqrt(one * cloud.slenderness / 0.6), cloud.max_length);
  for (int i = 0; i < cloud.count; ++i) {
    const Twig& twig = twigs[static_cast<size_t>(i) % twigs.size()];
    const Vec3d axis = twig.to - twig.from;
    const double t = 1 - rng.Uniform() * rng.Uniform();  // A product: either order gives the same.
    const double off = cloud.spread * rng.Uniform();
    const Vec3d start = twig.from + axis * t + Wild(rng, 1) * off;
    const Vec3d along = Unit(Wild(rng, 1.6) + Unit(axis) * 0.9);
    const Vec3d up = Unit(Vec3d{0, 0, 1.2} + Wild(rng, 1));
    const double size = length * rng.Uniform(0.75, 1.25);
    const Vec3d side = Cross(up, along);
    // Parallel by chance: any other side will do.
    const Vec3d face = Dot(side, side) > 0x1p-10 ? up : AnyAcross(along);
    AddLeaf(mesh, start, along, face, {size, size / cloud.slenderness, 0.25, 0.2}, cloud.cells);
  }
}

void AddPot(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double radius,
            double height) {
  const double r = radius;
  AddLathe(mesh, place,
           {{0.68 * r, 0},
            {0.72 * r, 0.05 * height},
            {0.92 * r, 0.8 * height},
            {r, 0.84 * height},
            {r, height},
            {0.9 * r, height},
            {0.87 * r, 0.86 * height},
            {0.4 * r, 0.85 * height}},
           scene.Steps(24, 6), scene.Steps(2, 1));
}

void AddFern(MeshBuilder& mesh, const ShapePlacement& place, double height, int fronds,
             int leaflets, int cells, Prng& rng) {
  for (int f = 0; f < fronds; ++f) {
    const double turns = f * kGoldenTurn + rng.Uniform(-0.03, 0.03);
    const double reach = height * rng.Uniform(0.7, 1.15);
    const double rise = height * rng.Uniform(0.75, 1.05);
    const SinCos sc = SinCosTurns(turns);
    const auto rib = [&](double t) {
      const double out = reach * t, up = rise * (1.9 * t - 1.25 * t * t);
      return place.At({out * sc.cos, out * sc.sin, up});
    };
    constexpr int kJoints = 6;
    Joint path[kJoints + 1];
    for (int i = 0; i <= kJoints; ++i) {
      const double t = static_cast<double>(i) / kJoints;
      path[i] = {rib(t), height * Lerp(0.008, 0.002, t)};
    }
    AddTube(mesh, path, 3);
    if (mesh.counting()) {
      mesh.Begin(0, 2 * static_cast<uint64_t>(leaflets) * LeafTriangles(cells));
      continue;
    }
    for (int i = 0; i < leaflets; ++i) {
      const double t = Lerp(0.12, 0.97, (i + 0.5) / leaflets);
      const Vec3d at = rib(t), axis = Unit(rib(t + 0.03) - at);
      const Vec3d side = Unit(Cross(axis, {0, 0, 1}));
      const double length = height * 0.34 * (1.12 - t) * (0.35 + 1.3 * std::min(t, 0.5));
      const double width = std::min(1.6 * reach / leaflets, 0.4 * length);
      const Vec3d face = Cross(side, axis);
      for (double s : {-1.0, 1.0}) {
        AddLeaf(mesh, at, Unit(side * s + axis * 0.45), face, {length, width, 0.15, 0.15}, cells);
      }
    }
  }
}

void AddPlant(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, PlantKind kind,
              double height, Prng& rng) {
  switch (kind) {
    case PlantKind::kTree: {
      std::vector<Twig> twigs;
      AddWood(scene, mesh, place, {height, 0.45 * height, 0.022 * height, false, 9, 4}, rng,
              &twigs);
      AddLeaves(mesh, twigs,
                {.count = scene.Swarm(420, 30),
                 .area = 1.5 * height * height,
                 .slenderness = 2.1,
                 .max_length = 0.22 * height,
                 .spread = 0.03 * height,
                 .cells = scene.Steps(2, 0)},
                rng);
      return;
    }
    case PlantKind::kFern:
      AddFern(mesh, place, height, scene.Items(16, 6, 60), scene.Items(20, 5, 90),
              scene.Steps(1.5, 0), rng);
      return;
    case PlantKind::kRosette: {
      const int leaves = scene.Items(46, 14, 160), cells = scene.Steps(6, 2);
      for (int i = 0; i < leaves; ++i) {
        const double t = (i + 0.5) / leaves;
        const Vec3d along = Around(i * kGoldenTurn, Lerp(0.93, 0.12, t));
        const double length = height * Lerp(0.45, 1.0, t) * rng.Uniform(0.92, 1.08);
        const Vec3d base = place.At({0, 0, 0.12 * height * (1 - t)});
        AddLeaf(mesh, base, along, {0, 0, 1}, {length, 0.3 * length, 0.12, 0.25}, cells);
      }
      return;
    }
    case PlantKind::kBlades: {
      const int blades = scene.Items(34, 8, 220), cells = scene.Steps(9, 3);
      for (int i = 0; i < blades; ++i) {
        const Vec3d along = Around(i * kGoldenTurn, rng.Uniform(0.8, 0.985));
        const SinCos sc = SinCosTurns(i * kGoldenTurn);
        const double out = 0.08 * height * rng.Uniform();
        const double length = height * rng.Uniform(0.65, 1.1);
        const double droop = rng.Uniform(0.02, 0.35);
        AddLeaf(mesh, place.At({out * sc.cos, out * sc.sin, 0}), along, {sc.cos, sc.sin, 0.3},
                {length, 0.075 * height, droop, 0.3}, cells);
      }
      return;
    }
    case PlantKind::kCactus: {
      const int arms = 3;
      for (int a = 0; a <= arms; ++a) {
        const SinCos sc = SinCosTurns(a * kGoldenTurn);
        const double tall = height * (a == 0 ? 1.0 : rng.Uniform(0.35, 0.65));
        const double r = 0.11 * height * (a == 0 ? 1.0 : 0.7), off = a == 0 ? 0.0 : 0.17 * height;
        const ShapePlacement foot = place.Moved({off * sc.cos, off * sc.sin, 0});
        AddLathe(mesh, foot,
                 {{0.7 * r, 0},
                  {r, 0.2 * tall},
                  {r, 0.6 * tall},
                  {0.9 * r, 0.85 * tall},
                  {0.5 * r, 0.97 * tall},
                  {0.1 * r, tall}},
                 scene.Steps(48, 8), scene.Steps(4, 1), 12, 0.18);
        const int spines = scene.Swarm(110, 10);
        for (int i = 0; i < spines; ++i) {
          const double z = tall * Lerp(0.06, 0.84, (i + 0.5) / spines);
          const double turns = (rng.Below(12) + 0.5) / 12;
          const Vec3d out = Around(turns, rng.Uniform(-0.2, 0.5));
          const Vec3d level = Unit({out.x, out.y, 0});
          const Vec3d root = foot.At(Vec3d{0, 0, z} + level * (r * 0.93));
          AddTube(mesh, {{root, 0.0016 * height}, {root + out * (0.055 * height), 0.0004 * height}},
                  3);
        }
      }
      return;
    }
    case PlantKind::kBroadLeaves: {
      const int leaves = scene.Items(22, 8, 120), cells = scene.Steps(9, 3),
                round = scene.Steps(5, 3);
      for (int i = 0; i < leaves; ++i) {
        const double lift = rng.Uniform(0.55, 0.97);
        const double turns = i * kGoldenTurn + rng.Uniform(-0.04, 0.04);
        const double stem = height * rng.Uniform(0.45, 0.85);
        const Vec3d out = Around(turns, lift);
        const Vec3d end = AddBough(mesh, place.At({0, 0, 0}), out, stem, -0.08 * stem,
                                   0.011 * height, 0.006 * height, 4, round);
        const double length = height * rng.Uniform(0.3, 0.48);
        AddLeaf(mesh, end, Around(turns, lift * 0.35), {0, 0, 1},
                {length, 0.62 * length, 0.45, 0.22}, cells);
      }
      return;
    }
    case PlantKind::kTrailing: {
      const int vines = scene.Items(18, 6, 90), leaves = scene.Items(26, 6, 120);
      const int cells = scene.Steps(1.6, 0);
      for (int v = 0; v < vines; ++v) {
        const SinCos sc = SinCosTurns(v * kGoldenTurn);
        const double fall = height * rng.Uniform(0.5, 1.2), reach = height * rng.Uniform(0.28, 0.5);
        const auto rib = [&](double t) {
          const double out = reach * (1 - (1 - t) * (1 - t));
          return place.At({out * sc.cos, out * sc.sin, 0.5 * fall * t - 1.5 * fall * t * t});
        };
        constexpr int kJoints = 8;
        Joint path[kJoints + 1];
        for (int i = 0; i <= kJoints; ++i) path[i] = {rib(i / 8.0), 0.006 * height};
        AddTube(mesh, path, 3);
        for (int i = 0; i < leaves; ++i) {
          const Vec3d at = rib((i + 1.0) / leaves);
          const Vec3d along = Unit(Vec3d{sc.cos, sc.sin, -0.5} + Wild(rng, 1) * 0.9);
          const double length = height * rng.Uniform(0.09, 0.16);
          AddLeaf(mesh, at, along, AnyAcross(along), {length, 0.8 * length, 0.2, 0.2}, cells);
        }
      }
      return;
    }
  }
}

}  // namespace sightline
