// SPDX-License-Identifier: Apache-2.0
//
// The triangle that camera hits lie on: what its hits share, and their placement as long as they
// touch no other; one at a time or four, to the same bits. The four go through the same operations
// in the same order, none of them fused.
//
// Thread safety: a plain value.
#ifndef SIGHTLINE_CORE_QUERY_HIT_SOURCE_H_
#define SIGHTLINE_CORE_QUERY_HIT_SOURCE_H_

#include <array>
#include <cstdint>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

struct HitSource {
  uint32_t triangle = kNoTriangle;
  Vec3d anchor, normal;  // A, and (B - A) × (C - A).
  Vec3d permanent;       // The same product with the sum of absolute values in each component.
  ClosestPoints closest;
  Plane plane;  // Oriented toward the origin; either way where that lies in it.

  HitSource(const IndexedGeometry& scene, Vec3f origin, uint32_t triangle);

  // Of a hit at O + t·D on it.
  Placement PlacementOf(Vec3f origin, Vec3f direction, float t) const;
  // Of the hits of four lanes, any of them the same.
  void PlacementsOf(const RayPacket& packet, const std::array<int, 4>& lanes,
                    const std::array<Placement*, 4>& placements) const;

  // Places points that touch nothing else, where the first try settles it. Bit i: (*placed)[i] is
  // what Place would give. The others are left to it.
  uint32_t PlaceBeside(const std::array<const Placement*, 4>& placements,
                       std::array<Vec3f, 4>* placed) const;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_HIT_SOURCE_H_
