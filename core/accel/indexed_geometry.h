// SPDX-License-Identifier: Apache-2.0
//
// A compiled geometry and the structures built over it: what walks and queries need of a scene.
//
// Thread safety: immutable once built.
#ifndef SIGHTLINE_CORE_ACCEL_INDEXED_GEOMETRY_H_
#define SIGHTLINE_CORE_ACCEL_INDEXED_GEOMETRY_H_

#include <optional>

#include "core/accel/binary_bvh.h"
#include "core/accel/bvh.h"
#include "core/accel/kd_tree.h"
#include "core/intersect/prepared_geometry.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

struct IndexedGeometry {
  SceneGeometry geometry;
  Bvh bvh;                                 // Empty where a kd-tree stands alone.
  std::optional<KdTree> kd_tree;           // Where it was asked for, as the next two.
  std::optional<LeafTriangles> kd_leaves;  // Of kd_tree's ids, for walks that cull in leaves.
  std::optional<BinaryBvh> binary_bvh;
  // For one of the papers' tests, by whoever holds the scene and asks by it: tests and benchmarks.
  // Neither builders nor the server set it, since those tests are for comparison, and 48 bytes a
  // triangle for each would be the scene's to pay; without it a triangle is prepared anew for each
  // ray or packet that is put to it.
  std::optional<PreparedGeometry> prepared;

  // Whether there is something to hit, but no BVH: whatever leaves it open walks the kd-tree then.
  bool kd_tree_alone() const { return bvh.empty() && kd_tree && !kd_tree->empty(); }

  size_t MemoryBytes() const {
    return geometry.MemoryBytes() + bvh.MemoryBytes() + (kd_tree ? kd_tree->MemoryBytes() : 0) +
           (kd_leaves ? kd_leaves->MemoryBytes() : 0) +
           (binary_bvh ? binary_bvh->MemoryBytes() : 0) + (prepared ? prepared->MemoryBytes() : 0);
  }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_INDEXED_GEOMETRY_H_
