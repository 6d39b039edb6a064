// SPDX-License-Identifier: Apache-2.0
//
// A leaf that names a range of triangle ids, whichever tree it belongs to (binary_bvh.h,
// kd_tree.h), as views of up to sixteen triangles: of rows that were laid out beforehand where the
// scene has them (core/accel/leaf_triangles.h), else of rows fetched on the way.
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

#include "core/accel/leaf_rows.h"
#include "core/accel/leaf_triangles.h"
#include "core/traverse/leaf_view.h"

namespace sightline {

struct LeafRange {
  std::span<const uint32_t> ids;   // The whole tree's.
  const LeafTriangles* triangles;  // Of all ids; null: fetched on the way.
  uint32_t first, count;
};

class RangeView {
 public:
  // Triangles at, at + 1, ... of the range, sixteen at most. REQUIRES: at < range.count.
  RangeView(const SceneGeometry& geometry, const LeafRange& range, uint32_t at)
      : leaf(Rows(geometry, range, at),
             range.triangles != nullptr ? static_cast<uint32_t>(range.triangles->stride)
                                        : kMaxLeafTriangles,
             std::min<uint32_t>(kMaxLeafTriangles, range.count - at)) {}
  RangeView(const RangeView&) = delete;  // `leaf` may point into it.
  RangeView& operator=(const RangeView&) = delete;

 private:
  alignas(64) float fetched_[kMaxLeafTriangles * kLeafRows];  // Not initialized.

 public:
  const LeafView leaf;

 private:
  const float* Rows(const SceneGeometry& geometry, const LeafRange& range, uint32_t at) {
    if (range.triangles != nullptr) return range.triangles->rows.data() + range.first + at;
    const uint32_t count = std::min<uint32_t>(kMaxLeafTriangles, range.count - at);
    WriteLeafRows(geometry, range.ids.subspan(range.first + at, count), kMaxLeafTriangles,
                  fetched_);
    return fetched_;
  }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_LEAF_RANGE_H_
