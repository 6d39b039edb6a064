// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/scene_geometry.h"

#include <algorithm>

#include "core/base/check.h"
#include "core/mesh/scene_compiler.h"

namespace sightline {

uint32_t SceneGeometry::ObjectOf(uint32_t id) const {
  SIGHTLINE_DCHECK_LT(id, triangles.size());
  // The last object that begins at or before `id`: empty ones that begin there too come before it.
  const auto after = std::upper_bound(
      objects.begin(), objects.end(), id,
      [](uint32_t value, const ObjectRecord& object) { return value < object.first_triangle; });
  return static_cast<uint32_t>(after - objects.begin()) - 1;
}

size_t SceneGeometry::MemoryBytes() const {
  size_t bytes = vertices.capacity() * sizeof(vertices[0]) +
                 triangles.capacity() * sizeof(triangles[0]) +
                 objects.capacity() * sizeof(objects[0]) + inert.capacity() * sizeof(inert[0]);
  for (const ObjectRecord& object : objects) {
    bytes += object.name.capacity();
    if (object.source_vertices != nullptr) bytes += object.source_vertices->size() * sizeof(Vec3d);
  }
  return bytes;
}

absl::StatusOr<SceneGeometry> CompileScene(std::span<const ObjectInput> objects,
                                           std::optional<Vec3d> origin, const MeshLimits& limits,
                                           const CancelToken* cancel) {
  std::vector<ObjectSource> sources(objects.size());
  for (size_t i = 0; i < objects.size(); ++i) sources[i].input = &objects[i];
  return CompileSources(sources, /*base=*/nullptr, origin, limits, cancel);
}

}  // namespace sightline
