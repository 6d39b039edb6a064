// SPDX-License-Identifier: Apache-2.0
//
// How a world position becomes a stored one: fl32(world - origin), the subtraction in double,
// rounded once, without -0. Points, lights, segment ends and cameras are rebased as vertices are
// (CompileScene), so a point given by a vertex's own doubles gets that vertex's bits.
//
// Thread safety: a pure function.
//
//   if (!Rebase(position, geometry.origin, &stored)) ++invalid;
#ifndef SIGHTLINE_CORE_MESH_REBASE_H_
#define SIGHTLINE_CORE_MESH_REBASE_H_

#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// False, and *stored = 0, if `world` is not finite or has a coordinate beyond kMaxCoordinate in the
// world or relative to `origin`.
inline bool Rebase(Vec3d world, Vec3d origin, Vec3f* stored) {
  const Vec3d relative = world - origin;
  if (!(MaxAbs(world) <= kMaxCoordinate) || !(MaxAbs(relative) <= kMaxCoordinate)) {
    *stored = {};
    return false;
  }
  *stored = ToFloat(relative) + Vec3f{0.0f, 0.0f, 0.0f};  // -0 becomes +0.
  return true;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_REBASE_H_
