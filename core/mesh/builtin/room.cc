// SPDX-License-Identifier: Apache-2.0
//
// A living room, 6.4 m (x) by 5 m (y) and 2.7 m high, its floor at z = 0: a window to the south
// with curtains, a sofa with cushions, a low table, a dining table with chairs, book shelves,
// plants, lamps, a rug and pictures.
#include "core/mesh/builtin/furniture.h"
#include "core/mesh/builtin/generators.h"
#include "core/mesh/builtin/noise.h"
#include "core/mesh/builtin/shapes.h"
#include "core/mesh/builtin/vegetation.h"

namespace sightline {
namespace {

constexpr double kX = 3.2, kY = 2.5, kHeight = 2.7;
const ShapePlacement kRoom({0, 0, 0});

void MakeShell(SceneBuilder& scene) {
  const int n = scene.Steps(5, 1);
  AddBox(scene.Object("floor"), kRoom, {-kX, -kY, -0.2}, {kX, kY, 0}, n, n, 1);
  AddBox(scene.Object("ceiling"), kRoom, {-kX, -kY, kHeight}, {kX, kY, kHeight + 0.2}, n, n, 1);
  AddBox(scene.Object("wall-west"), kRoom, {-kX - 0.2, -kY, -0.2}, {-kX, kY, kHeight + 0.2}, 1, n,
         n);
  AddBox(scene.Object("wall-east"), kRoom, {kX, -kY, -0.2}, {kX + 0.2, kY, kHeight + 0.2}, 1, n, n);
  AddBox(scene.Object("wall-north"), kRoom, {-kX - 0.2, kY, -0.2},
         {kX + 0.2, kY + 0.2, kHeight + 0.2}, n, 1, n);
  MeshBuilder& south = scene.Object("wall-south");
  const double y0 = -kY - 0.25, y1 = -kY;
  AddBox(south, kRoom, {-kX - 0.2, y0, -0.2}, {-1.5, y1, kHeight + 0.2}, n, 1, n);
  AddBox(south, kRoom, {1.5, y0, -0.2}, {kX + 0.2, y1, kHeight + 0.2}, n, 1, n);
  AddBox(south, kRoom, {-1.5, y0, -0.2}, {1.5, y1, 0.75}, n, 1, n);
  AddBox(south, kRoom, {-1.5, y0, 2.3}, {1.5, y1, kHeight + 0.2}, n, 1, n);
  MeshBuilder& frame = scene.Object("window-frame");
  for (double x : {-1.5, -0.53, 0.47, 1.44})
    AddBox(frame, kRoom, {x, y0 + 0.08, 0.75}, {x + 0.06, y0 + 0.14, 2.3}, 1, 1, n);
  for (double z : {0.75, 1.75, 2.25})
    AddBox(frame, kRoom, {-1.5, y0 + 0.09, z}, {1.5, y0 + 0.13, z + 0.05}, n, 1, 1);
  AddBlock(scene.Object("window-sill"), ShapePlacement({0, y1 + 0.05, 0.76}), {1.6, 0.13, 0.02},
           0.01, n);
  MeshBuilder& skirting = scene.Object("skirting");
  AddBox(skirting, kRoom, {-kX, kY - 0.015, 0}, {kX, kY, 0.09}, n, 1, 1);
  AddBox(skirting, kRoom, {-kX, -kY, 0}, {-kX + 0.015, kY - 0.015, 0.09}, 1, n, 1);
  AddBox(skirting, kRoom, {kX - 0.015, -kY, 0}, {kX, kY - 0.015, 0.09}, 1, n, 1);
}

void MakeCurtain(SceneBuilder& scene, int index, double x0, double x1) {
  const int across = scene.Steps(70, 8), up = scene.Steps(14, 2);
  const uint64_t seed = scene.seed() + static_cast<uint64_t>(index);
  AddSolid(scene.Object("curtain", index), across, 1, up, [&](int i, int j, int k) {
    const double u = static_cast<double>(i) / across, t = static_cast<double>(k) / up;
    const double gather = 1 - 0.25 * SmoothStep(0, 1, t) + 0.1 * (1 - t);
    const double x = Lerp(x0, x1, 0.5 + (u - 0.5) * gather);
    const double wave = SinCosTurns(u * 7 + 0.15 * GradientNoise({u * 3, t * 2, 0}, seed)).sin;
    return Vec3d{x, -kY + 0.14 + 0.045 * wave * (1.1 - 0.4 * t) + 0.006 * j, Lerp(0.06, 2.42, t)};
  });
}

void MakeSofa(SceneBuilder& scene) {
  const ShapePlacement at({-2.3, 0.35, 0}, 0.25);  // Against the west wall, looking east.
  MeshBuilder& frame = scene.Object("sofa");
  const int n = scene.Steps(9, 3);
  AddBlock(frame, at.Moved({0, 0, 0.22}), {1.05, 0.44, 0.12}, 0.05, n);
  AddBlock(frame, at.Moved({0, 0.4, 0.55}), {1.05, 0.12, 0.33}, 0.09, n);
  for (double x : {-1.12, 1.12})
    AddBlock(frame, at.Moved({x, 0, 0.34}), {0.12, 0.46, 0.26}, 0.09, n);
  for (double x : {-1.1, 1.1}) {
    for (double y : {-0.35, 0.35}) {
      AddLathe(frame, at.Moved({x, y, 0}), {{0.02, 0}, {0.035, 0.08}, {0.035, 0.11}},
               scene.Steps(10, 4), 1);
    }
  }
  for (int i = 0; i < 2; ++i) {
    AddBlock(scene.Object("seat", i), at.Moved({i == 0 ? -0.495 : 0.495, -0.06, 0.41}),
             {0.485, 0.37, 0.085}, 0.075, n + 2);
  }
  for (int i = 0; i < 4; ++i) {
    Prng rng(scene.seed(), "room-cushion", static_cast<uint64_t>(i));
    const double x = -0.78 + 0.5 * i + rng.Uniform(-0.06, 0.06);
    AddCushion(scene, scene.Object("cushion", i), at.Moved({x, 0.02, 0.5}), rng.Uniform(0.38, 0.46),
               rng);
  }
}

void MakeRug(SceneBuilder& scene) {
  const int nx = scene.Steps(64, 4), ny = scene.Steps(48, 4);
  const uint64_t seed = scene.seed();
  AddSolid(scene.Object("rug"), nx, ny, 1, [&](int i, int j, int k) {
    const double u = static_cast<double>(i) / nx, v = static_cast<double>(j) / ny;
    const double pile =
        0.004 * GradientNoise({u * 60, v * 45, 0}, seed) + 0.006 * Fbm({u * 3, v * 3, 4}, 3, seed);
    return Vec3d{Lerp(-1.75, 0.75, u), Lerp(-0.75, 1.35, v), k == 0 ? 0.002 : 0.022 + pile};
  });
}

void MakeTables(SceneBuilder& scene) {
  AddTable(scene, scene.Object("low-table"), ShapePlacement({-0.85, 0.35, 0.02}, 0.25),
           {1.1, 0.6, 0.42});
  AddTable(scene, scene.Object("dining-table"), ShapePlacement({1.9, -0.7, 0}), {1.0, 1.7, 0.75});
  for (int i = 0; i < 4; ++i) {
    Prng rng(scene.seed(), "room-chair", static_cast<uint64_t>(i));
    const double side = i < 2 ? -1.0 : 1.0;
    const double yaw = (side < 0 ? 0.25 : -0.25) + rng.Uniform(-0.05, 0.05);
    const double x = 1.9 + side * rng.Uniform(0.5, 0.75);
    AddChair(scene, scene.Object("chair", i), ShapePlacement({x, -1.15 + 0.9 * (i % 2), 0}, yaw),
             rng);
  }
  Prng rng(scene.seed(), "room-things");
  AddBowl(scene, scene.Object("fruit-bowl"), ShapePlacement({1.9, -0.6, 0.75}), 0.17, 7, rng);
  AddVase(scene, scene.Object("vase", 0), ShapePlacement({1.8, -1.2, 0.75}), 0.32, rng);
  AddVase(scene, scene.Object("vase", 1), ShapePlacement({-0.8, 0.65, 0.44}), 0.2, rng);
  for (int i = 0; i < 6; ++i) {
    const Vec3d at = i < 4 ? Vec3d{1.9 + (i < 2 ? -0.3 : 0.3), -1.0 + 0.55 * (i % 2), 0.75}
                           : Vec3d{-0.95 + 0.2 * (i - 4), 0.15, 0.44};
    AddCup(scene, scene.Object("cup", i), ShapePlacement(at, rng.Uniform()));
  }
  MeshBuilder& stack = scene.Object("magazines");
  for (int i = 0; i < 4; ++i) {
    AddBlock(stack,
             ShapePlacement({-0.8, -0.05, 0.45 + 0.018 * i}, 0.22 + rng.Uniform(-0.03, 0.03)),
             {0.14, 0.1, 0.008}, 0.003, scene.Steps(3, 1));
  }
}

void MakeShelves(SceneBuilder& scene) {
  constexpr int kBoards = 6;
  for (int c = 0; c < 3; ++c) {
    const Vec3d at{-1.35 + 1.0 * c, kY - 0.17, 0};
    AddShelves(scene, scene.Object("shelf", c), ShapePlacement(at), {0.98, 0.3, 2.2}, kBoards);
    for (int b = 0; b < kBoards; ++b) {
      const int index = c * kBoards + b;
      Prng rng(scene.seed(), "room-books", static_cast<uint64_t>(index));
      MeshBuilder& mesh = scene.Object("books", index);
      const ShapePlacement board({at.x, at.y - 0.01, 0.025 + 2.175 * b / kBoards});
      if (rng.Below(5) == 0) {
        AddBooks(scene, mesh, board.Moved({-0.22, 0, 0}), {0.44, 0.26, 0.32}, rng);
        AddVase(scene, mesh, board.Moved({0.25, 0, 0}), 0.26, rng);
      } else {
        AddBooks(scene, mesh, board, {0.9, 0.26, 0.32}, rng);
      }
    }
  }
}

void MakeWallThings(SceneBuilder& scene) {
  for (int i = 0; i < 3; ++i) {
    MeshBuilder& mesh = scene.Object("picture", i);
    const double y = -0.7 + 0.95 * i, h = i == 1 ? 0.35 : 0.25;
    const int n = scene.Steps(4, 1);
    AddBox(mesh, kRoom, {-kX, y - h, 1.6 - h}, {-kX + 0.012, y + h, 1.6 + h}, 1, n, n);
    for (double s : {-1.0, 1.0}) {
      AddBlock(mesh, ShapePlacement({-kX + 0.015, y + s * h, 1.6}), {0.014, 0.02, h + 0.02}, 0.008,
               n);
      AddBlock(mesh, ShapePlacement({-kX + 0.015, y, 1.6 + s * h}), {0.014, h - 0.02, 0.02}, 0.008,
               n);
    }
  }
  MeshBuilder& pendant = scene.Object("pendant");
  AddTube(pendant, {{{1.9, -0.7, 1.75}, 0.004}, {{1.9, -0.7, kHeight}, 0.004}}, scene.Steps(5, 3));
  AddLathe(pendant, ShapePlacement({1.9, -0.7, 1.5}),
           {{0.25, 0},
            {0.22, 0.08},
            {0.12, 0.2},
            {0.03, 0.26},
            {0.026, 0.25},
            {0.11, 0.19},
            {0.21, 0.07},
            {0.24, 0.003}},
           scene.Steps(36, 8), scene.Steps(2.5, 1));
}

void MakePlantCorner(SceneBuilder& scene) {
  const Vec3d spots[] = {{2.7, 2.0, 0},
                         {-2.75, 1.95, 0},
                         {-2.75, -1.95, 0},
                         {1.15, -kY + 0.1, 0.78},
                         {-1.2, -kY + 0.1, 0.78}};
  const PlantKind kinds[] = {PlantKind::kTree, PlantKind::kBroadLeaves, PlantKind::kBlades,
                             PlantKind::kRosette, PlantKind::kFern};
  const double heights[] = {1.7, 0.9, 0.9, 0.14, 0.2};
  for (int i = 0; i < 5; ++i) {
    Prng rng(scene.seed(), "room-plant", static_cast<uint64_t>(i));
    const bool small = heights[i] < 0.3;
    const double r = small ? 0.06 : 0.2, h = small ? 0.1 : 0.36;
    const ShapePlacement at(spots[i], rng.Uniform());
    AddPot(scene, scene.Object("pot", i), at, r, h);
    AddPlant(scene, scene.Object("plant", i), at.Moved({0, 0, 0.84 * h}), kinds[i], heights[i],
             rng);
  }
}

}  // namespace

void MakeRoom(SceneBuilder& scene) {
  MakeShell(scene);
  MakeCurtain(scene, 0, -1.95, -1.1);
  MakeCurtain(scene, 1, 1.1, 1.95);
  {
    MeshBuilder& open = scene.Object("curtain-rod");
    AddTube(open, {{{-2.1, -kY + 0.14, 2.45}, 0.014}, {{2.1, -kY + 0.14, 2.45}, 0.014}},
            scene.Steps(10, 4));
  }
  MakeSofa(scene);
  MakeRug(scene);
  MakeTables(scene);
  MakeShelves(scene);
  MakeWallThings(scene);
  AddLamp(scene, scene.Object("floor-lamp"), ShapePlacement({-2.75, -1.25, 0}), 1.6);
  MakePlantCorner(scene);
}

std::vector<BuiltinView> RoomViews(uint64_t) {
  return {
      MakeView({2.8, 0.55, 1.6}, {-1.5, 0.2, 0.8}, 62,
               {{1.7, 0.15, 1}, {2.2, -2.05, 0.5}, {3.7, -6.55, 2.25}}, {270, 270, 270}, 0.1),
      MakeView({-0.4, -1.9, 1.5}, {0.2, 2.5, 0.9}, 66,
               {{-1.7, -2.15, 1.8}, {2.65, -1.65, 1}, {-0.7, -6.35, 4.85}}, {270, 270, 300}, 0.1),
      MakeView({-1.6, 1.5, 1.45}, {2.2, -1.1, 0.7}, 60,
               {{-0.4, -0.5, 2}, {-1.45, 0.15, 0.4}, {-6.6, -6.75, 0.65}}, {240, 270, 240}, 0.1),
  };
}

}  // namespace sightline
