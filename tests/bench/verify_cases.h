// SPDX-License-Identifier: Apache-2.0
//
// Scenes, places, lights and points that are meant to bring out a wrong answer: in planes, on
// surfaces, edges and vertices, amid the points that they light, a million units away, behind
// coarse coordinates.
//
// Thread safety: functions and values; a Placer belongs to one thread.
//
//   Placer placer(scene.indexed, random);
//   const Place light = placer.Anything();
//   std::vector<LightSample> samples = MakeVerifyLights(placer, points, random);
#ifndef SIGHTLINE_TESTS_BENCH_VERIFY_CASES_H_
#define SIGHTLINE_TESTS_BENCH_VERIFY_CASES_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/base/parallel.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/query/mirrors.h"
#include "core/query/points.h"
#include "core/query/segments.h"
#include "core/query/tiles.h"
#include "tests/bench/independent_walk.h"
#include "tests/bench/random.h"

namespace sightline::bench {

struct VerifyScene {
  VerifyScene() = default;
  VerifyScene(std::string its_name, IndexedGeometry all);

  std::string name;  // Enough to make it again, for those that are made.
  IndexedGeometry indexed;
  IndependentWalk walk;  // Over indexed.geometry.
};

// A built-in scene of a random kind, size (up to `max_triangles`) and seed, or a soup of triangles
// on a small lattice (coplanar, duplicate, degenerate and sharing corners); at times with an origin
// far away (which makes its floats coarse), scaled to any size that floats have, with masks and
// culling per object, and built with random options, half of them with a kd-tree and half with a
// binary BVH beside the BVH.
VerifyScene MakeRandomScene(uint64_t max_triangles, Random& random, ThreadPool& pool);

// Where something stands, as stored floats.
enum class PlaceKind : uint8_t {
  kAnywhere,  // In a box half as large again as the scene's.
  kOnFace,
  kOnEdge,
  kOnVertex,
  kGrazing,     // In a triangle's plane, outside it; next to it or far off.
  kAmidPoints,  // Between two places of the surface: among the points.
  kFar,         // Up to a million units away.
};
inline constexpr int kPlaceKinds = 7;
const char* PlaceKindName(PlaceKind kind);

struct Place {
  PlaceKind kind = PlaceKind::kAnywhere;
  Vec3f at;
  uint32_t triangle = kNoTriangle;  // What it lies on, or grazes.
  // So far away that floats tell hardly any directions toward the scene apart: rays meet thousands
  // of triangles, all in doubt, and cost a thousand times as much. Few are asked for.
  bool extreme = false;
};
inline constexpr size_t kExtremeRays = 64;

class Placer {
 public:
  // REQUIRES: the scene has a triangle that is not inert.
  Placer(const IndexedGeometry& scene, Random& random) : scene_(scene), random_(random) {}

  Place Make(PlaceKind kind);
  Place Anything() { return Make(static_cast<PlaceKind>(random_.Below(kPlaceKinds))); }
  // A triangle that can block.
  uint32_t Triangle();
  // On triangle `id`: anywhere, or at dyadic weights, at times an ulp or two off.
  Vec3f OnTriangle(uint32_t id);

 private:
  Vec3f Nudged(Vec3f p);
  const IndexedGeometry& scene_;
  Random& random_;
};

struct CameraCase {
  Camera camera;
  TileRect tile;  // Up to 256×256 pixels; 8×8 from an extreme place.
  PlaceKind eye = PlaceKind::kAnywhere;
};
// Looks from a place at a place on a surface, along an axis at times; images of 8 to 16384 pixels a
// side, so that a tile is anything from a whole picture to a needle.
CameraCase MakeCamera(const IndexedGeometry& scene, Placer& placer, Random& random);

// Points near each other (on triangles that follow each other) in any manner, some with a source,
// some invalid; at times PreparedPoints::sources is empty: none has one.
PreparedPoints MakeVerifyPoints(const IndexedGeometry& scene, Placer& placer, Random& random);

struct LightCase {
  std::vector<LightSample> samples;
  PlaceKind kind = PlaceKind::kAnywhere;  // Of the first.
  bool directional = false;
  bool extreme = false;  // Of any.
};
// Points, directions (along axes, in planes, anywhere), up to three or some dozens of them, or the
// samples of a rectangle. `points` are those to be lit; a light may stand right at one.
LightCase MakeVerifyLights(const IndexedGeometry& scene, const PreparedPoints& points,
                           Placer& placer, Random& random);

// A mirror, at times: an object of the scene at any plane through it, or along a triangle of it.
// None where it would mirror the eye out of range.
std::vector<Mirror> MakeVerifyMirrors(const IndexedGeometry& scene, const Camera& camera,
                                      Placer& placer, Random& random);

PreparedSegments MakeVerifySegments(Placer& placer, Random& random);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_VERIFY_CASES_H_
