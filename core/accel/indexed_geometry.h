// SPDX-License-Identifier: Apache-2.0
//
// A compiled geometry and the structures built over it: what walks and queries need of a scene.
//
// Thread safety: immutable once built.
#ifndef SIGHTLINE_CORE_ACCEL_INDEXED_GEOMETRY_H_
#define SIGHTLINE_CORE_ACCEL_INDEXED_GEOMETRY_H_

#include "core/accel/bvh.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

struct IndexedGeometry {
  SceneGeometry geometry;
  Bvh bvh;

  size_t MemoryBytes() const { return geometry.MemoryBytes() + bvh.MemoryBytes(); }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_INDEXED_GEOMETRY_H_
