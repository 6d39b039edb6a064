// SPDX-License-Identifier: Apache-2.0
//
// Trees and plants: closed tubes for wood and stems, open blades for leaves. The area of a tree's
// leaves stays the same however many it has, so that its shadow keeps its density at every size of
// a scene.
//
// Thread safety: one thread per SceneBuilder.
//
//   std::vector<Twig> twigs;
//   AddWood(scene, scene.Object("tree", i), place, shape, rng, &twigs);
//   AddLeaves(scene.Object("leaves", i), twigs, {.count = 2000, .area = 60}, rng);
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_VEGETATION_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_VEGETATION_H_

#include <vector>

#include "core/mesh/builtin/prng.h"
#include "core/mesh/builtin/scene_builder.h"
#include "core/mesh/builtin/shapes.h"

namespace sightline {

struct TreeShape {
  double height, crown_radius, trunk_radius;
  bool conifer;
  int branches;  // From the trunk; each carries twigs.
  int twigs;     // Per branch.
};

// Where leaves grow.
struct Twig {
  Vec3d from, to;
};

// Trunk, branches and twigs; `twigs` is appended to.
void AddWood(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place,
             const TreeShape& shape, Prng& rng, std::vector<Twig>* twigs);

struct LeafCloud {
  int count;
  double area;         // Of all leaves together, m².
  double slenderness;  // Length / width.
  double max_length;   // However few there are, m.
  double spread;       // How far from its twig a leaf may start, m.
  int cells;           // As in AddLeaf.
};
// Leaves along the twigs. REQUIRES: twigs is not empty.
void AddLeaves(MeshBuilder& mesh, const std::vector<Twig>& twigs, const LeafCloud& cloud,
               Prng& rng);

// A flower pot with soil, `radius` at the rim; the soil is at 0.85 of `height`.
void AddPot(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, double radius,
            double height);

enum class PlantKind { kTree, kFern, kRosette, kBlades, kCactus, kBroadLeaves, kTrailing };
// A plant `height` high, rooted at the placement's origin.
void AddPlant(SceneBuilder& scene, MeshBuilder& mesh, const ShapePlacement& place, PlantKind kind,
              double height, Prng& rng);
// A fern of `fronds` arching fronds with `leaflets` pairs each.
void AddFern(MeshBuilder& mesh, const ShapePlacement& place, double height, int fronds,
             int leaflets, int cells, Prng& rng);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_VEGETATION_H_
