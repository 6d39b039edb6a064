// SPDX-License-Identifier: Apache-2.0
//
// A scene's triangles prepared for one of the papers' tests (intersector.h), by id: 48 bytes each.
//
// Thread safety: immutable after construction.
//
//   const PreparedGeometry prepared = PrepareGeometry(geometry, Intersector::kWald);
//   Intersect(prepared.kind, prepared.triangles[id], origin, direction, t_max, &hit);
#ifndef SIGHTLINE_CORE_INTERSECT_PREPARED_GEOMETRY_H_
#define SIGHTLINE_CORE_INTERSECT_PREPARED_GEOMETRY_H_

#include <cstddef>

#include "core/base/aligned_vector.h"
#include "core/base/parallel.h"
#include "core/intersect/intersector.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

struct PreparedGeometry {
  Intersector kind = Intersector::kExact;
  AlignedVector<PreparedTriangle> triangles;  // Those of inert ones mean nothing.

  size_t MemoryBytes() const { return triangles.size() * sizeof(PreparedTriangle); }
};

// In parallel within the pool of the calling thread. REQUIRES: kind != kExact.
inline PreparedGeometry PrepareGeometry(const SceneGeometry& geometry, Intersector kind) {
  constexpr size_t kGrain = 1 << 14;
  PreparedGeometry prepared;
  prepared.kind = kind;
  prepared.triangles.ResizeUninitialized(geometry.triangles.size());
  ParallelFor(geometry.triangles.size(), kGrain, [&](size_t begin, size_t end) {
    for (size_t id = begin; id < end; ++id) {
      const auto [a, b, c] = geometry.Corners(static_cast<uint32_t>(id));
      prepared.triangles[id] = PrepareTriangle(kind, a, b, c);
    }
  });
  return prepared;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_INTERSECT_PREPARED_GEOMETRY_H_
