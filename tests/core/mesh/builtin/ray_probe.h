// SPDX-License-Identifier: Apache-2.0
//
// A plain ray caster in doubles for the tests of the built-in scenes, independent of the engine: a
// median-split tree of boxes and Möller–Trumbore. Good for fractions of a picture, not for exact
// answers.
//
// Thread safety: const methods may be called from any thread.
//
//   RayProbe probe(scene.objects);
//   const std::optional<RayProbe::Hit> hit = probe.Cast(eye, direction, 1e9);
#ifndef SIGHTLINE_TESTS_CORE_MESH_BUILTIN_RAY_PROBE_H_
#define SIGHTLINE_TESTS_CORE_MESH_BUILTIN_RAY_PROBE_H_

#include <cstdint>
#include <optional>
#include <vector>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/mesh/object.h"

namespace sightline {

class RayProbe {
 public:
  struct Hit {
    double t;
    Vec3d normal;  // Not unit, toward the ray's origin.
  };

  explicit RayProbe(const std::vector<ObjectInput>& objects);

  // The nearest hit of from + t·direction with 0 < t < limit.
  std::optional<Hit> Cast(Vec3d from, Vec3d direction, double limit) const;

 private:
  struct Triangle {
    Vec3d a, b, c;
  };
  struct Node {
    Box3d box;
    uint32_t first = 0,
             count = 0;  // count > 0: a leaf. Else the children are this + 1 and `first`.
  };
  void Build(uint32_t begin, uint32_t end);

  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
};

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_CORE_MESH_BUILTIN_RAY_PROBE_H_
