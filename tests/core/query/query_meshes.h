// SPDX-License-Identifier: Apache-2.0
//
// Meshes whose right answers are known without tracing, a camera to see them from, and the
// definition of "lit" to check against.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_TESTS_CORE_QUERY_QUERY_MESHES_H_
#define SIGHTLINE_TESTS_CORE_QUERY_QUERY_MESHES_H_

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/accel/bvh_builder.h"
#include "core/accel/indexed_geometry.h"
#include "core/accel/kd_builder.h"
#include "core/geometry/camera.h"
#include "core/intersect/hit.h"
#include "core/intersect/predicate.h"
#include "core/mesh/object.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::testing_support {

// A rotation about a random axis, then a move.
Affine3d RandomPlacement(TestRng& rng, Vec3d centre);

// Fronts outward. `level` 0 is the icosahedron, each level has four times the triangles.
ObjectInput MakeIcosphere(int level, double radius, const Affine3d& placement);
// Half sides `half`; twelve triangles, fronts outward, triangles 2i and 2i + 1 are one face.
ObjectInput MakeBox(Vec3d half, const Affine3d& placement);
// A box whose faces are grids of their own: face i is cut into (i + 1) × (i + 1) squares, so that
// corners of one face lie amid edges of the next, and each face's winding is random.
ObjectInput MakePatchedBox(TestRng& rng, Vec3d half, const Affine3d& placement);
// A wavy height field over [0, size]², cells × cells squares, fronts up, no slope above about 31
// degrees.
ObjectInput MakeTerrain(int cells, double size, Vec3d corner);

ObjectInput Flipped(ObjectInput object);  // Fronts become backs.

IndexedGeometry MakeScene(const std::vector<ObjectInput>& objects,
                          std::optional<Vec3d> origin = Vec3d{},
                          const BvhBuildOptions& options = {});

// The scene with a kd-tree in place of its BVH.
IndexedGeometry OnKdTreeAlone(IndexedGeometry scene, const KdBuildOptions& options);

// Along -z with y up, a square picture.
Camera LookingDown(Vec3d eye, double tan_half_fov_y, uint32_t side);

// Whether no triangle but `source` blocks, by the predicate applied to every one.
bool IsLit(const SceneGeometry& geometry, const PredicateRay& ray, uint32_t source);
// The first hit of a ray by looking at every triangle.
Hit FirstHit(const SceneGeometry& geometry, const PredicateRay& ray);

// Whether every vertex is on or behind every triangle's plane, exactly.
bool IsExactlyConvex(const SceneGeometry& geometry);

// Where stored coordinates lie: about the origin, and so far out that a float's step is 2^-6.
inline constexpr Vec3d kCentres[] = {{0, 0, 0}, {1.5e5, -1.2e5, 1.4e5}};

// Calls test(rng, centre, half, placement) for ten boxes of half sides from `least` to 5 about each
// centre, rotated at random.
template <typename Test>
void ForEachRotatedBox(double least, const Test& test) {
  for (const Vec3d centre : kCentres) {
    for (uint64_t b = 0; b < 10; ++b) {
      TestRng rng(b);
      const double x = rng.Uniform(least, 5), y = rng.Uniform(least, 5), z = rng.Uniform(least, 5);
      const Affine3d placement = RandomPlacement(rng, centre);
      test(rng, centre, Vec3d{x, y, z}, placement);
      if (testing::Test::HasFatalFailure()) return;
    }
  }
}

inline int SideOf(const SceneGeometry& geometry, uint32_t triangle, Vec3f p) {
  const auto [a, b, c] = geometry.Corners(triangle);
  return SideOfPlane(a, b, c, p);
}

Vec3d RandomInBox(TestRng& rng, Vec3d half);
Vec3d RandomDirection(TestRng& rng);

// A point of a triangle that favours its corners, edges and their neighbourhoods at all scales.
Vec3d PointNearRim(TestRng& rng, const std::array<Vec3f, 3>& corners);

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_QUERY_QUERY_MESHES_H_
