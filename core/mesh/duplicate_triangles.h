// SPDX-License-Identifier: Apache-2.0
//
// Counts triangles that stand at the same three positions as an earlier one, their corners in any
// order. Vertices are compared by their stored bits, not by their index: meshes are often handed in
// unwelded.
//
// Thread safety: functions only. Uses the calling thread's pool (core/base/parallel.h).
//
//   report.duplicate_triangles = CountDuplicateTriangles(geometry.vertices, geometry.triangles,
//   inert);
#ifndef SIGHTLINE_CORE_MESH_DUPLICATE_TRIANGLES_H_
#define SIGHTLINE_CORE_MESH_DUPLICATE_TRIANGLES_H_

#include <array>
#include <cstdint>
#include <span>

#include "core/base/cancel.h"
#include "core/geometry/vec3.h"

namespace sightline {

// Triangles less the number of distinct ones; those in `inert` (ascending ids) are left out of
// both. Meaningless once `cancel` has fired. Needs up to 22 bytes a triangle while it runs, or 4 of
// them and 4 a vertex; more where most hashes are made to collide. REQUIRES: no coordinate is -0;
// indices in range.
uint64_t CountDuplicateTriangles(std::span<const Vec3f> vertices,
                                 std::span<const std::array<uint32_t, 3>> triangles,
                                 std::span<const uint32_t> inert,
                                 const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_DUPLICATE_TRIANGLES_H_
