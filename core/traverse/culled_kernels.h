// SPDX-License-Identifier: Apache-2.0
//
// The walks that cull within leaves (leaf_culling.h), compiled once per instruction set and chosen
// at run time, beside the ordinary ones of kernels.h.
//
// With the predicate every walk returns brute force's answer, bit for bit, whatever the culling.
// With another intersector the answer is that test's over the triangles that the walk comes to; it
// may differ from the same test over all triangles only within the test's own bound.
//
// Thread safety: the functions are pure; the scene must not change while one runs.
//
//   const CulledKernels& kernels = CulledKernelsFor(SimdTarget::kBest);
//   kernels.closest_single(scene, culling, rays, hits, cancel, &stats);
#ifndef SIGHTLINE_CORE_TRAVERSE_CULLED_KERNELS_H_
#define SIGHTLINE_CORE_TRAVERSE_CULLED_KERNELS_H_

#include <span>

#include "core/accel/indexed_geometry.h"
#include "core/base/cancel.h"
#include "core/traverse/leaf_culling.h"
#include "core/traverse/simd_target.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

// REQUIRES: the scene has the tree that `culling` names.
using TraceCulledRaysFn = bool (*)(const IndexedGeometry& scene, const LeafCulling& culling,
                                   std::span<const TraceRay> rays, std::span<Hit> hits,
                                   const CancelToken* cancel, WalkStats* stats);
using TraceCulledPacketFn = bool (*)(const IndexedGeometry& scene, const LeafCulling& culling,
                                     RayPacket& packet, const CancelToken* cancel,
                                     WalkStats* stats);

struct CulledKernels {
  TraceCulledRaysFn occluded_single, closest_single;
  TraceCulledPacketFn occluded_packet, closest_packet;
  // The intersector over every triangle; no structure. REQUIRES: it is not the predicate
  // (kernels.h has that).
  TraceCulledRaysFn occluded_brute, closest_brute;
};

// REQUIRES: SimdTargetAvailable(target).
const CulledKernels& CulledKernelsFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_CULLED_KERNELS_H_
