// SPDX-License-Identifier: Apache-2.0
//
// Finds out which triangles of a BVH's leaves share an edge.
//
// Thread safety: functions only. Uses the calling thread's pool (core/base/parallel.h).
#ifndef SIGHTLINE_CORE_ACCEL_LEAF_MATES_FINDER_H_
#define SIGHTLINE_CORE_ACCEL_LEAF_MATES_FINDER_H_

#include "core/accel/bvh.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// The mate of an edge's mate is that edge; both have their ends at the same stored positions,
// whatever their indices. Where more than two triangles stand at an edge, those that run along it
// in contrary directions are paired, first within a leaf, then in the order of their places, then
// those left over; one may have none. Depends on tree and geometry alone, but for mates that are
// missed where hashes of positions were made to collide. Meaningless once `cancel` has fired. Needs
// up to 60 bytes a triangle while it runs, mostly 24, and 16 a vertex. REQUIRES: the tree is over
// the geometry, no coordinate of which is -0.
LeafMates FindLeafMates(const Bvh& bvh, const SceneGeometry& geometry,
                        const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_LEAF_MATES_FINDER_H_
