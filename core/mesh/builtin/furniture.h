// SPDX-License-Identifier: Apache-2.0
//
// Furniture for the scenes with rooms in them, life-sized in metres: every piece is added to the
// open object of a SceneBuilder, at a placement whose origin is on the floor (or shelf, or table)
// below its middle.
//
// Thread safety: one thread per SceneBuilder.
//
//   MeshBuilder& mesh = scene.Object("chair", i);
//   AddChair(scene, mesh, ShapePlacement({1, 2, 0}, 0.25), rng);
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_FURNITURE_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_FURNITURE_H_

#include <vector>

#include "core/mesh/builtin/prng.h"
#include "core/mesh/builtin/scene_builder.h"
#include "core/mesh/builtin/shapes.h"

namespace sightline {

// A wooden chair, its back toward +y, 0.45 m wide and 0.95 m high.
void AddChair(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Prng& rng);
// A table of the given width, depth and height on four turned legs.
void AddTable(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d size);
// A vase `height` high, shaped by `rng`, hollow from above.
void AddVase(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double height,
             Prng& rng);
// A row of standing books along x that fills the width of `space`, none deeper or higher than that:
// width, depth and height.
void AddBooks(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d space,
              Prng& rng);
// Shelves: a case of the given width, depth and height with `boards` compartments, backed toward
// +y.
void AddShelves(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, Vec3d size,
                int boards);
// A cushion standing on its edge, leaning back toward +y, `size` wide.
void AddCushion(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double size,
                Prng& rng);
// A cup with a handle, 0.09 m high.
void AddCup(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place);
// A lamp with a pole and an open shade, `height` high.
void AddLamp(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double height);
// A basket of `count` balls of fruit or stone, `radius` wide.
void AddBowl(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double radius,
             int count, Prng& rng);

// Finds room on a floor for round things: none overlaps another.
class FloorPlan {
 public:
  // Keeps a disc free of what is placed later.
  void Reserve(double x, double y, double radius) { discs_.push_back({x, y, radius}); }
  // Draws positions within [lo, hi] until a disc fits, at most 24 times, and reserves it. False: no
  // room.
  bool Place(Prng& rng, Vec3d lo, Vec3d hi, double radius, Vec3d* at);

 private:
  struct Disc {
    double x, y, radius;
  };
  std::vector<Disc> discs_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_FURNITURE_H_
