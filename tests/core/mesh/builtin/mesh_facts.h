// SPDX-License-Identifier: Apache-2.0
//
// What the tests of the built-in scenes ask of an object: is it closed, which way does it face, has
// it triangles without area?
//
// Thread safety: pure functions.
//
//   EXPECT_TRUE(IsClosed(object));
#ifndef SIGHTLINE_TESTS_CORE_MESH_BUILTIN_MESH_FACTS_H_
#define SIGHTLINE_TESTS_CORE_MESH_BUILTIN_MESH_FACTS_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/geometry/vec3.h"
#include "core/mesh/object.h"

namespace sightline {

// Every directed edge occurs once, and so does its reverse.
inline bool IsClosed(const ObjectInput& object) {
  std::vector<uint64_t> edges, reversed;
  edges.reserve(object.indices.size());
  reversed.reserve(object.indices.size());
  for (size_t t = 0; t + 2 < object.indices.size(); t += 3) {
    for (size_t k = 0; k < 3; ++k) {
      const uint64_t a = object.indices[t + k], b = object.indices[t + (k + 1) % 3];
      edges.push_back(a << 32 | b);
      reversed.push_back(b << 32 | a);
    }
  }
  std::sort(edges.begin(), edges.end());
  std::sort(reversed.begin(), reversed.end());
  return !edges.empty() && edges == reversed &&
         std::adjacent_find(edges.begin(), edges.end()) == edges.end();
}

// Twice the area times the unit normal of the triangle whose first index is indices[at].
inline Vec3d TriangleNormal(const ObjectInput& object, size_t at) {
  const Vec3d a = object.vertices[object.indices[at]];
  return Cross(object.vertices[object.indices[at + 1]] - a,
               object.vertices[object.indices[at + 2]] - a);
}

// Positive when a closed object's fronts face outward.
inline double SignedVolume(const ObjectInput& object) {
  const Vec3d origin = object.vertices[0];
  double sum = 0;
  for (size_t t = 0; t + 2 < object.indices.size(); t += 3) {
    sum += Dot(object.vertices[object.indices[t]] - origin, TriangleNormal(object, t));
  }
  return sum / 6;
}

// Triangles whose area vanishes, as stored: in floats relative to `origin`.
inline size_t CountZeroArea(const ObjectInput& object, Vec3d origin = {}) {
  size_t count = 0;
  for (size_t t = 0; t + 2 < object.indices.size(); t += 3) {
    Vec3d p[3];
    for (size_t k = 0; k < 3; ++k)
      p[k] = ToDouble(ToFloat(object.vertices[object.indices[t + k]] - origin));
    const Vec3d normal = Cross(p[1] - p[0], p[2] - p[0]);
    count += normal == Vec3d{} ? 1 : 0;
  }
  return count;
}

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_CORE_MESH_BUILTIN_MESH_FACTS_H_
