// SPDX-License-Identifier: Apache-2.0
//
// A leaf of the BVH as its rows (layout: core/accel/bvh.h), fetched from the scene where the BVH is
// compact, and the object flags of a triangle.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_LEAF_VIEW_H_
#define SIGHTLINE_CORE_TRAVERSE_LEAF_VIEW_H_

#include <bit>
#include <cstdint>

#include "core/accel/bvh.h"
#include "core/accel/indexed_geometry.h"
#include "core/accel/leaf_rows.h"
#include "core/intersect/predicate.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

struct LeafView {
  const float* rows;
  size_t stride;
  uint32_t count;

  LeafView(const IndexedGeometry& scene, ChildRef ref) : count(ref.leaf_count()) {
    const Bvh& bvh = scene.bvh;
    if (bvh.has_leaf_rows()) [[likely]] {
      rows = bvh.leaves.data() + size_t{ref.leaf_unit()} * kUnitFloats;
      stride = ref.leaf_units() * kUnitTriangles;
    } else {
      rows = fetched_;
      stride = kMaxLeafTriangles;
      WriteLeafRows(scene.geometry,
                    {bvh.leaf_ids.data() + size_t{ref.leaf_unit()} * kUnitTriangles, count},
                    kMaxLeafTriangles, fetched_);
    }
  }
  LeafView(const float* rows, size_t stride, uint32_t count)
      : rows(rows), stride(stride), count(count) {}

  const float* id_row() const { return rows + 9 * stride; }  // Their bits.
  uint32_t id(uint32_t lane) const { return std::bit_cast<uint32_t>(id_row()[lane]); }
  Vec3f corner(int corner, uint32_t lane) const {
    const float* p = rows + static_cast<size_t>(3 * corner) * stride + lane;
    return {p[0], p[stride], p[2 * stride]};
  }

  LeafView(const LeafView&) = delete;  // `rows` may point into it.
  LeafView& operator=(const LeafView&) = delete;

 private:
  // Not initialized: most leaves have rows.
  alignas(64) float fetched_[kMaxLeafTriangles * kLeafRows];
};

// Whether hits must be put to ObjectBlocks at all. An empty mask sees nothing, not even a uniform
// scene.
inline bool MustAskObjects(const SceneGeometry& geometry, uint32_t mask) {
  return !geometry.uniform || mask == 0;
}

// Whether the object that owns triangle `id` is seen by `mask` and, if it culls, shows its other
// side to the origin. `side_of_origin` is SideOfPlane's answer for the origin. Only asked where
// MustAskObjects.
inline bool ObjectBlocks(const SceneGeometry& geometry, uint32_t id, uint32_t mask,
                         int side_of_origin) {
  const ObjectRecord& object = geometry.objects[geometry.ObjectOf(id)];
  if ((object.mask & mask) == 0) return false;
  switch (object.culling) {
    case Culling::kNone:
      return true;
    case Culling::kBack:
      return side_of_origin > 0;
    case Culling::kFront:
      return side_of_origin < 0;
  }
  return true;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_LEAF_VIEW_H_
