// SPDX-License-Identifier: Apache-2.0
//
// Validation of a compiled geometry: that it keeps the promises of scene_geometry.h. Used by tests,
// and by whatever reads a geometry that it did not compile.
//
// Thread safety: functions only.
//
//   SL_RETURN_IF_ERROR(ValidateGeometry(geometry));
#ifndef SIGHTLINE_CORE_MESH_GEOMETRY_VALIDATION_H_
#define SIGHTLINE_CORE_MESH_GEOMETRY_VALIDATION_H_

#include "absl/status/status.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// OK when: there are at most kMaxGeometryItems triangles, and as many vertices; origin, transforms
// and roundings are finite and in range; objects have names of their own and follow each other
// without a gap, in triangles and in vertices; every vertex is finite,
// within kMaxCoordinate and without -0, or three NaNs; every triangle's indices are its object's;
// `inert` lists exactly the triangles that are not finite or have no area, ascending; bounds,
// `uniform` and the report's counts agree (duplicates, which only a search would tell, are merely
// possible). Otherwise DataLoss naming a fault; Cancelled or DeadlineExceeded from `cancel`.
// Linear, in parallel within the calling thread's pool.
absl::Status ValidateGeometry(const SceneGeometry& geometry, const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_GEOMETRY_VALIDATION_H_
