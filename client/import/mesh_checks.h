// SPDX-License-Identifier: Apache-2.0
//
// Counts what is suspicious about a scene that was read: non-finite, degenerate, flat and duplicate
// triangles. It changes nothing: whether a triangle can be hit is for the scene compiler to say, by
// exact arithmetic; these counts tell a person what the file is like.
//
// Thread safety: free function.
//
//   SL_RETURN_IF_ERROR(CountDefects(scene.objects, &scene.report, options.cancel));
#ifndef SIGHTLINE_CLIENT_IMPORT_MESH_CHECKS_H_
#define SIGHTLINE_CLIENT_IMPORT_MESH_CHECKS_H_

#include <span>

#include "absl/status/status.h"
#include "client/import/import_types.h"

namespace sightline {

// A triangle counts as having no area when the cross product of its edges cannot be told from zero,
// given that a file's decimals were each rounded to a double. Let u = 2^-53, M the largest
// |coordinate| and L = max |edge component|; then L <= 2M (1 + u).
//   A coordinate is off by at most uM, so an edge component by 2uM, plus uL <= 2uM(1 + u) of its
//   own subtraction: 4uM in all. A product of two components is off by 2 · 4uM · L, plus its
//   rounding uL^2 <= 2uML: 10uML; the difference of two such, 20uML, plus its rounding u · 2L^2 <=
//   4uML: 24uML, and the second-order terms stay below 1uML. 32 = 2^5 is the next power of two.
inline constexpr double kZeroAreaUnits = 32 * 0x1p-53;

// True when every component of the cross product is within the bound. False for non-finite corners.
bool HasZeroArea(Vec3d a, Vec3d b, Vec3d c);

// Sets `triangles`, non_finite_triangles, degenerate_triangles, zero_area_triangles and
// duplicate_triangles. Positions are compared in the world: with each object's transform applied.
// Non-finite triangles take part in no other count. Not OK once `cancel` stops; the counts are not
// all there then. REQUIRES: every index is in range.
absl::Status CountDefects(std::span<const ObjectInput> objects, ImportReport* report,
                          const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_MESH_CHECKS_H_
