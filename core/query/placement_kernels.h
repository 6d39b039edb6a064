// SPDX-License-Identifier: Apache-2.0
//
// The parts of placing hits (hit_placement.h) that are done for several of them at once, compiled
// for AVX2 and AVX-512 from one source (placement-inl.h), in the manner of core/traverse/kernels.h.
//
// Thread safety: functions only.
//
//   const PlacementKernels& kernels = PlacementKernelsFor(SimdTarget::kBest);
//   const uint32_t placed = kernels.place(source, packet, first, lanes, &points, positions);
#ifndef SIGHTLINE_CORE_QUERY_PLACEMENT_KERNELS_H_
#define SIGHTLINE_CORE_QUERY_PLACEMENT_KERNELS_H_

#include <cstdint>

#include "core/geometry/vec3.h"
#include "core/query/hit_source.h"
#include "core/query/touch_points.h"
#include "core/traverse/simd_target.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

struct PlacementKernels {
  // Hits placed together: half of what a TouchPoints holds.
  static constexpr int kLanes = TouchPoints::kMost / 2;

  // Hits on `source`, those of the packet's lanes first + i for each bit i of `lanes`. What
  // source.PlacementOf gives goes to point first % 16 + i; placed[i] is where the hit belongs if it
  // touches nothing else. Bit i of the result: the first try beside the source settled that; the
  // other hits are left to PlaceTouching. REQUIRES: first is a multiple of kLanes.
  uint32_t (*place)(const HitSource& source, const RayPacket& packet, int first, uint32_t lanes,
                    TouchPoints* points, Vec3f* placed);
  // Around the points that are used.
  TouchExtent (*extent)(const TouchPoints& points);
  // Bit i: point i is not apart from the triangle of these planes. Of points that are not used,
  // nothing.
  uint32_t (*not_apart)(const TouchPlanes& planes, const TouchPoints& points);
};

// kBest resolved. CHECKs that the target is available.
const PlacementKernels& PlacementKernelsFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_PLACEMENT_KERNELS_H_
