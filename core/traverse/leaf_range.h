// SPDX-License-Identifier: Apache-2.0
//
// A leaf that names a range of triangle ids, whichever tree it belongs to (binary_bvh.h, kd_tree.h,
// bvh.h), as views of up to sixteen triangles: of rows that were laid out beforehand where the
// scene has them (core/accel/leaf_triangles.h, and the leaves of an ordinary BVH), else of rows
// fetched on the way.
//
// Thread safety: plain values; the calls are const.
//
//   for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
//     const RangeView view(scene.geometry, range, at);
//     Test(view.leaf, ...);
//   }
#ifndef SIGHTLINE_CORE_TRAVERSE_LEAF_RANGE_H_
#define SIGHTLINE_CORE_TRAVERSE_LEAF_RANGE_H_

#include <algorithm>
#include <cstdint>
#include <span>

#include "core/accel/bvh.h"
#include "core/accel/indexed_geometry.h"
#include "core/accel/kd_tree.h"
#include "core/accel/leaf_rows.h"
#include "core/accel/leaf_triangles.h"
#include "core/traverse/leaf_view.h"

namespace sightline {

struct LeafRange {
  std::span<const uint32_t> ids;   // The whole tree's.
  const LeafTriangles* triangles;  // Of all ids; null: fetched on the way.
  uint32_t first, count;
  // A leaf of an ordinary BVH: its own rows, as long as `stride`; at most sixteen triangles.
  const float* rows = nullptr;
  uint32_t stride = 0;

  // All of `ids`, fetched on the way.
  static LeafRange Of(std::span<const uint32_t> ids) {
    return {ids, nullptr, 0, static_cast<uint32_t>(ids.size())};
  }
  // A leaf of the scene's kd-tree. REQUIRES: the scene has one.
  static LeafRange Of(const IndexedGeometry& scene, const KdLeaf& leaf) {
    const KdTree& tree = *scene.kd_tree;
    return {{tree.ids.data(), tree.ids.size()},
            scene.kd_leaves ? &*scene.kd_leaves : nullptr,
            leaf.first,
            leaf.count};
  }
};

class RangeView {
 public:
  // Triangles at, at + 1, ... of the range, sixteen at most. REQUIRES: at < range.count.
  RangeView(const SceneGeometry& geometry, const LeafRange& range, uint32_t at)
      : leaf(Rows(geometry, range, at), Stride(range, at), Count(range, at)) {}
  RangeView(const RangeView&) = delete;  // `leaf` may point into it.
  RangeView& operator=(const RangeView&) = delete;

 private:
  static uint32_t Count(const LeafRange& range, uint32_t at) {
    return std::min<uint32_t>(kMaxLeafTriangles, range.count - at);
  }
  // Fetched rows are as long as they must be: most leaves are small.
  static uint32_t Stride(const LeafRange& range, uint32_t at) {
    if (range.rows != nullptr) return range.stride;
    if (range.triangles != nullptr) return static_cast<uint32_t>(range.triangles->stride);
    return (Count(range, at) + kUnitTriangles - 1) / kUnitTriangles * kUnitTriangles;
  }
  const float* Rows(const SceneGeometry& geometry, const LeafRange& range, uint32_t at) {
    if (range.rows != nullptr) return range.rows;
    if (range.triangles != nullptr) return range.triangles->rows.data() + range.first + at;
    WriteLeafRows(geometry, range.ids.subspan(range.first + at, Count(range, at)),
                  Stride(range, at), fetched_);
    return fetched_;
  }

  // Not initialized. Sixteen lanes may be loaded from any row.
  alignas(64) float fetched_[kMaxLeafTriangles * kLeafRows + kLeafPadding];

 public:
  const LeafView leaf;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_LEAF_RANGE_H_
