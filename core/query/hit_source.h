// SPDX-License-Identifier: Apache-2.0
//
// The triangle that camera hits lie on: what its hits share, and where on it each of them lies.
// placement-inl.h has the same for several hits at once.
//
// Thread safety: a plain value.
#ifndef SIGHTLINE_CORE_QUERY_HIT_SOURCE_H_
#define SIGHTLINE_CORE_QUERY_HIT_SOURCE_H_

#include <cstdint>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement.h"

namespace sightline {

// The most by which the exact parameter of a hit can differ from its float, relatively: one
// rounding (2^-24), the slab test's hold on it (2^-20, kSegmentEnd), and the distance's own error
// in doubles unless the ray grazes. A larger correction would say that doubles cannot tell where a
// grazing ray meets the plane; then t is as good.
inline constexpr double kHitParameterError = 0x1p-19;

struct HitSource {
  uint32_t triangle = kNoTriangle;
  Vec3d anchor, normal;  // A, and (B - A) × (C - A).
  Vec3d permanent;       // The same product with the sum of absolute values in each component.
  ClosestPoints closest;
  Plane plane;  // Oriented toward the origin; either way where that lies in it.

  HitSource(const IndexedGeometry& scene, Vec3f origin, uint32_t triangle);

  // Of a hit at O + t·D on it: the point where the ray meets its plane, if doubles can tell where
  // that is and it lies above the triangle; else the triangle's closest point to what t says.
  Placement PlacementOf(Vec3f origin, Vec3f direction, float t) const;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_HIT_SOURCE_H_
