// SPDX-License-Identifier: Apache-2.0
//
// An open office, 20 m (x) by 14 m (y) and 3 m high, its floor at z = 0: 4 × 4 ceiling lights, rows
// of desks with screens, keyboards and chairs, partitions, binders, plants and a long window front
// to the south.
#include <string>

#include "core/mesh/builtin/furniture.h"
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/shapes.h"
#include "core/mesh/builtin/vegetation.h"

namespace sightline {
namespace {

constexpr double kX = 10, kY = 7, kHeight = 3;
constexpr int kColumns = 6, kRows = 4;
const ShapePlacement kOffice({0, 0, 0});

void MakeShell(SceneBuilder& scene) {
  const int n = scene.Steps(6, 1);
  AddBox(scene.Object("floor"), kOffice, {-kX, -kY, -0.2}, {kX, kY, 0}, n, n, 1);
  AddBox(scene.Object("ceiling"), kOffice, {-kX, -kY, kHeight}, {kX, kY, kHeight + 0.2}, n, n, 1);
  AddBox(scene.Object("wall-west"), kOffice, {-kX - 0.2, -kY, -0.2}, {-kX, kY, kHeight + 0.2}, 1, n,
         n);
  AddBox(scene.Object("wall-east"), kOffice, {kX, -kY, -0.2}, {kX + 0.2, kY, kHeight + 0.2}, 1, n,
         n);
  AddBox(scene.Object("wall-north"), kOffice, {-kX - 0.2, kY, -0.2},
         {kX + 0.2, kY + 0.2, kHeight + 0.2}, n, 1, n);
  MeshBuilder& south = scene.Object("window-front");
  AddBox(south, kOffice, {-kX, -kY - 0.2, -0.2}, {kX, -kY, 0.7}, n, 1, 1);
  AddBox(south, kOffice, {-kX, -kY - 0.2, 2.7}, {kX, -kY, kHeight + 0.2}, n, 1, 1);
  for (int i = 0; i <= 10; ++i) {
    AddBox(south, kOffice, {-kX + 2 * i - 0.06, -kY - 0.18, 0.7},
           {-kX + 2 * i + 0.06, -kY - 0.02, 2.7}, 1, 1, n);
  }
  for (double y : {-2.4, 2.4}) {
    for (double x : {-3.4, 3.4}) {
      {
        MeshBuilder& open =
            scene.Object(std::string("pillar") + (y < 0 ? "-s" : "-n") + (x < 0 ? "w" : "e"));
        AddLathe(open, ShapePlacement({x, y, 0}),
                 {{0.24, 0}, {0.24, 0.1}, {0.2, 0.12}, {0.2, 2.9}, {0.24, 2.92}, {0.24, kHeight}},
                 scene.Steps(36, 6), scene.Steps(1.5, 1));
      }
    }
  }
}

void MakeLuminaires(SceneBuilder& scene) {
  const std::vector<Vec3d> lights = OfficeLights();
  for (size_t i = 0; i < lights.size(); ++i) {
    MeshBuilder& mesh = scene.Object("luminaire", static_cast<int>(i));
    const Vec3d at{lights[i].x, lights[i].y, 0};
    const int n = scene.Steps(4, 1);
    // A hood above the light, hung from two rods, with a grille on both sides of it.
    AddBlock(mesh, ShapePlacement({at.x, at.y, 2.72}), {0.62, 0.12, 0.02}, 0.012, n);
    for (double s : {-1.0, 1.0}) {
      AddBlock(mesh, ShapePlacement({at.x, at.y + s * 0.12, 2.67}), {0.62, 0.008, 0.045}, 0.005, n);
      AddTube(mesh,
              {{{at.x + 0.5 * s, at.y, 2.73}, 0.006}, {{at.x + 0.5 * s, at.y, kHeight}, 0.006}},
              scene.Steps(5, 3));
      for (int k = 1; k <= 5; ++k) {
        const double x = at.x + s * 0.11 * k;
        AddBox(mesh, kOffice, {x - 0.003, at.y - 0.11, 2.64}, {x + 0.003, at.y + 0.11, 2.69});
      }
    }
  }
}

void AddOfficeChair(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& at) {
  const int n = scene.Steps(8, 3), round = scene.Steps(8, 3);
  for (int i = 0; i < 5; ++i) {
    const SinCos sc = SinCosTurns(i / 5.0 + 0.05);
    AddTube(mesh,
            {{at.At({0.03 * sc.cos, 0.03 * sc.sin, 0.1}), 0.025},
             {at.At({0.3 * sc.cos, 0.3 * sc.sin, 0.07}), 0.014}},
            round);
    AddBall(mesh, at.At({0.3 * sc.cos, 0.3 * sc.sin, 0.03}), 0.03, scene.Steps(3, 1));
  }
  AddTube(mesh,
          {{at.At({0, 0, 0.09}), 0.03},
           {at.At({0, 0, 0.28}), 0.028},
           {at.At({0, 0, 0.3}), 0.018},
           {at.At({0, 0, 0.45}), 0.018}},
          round);
  AddBlock(mesh, at.Moved({0, 0, 0.48}), {0.24, 0.24, 0.045}, 0.035, n);
  AddTube(mesh,
          {{at.At({0, 0.2, 0.45}), 0.015},
           {at.At({0, 0.3, 0.5}), 0.015},
           {at.At({0, 0.32, 0.62}), 0.015},
           {at.At({0, 0.29, 0.8}), 0.015}},
          round);
  const int m = scene.Steps(9, 2);
  AddSolid(mesh, m, 1, m, [&](int i, int j, int k) {
    const double u = static_cast<double>(2 * i - m) / m, v = static_cast<double>(2 * k - m) / m;
    const double w = 0.22 * (1 - 0.18 * v * v);
    return at.At({w * u, 0.25 - 0.05 * u * u + 0.04 * v * v + 0.03 * j,
                  0.8 + 0.26 * v * (1 - 0.08 * u * u)});
  });
  for (double x : {-0.27, 0.27}) {
    AddTube(mesh,
            {{at.At({0.8 * x, 0.05, 0.45}), 0.012},
             {at.At({x, 0.05, 0.5}), 0.012},
             {at.At({x, 0.05, 0.66}), 0.012}},
            round);
    AddBlock(mesh, at.Moved({x, 0.0, 0.68}), {0.035, 0.13, 0.015}, 0.012, n);
  }
}

void AddScreen(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& at) {
  const int n = scene.Steps(4, 1);
  AddLathe(mesh, at, {{0.11, 0}, {0.11, 0.008}, {0.02, 0.015}, {0.018, 0.2}}, scene.Steps(18, 6),
           1);
  AddBlock(mesh, at.Moved({0, -0.01, 0.33}), {0.29, 0.014, 0.17}, 0.01, n);
  // The bezel stands out from the panel.
  for (double s : {-1.0, 1.0}) {
    AddBlock(mesh, at.Moved({0, -0.026, 0.33 + 0.162 * s}), {0.29, 0.006, 0.008}, 0.004, n);
    AddBlock(mesh, at.Moved({0.282 * s, -0.026, 0.33}), {0.008, 0.006, 0.154}, 0.004, n);
  }
}

void AddKeyboard(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& at) {
  AddBlock(mesh, at.Moved({0, 0, 0.008}), {0.225, 0.075, 0.008}, 0.005, scene.Steps(4, 1));
  const int columns = scene.Items(12, 6, 22), rows = scene.Items(4.5, 3, 6), n = scene.Steps(1, 1);
  const double pitch = 0.43 / columns, step = 0.135 / rows;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const double x = (c - 0.5 * (columns - 1)) * pitch, y = (r - 0.5 * (rows - 1)) * step;
      AddBlock(mesh, at.Moved({x, y, 0.018}), {0.42 * pitch, 0.42 * step, 0.004}, 0.002, n);
    }
  }
}

