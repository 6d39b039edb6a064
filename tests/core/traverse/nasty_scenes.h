// SPDX-License-Identifier: Apache-2.0
//
// Small scenes that are meant to break a tracer, and rays aimed at what is weak in them: slivers,
// coplanar and duplicate faces, shared edges and vertices, zero areas, huge scale ratios, large
// coordinates, tiny and subnormal ones, one triangle, none.
//
// Thread safety: none; the scenes are immutable once made.
//
//   TestRng rng;
//   for (const NastyScene& scene : MakeNastyScenes(rng)) {
//     NastyRays rays(scene.indexed, rng);
//     const TraceRay ray = rays.Next();
#ifndef SIGHTLINE_TESTS_CORE_TRAVERSE_NASTY_SCENES_H_
#define SIGHTLINE_TESTS_CORE_TRAVERSE_NASTY_SCENES_H_

#include <cstdint>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "core/accel/bvh_builder.h"
#include "core/accel/indexed_geometry.h"
#include "core/mesh/object.h"
#include "core/traverse/trace_ray.h"
#include "tests/support/random.h"

namespace sightline::testing_support {

struct NastyScene {
  std::string name;
  std::vector<ObjectInput> objects;
  std::optional<Vec3d> origin;
  IndexedGeometry indexed;
};

// A failure fails the test.
Bvh BuildOrFail(const SceneGeometry& geometry, const BvhBuildOptions& options);
// Compiles and indexes; a failure fails the test. `max_leaf` as in BvhBuildOptions.
IndexedGeometry IndexObjects(const std::vector<ObjectInput>& objects, std::optional<Vec3d> origin,
                             int max_leaf = 16);

std::vector<NastyScene> MakeNastyScenes(TestRng& rng);

// Grids and closed meshes, also for watertight tests.
ObjectInput MakeGrid(int cells, double height, Vec3d corner,
                     TestRng& rng);  // y up; height 0: flat.
ObjectInput MakeClosedSphere(int rings, int sectors, double radius, Vec3d centre);
ObjectInput MakeClosedBox(int cells, Vec3d lo, Vec3d hi);

// Rays and segments aimed exactly, nearly and not at all at vertices, edges and faces of a scene.
class NastyRays {
 public:
  NastyRays(const IndexedGeometry& scene, TestRng& rng);

  // A stored point: a vertex, on an edge, on a face, an ulp beside those, near the scene, or
  // anywhere.
  Vec3f Point();
  // What a segment from `origin` ends at, or the direction of a ray from there.
  Vec3f Target(Vec3f origin, bool segment);
  uint32_t Source();  // kNoTriangle, mostly.
  TraceRay Next();
  // Fills *packet with `count` rays, of any mask and sources, and returns them one by one. Most
  // packets are narrow, as a tile's: around one target, but for a few strays now and then.
  std::vector<TraceRay> FillPacket(int count, RayPacket* packet);

 private:
  Vec3f Corner();
  Vec3f OnTriangle();

  const SceneGeometry& geometry_;
  TestRng& rng_;
  Box3f bounds_;
};

// The definition: every triangle, the predicate in expansions, one scalar at a time.
Hit TraceByDefinition(const SceneGeometry& geometry, const TraceRay& query);

// In hexadecimal floats.
struct Printed {
  const TraceRay& query;
};
std::ostream& operator<<(std::ostream& out, const Printed& p);

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_TRAVERSE_NASTY_SCENES_H_
