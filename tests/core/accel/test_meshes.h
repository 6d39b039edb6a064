// SPDX-License-Identifier: Apache-2.0
//
// Meshes that are hard on a BVH builder, compiled: scattered, identical, coplanar, needles, scale
// ratios of 10^6, huge coordinates, one triangle, none.
//
// Thread safety: functions only.
//
//   for (const TestMesh& mesh : NastyMeshes(rng, 1000)) SCOPED_TRACE(mesh.name),
//   Check(mesh.geometry);
#ifndef SIGHTLINE_TESTS_CORE_ACCEL_TEST_MESHES_H_
#define SIGHTLINE_TESTS_CORE_ACCEL_TEST_MESHES_H_

#include <cstddef>
#include <string>
#include <vector>

#include "core/mesh/scene_geometry.h"
#include "tests/support/random.h"

namespace sightline::testing_support {

struct TestMesh {
  std::string name;
  SceneGeometry geometry;
};

// `n` triangles of about `size` in the unit cube.
SceneGeometry ScatteredTriangles(TestRng& rng, size_t n, double size);

// One of each kind, of about `n` triangles where the kind allows it.
std::vector<TestMesh> NastyMeshes(TestRng& rng, size_t n);

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_ACCEL_TEST_MESHES_H_