void MakeDesk(SceneBuilder& scene, int index, const ShapePlacement& at) {
  Prng rng(scene.seed(), "office-desk", static_cast<uint64_t>(index));
  const int n = scene.Steps(4, 1);
  MeshBuilder& desk = scene.Object("desk", index);
  AddBlock(desk, at.Moved({0, 0, 0.72}), {0.8, 0.4, 0.014}, 0.01, n);
  for (double x : {-0.74, 0.74}) {
    AddBlock(desk, at.Moved({x, 0.0, 0.02}), {0.03, 0.36, 0.02}, 0.01, n);
    AddTube(desk, {{at.At({x, 0.1, 0.03}), 0.03}, {at.At({x, 0.1, 0.71}), 0.03}},
            scene.Steps(10, 4));
  }
  AddBox(desk, at, {-0.7, 0.3, 0.3}, {0.7, 0.315, 0.68}, n, 1, n);
  // A drawer unit.
  AddBlock(desk, at.Moved({0.48, 0.05, 0.32}), {0.2, 0.27, 0.26}, 0.012, n);
  for (int d = 0; d < 3; ++d) {
    AddBlock(desk, at.Moved({0.48, -0.226, 0.15 + 0.17 * d}), {0.19, 0.01, 0.078}, 0.006, n);
    AddTube(desk,
            {{at.At({0.42, -0.25, 0.18 + 0.17 * d}), 0.006},
             {at.At({0.54, -0.25, 0.18 + 0.17 * d}), 0.006}},
            scene.Steps(5, 3));
  }
  MeshBuilder& things = scene.Object("desktop", index);
  const double turn = rng.Uniform(-0.03, 0.03);
  AddScreen(scene, things, at.Moved({rng.Uniform(-0.1, 0.1), 0.2, 0.734}));
  AddKeyboard(scene, things, at.Moved({turn, -0.12, 0.734}));
  AddBall(things, at.At({0.35 + turn, -0.12, 0.744}), scene.Steps(5, 2),
          [](Vec3d d) { return d.z < 0 ? 0.03 + 0.02 * d.z : 0.03; });
  AddCup(scene, things, at.Moved({-0.45 + turn, rng.Uniform(-0.1, 0.2), 0.734}));
  const int papers = 2 + rng.Below(5);
  for (int p = 0; p < papers; ++p) {
    const double x = rng.Uniform(-0.62, -0.3), y = rng.Uniform(-0.25, 0.0);
    AddBlock(things,
             ShapePlacement(at.At({x, y, 0.737 + 0.004 * p}), rng.Uniform(-0.06, 0.06) + 0.25),
             {0.148, 0.105, 0.0018}, 0.0006, 1);
  }
  if (rng.Below(2) == 0) {
    AddBooks(scene, things, at.Moved({0.55, 0.27, 0.734}), {0.35, 0.2, 0.3}, rng);
  } else {
    AddPot(scene, things, at.Moved({0.6, 0.22, 0.734}), 0.06, 0.1);
    AddPlant(scene, scene.Object("desk-plant", index), at.Moved({0.6, 0.22, 0.82}),
             rng.Below(2) == 0 ? PlantKind::kRosette : PlantKind::kFern, 0.16, rng);
  }
  const double cx = rng.Uniform(-0.25, 0.2), cy = rng.Uniform(-0.9, -0.6);
  const Vec3d seat = at.At({cx, cy, 0});
  // Chairs face their desk, give or take an eighth of a turn.
  const Vec3d front = at.At({0, 1, 0}) - at.At({0, 0, 0});
  const double yaw = (front.y > 0 ? 0.5 : 0.0) + 0.5 + rng.Uniform(-0.12, 0.12);
  AddOfficeChair(scene, scene.Object("chair", index), ShapePlacement(seat, yaw + 0.5));
}

}  // namespace

