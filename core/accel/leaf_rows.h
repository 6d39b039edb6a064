// SPDX-License-Identifier: Apache-2.0
//
// Writes a leaf's rows (layout: core/accel/bvh.h) from the scene's own arrays: once when a BVH is
// built, or whenever a walk comes to a leaf of a compact one.
//
// Thread safety: functions only.
//
//   WriteLeafRows(geometry, ids, kMaxLeafTriangles, rows);
#ifndef SIGHTLINE_CORE_ACCEL_LEAF_ROWS_H_
#define SIGHTLINE_CORE_ACCEL_LEAF_ROWS_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/mesh/scene_geometry.h"

namespace sightline {

// Ten rows of `stride` lanes; those past the ids are unused ones.
// REQUIRES: stride is a multiple of kUnitTriangles and not below ids.size().
void WriteLeafRows(const SceneGeometry& geometry, std::span<const uint32_t> ids, size_t stride,
                   float* rows);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_LEAF_ROWS_H_
