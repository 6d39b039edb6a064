// SPDX-License-Identifier: Apache-2.0
//
// How a world position becomes a stored one: fl32(world - origin), the subtraction in double,
// rounded once, without -0. Points, lights, segment ends and cameras are rebased as vertices are
// (CompileScene), so a point given by a vertex's own doubles gets that vertex's bits.
//
// Thread safety: pure functions.
//
//   if (!Rebase(position, geometry.origin, &stored)) ++invalid;
#ifndef SIGHTLINE_CORE_MESH_REBASE_H_
#define SIGHTLINE_CORE_MESH_REBASE_H_

#include <cmath>

#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// Whether no coordinate is beyond kMaxCoordinate, nor NaN. Without branches: ends of segments come
// by the million.
template <typename T>
bool IsInRange(Vec3<T> v) {
  constexpr T kMost = static_cast<T>(kMaxCoordinate);  // A power of two: exact.
  const int x = std::abs(v.x) <= kMost, y = std::abs(v.y) <= kMost, z = std::abs(v.z) <= kMost;
  return (x & y & z) != 0;
}

// -0 becomes +0.
inline Vec3f WithoutNegativeZero(Vec3f v) { return v + Vec3f{0.0f, 0.0f, 0.0f}; }

// False, and *stored = 0, if `world` is not finite or has a coordinate beyond kMaxCoordinate in the
// world or relative to `origin`.
inline bool Rebase(Vec3d world, Vec3d origin, Vec3f* stored) {
  const Vec3d relative = world - origin;
  const int in_world = IsInRange(world), in_scene = IsInRange(relative);
  const bool stores = (in_world & in_scene) != 0;
  *stored = stores ? WithoutNegativeZero(ToFloat(relative)) : Vec3f{};
  return stores;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_REBASE_H_