std::vector<Vec3d> OfficeLights() {
  std::vector<Vec3d> lights;
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < 4; ++i) lights.push_back({-7.5 + 5 * i, -5.1 + 3.4 * j, 2.65});
  }
  return lights;
}

void MakeOffice(SceneBuilder& scene) {
  MakeShell(scene);
  MakeLuminaires(scene);
  // Pairs of rows, back to back along a partition.
  for (int r = 0; r < kRows; ++r) {
    const int pair = r / 2;
    const double y = -4.2 + 2.9 * pair * 2 + (r % 2 == 0 ? -0.45 : 0.45) + 0.35;
    for (int c = 0; c < kColumns; ++c) {
      MakeDesk(scene, r * kColumns + c,
               ShapePlacement({-7.2 + 2.7 * c, y, 0}, r % 2 == 0 ? 0 : 0.5));
    }
  }
  for (int p = 0; p < 2; ++p) {
    for (int c = 0; c < kColumns; ++c) {
      const ShapePlacement at({-7.2 + 2.7 * c, -3.85 + 5.8 * p, 0.95});
      {
        MeshBuilder& open = scene.Object("partition", p * kColumns + c);
        AddBlock(open, at, {0.85, 0.02, 0.3}, 0.015, scene.Steps(6, 1));
      }
    }
  }
  int binders = 0;
  for (int s = 0; s < 9; ++s) {
    const Vec3d at{-8.6 + 1.3 * s, kY - 0.2, 0};
    AddShelves(scene, scene.Object("shelf", s), ShapePlacement(at), {1.2, 0.36, 2.0}, 5);
    for (int b = 0; b < 5; ++b) {
      Prng rng(scene.seed(), "office-binders", static_cast<uint64_t>(binders));
      AddBooks(scene, scene.Object("binders", binders++),
               ShapePlacement({at.x, at.y - 0.01, 0.025 + 0.395 * b}), {1.1, 0.3, 0.34}, rng);
    }
  }
  const Vec3d corners[] = {{9.3, 6.3, 0}, {-9.4, -6.4, 0}, {9.3, -6.3, 0}, {6.5, 6.5, 0}};
  const PlantKind kinds[] = {PlantKind::kTree, PlantKind::kBroadLeaves, PlantKind::kBlades,
                             PlantKind::kFern};
  for (int i = 0; i < 4; ++i) {
    Prng rng(scene.seed(), "office-plant", static_cast<uint64_t>(i));
    AddPot(scene, scene.Object("pot", i), ShapePlacement(corners[i]), 0.26, 0.45);
    AddPlant(scene, scene.Object("plant", i), ShapePlacement({corners[i].x, corners[i].y, 0.38}),
             kinds[i], i == 0 ? 1.9 : 1.1, rng);
  }
}

std::vector<BuiltinView> OfficeViews(uint64_t) {
  return {
      MakeView({-9.3, 0.2, 1.75}, {4, -1.2, 0.7}, 60,
               {{-8.25, -0.95, 2.05}, {-1.65, 5.25, 1.95}, {1.35, -4.3, 1.1}}, {240, 270, 270},
               0.15),
      MakeView({8.8, 5.2, 1.8}, {-4, -3.0, 0.7}, 60,
               {{8.6, 4.15, 1}, {-8.85, -1.35, 2.55}, {1.35, -4.3, 1.1}}, {240, 270, 270}, 0.15),
      MakeView({0.8, -1.0, 1.5}, {-2.2, 3.2, 0.8}, 60,
               {{1.25, -0.9, 2.3}, {-1.75, 4.5, 0.75}, {6.8, -6.15, 0.8}}, {270, 270, 270}, 0.15),
  };
}

}  // namespace sightline
