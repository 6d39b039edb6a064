// SPDX-License-Identifier: Apache-2.0
//
// A leaf that is a range of triangle ids of any length, as views of up to sixteen triangles, whose
// rows are fetched from the scene: what a leaf routine of a kd-tree goes through.
//
// Thread safety: a RangeLeaf is one walk's own.
//
//   RangeLeaf leaf(scene.geometry, tree.LeafIds(tree.leaves[node.leaf()]));
//   while (leaf.Next()) TestLeaf(leaf.view(), ...);
#ifndef SIGHTLINE_CORE_TRAVERSE_RANGE_LEAF_H_
#define SIGHTLINE_CORE_TRAVERSE_RANGE_LEAF_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/accel/bvh.h"
#include "core/accel/leaf_rows.h"
#include "core/mesh/scene_geometry.h"
#include "core/traverse/leaf_view.h"

namespace sightline {

class RangeLeaf {
 public:
  RangeLeaf(const SceneGeometry& geometry, std::span<const uint32_t> ids)
      : geometry_(geometry), ids_(ids) {}
  RangeLeaf(const RangeLeaf&) = delete;
  RangeLeaf& operator=(const RangeLeaf&) = delete;

  // Fetches the next triangles. False: there are no more.
  bool Next() {
    if (next_ == ids_.size()) return false;
    count_ = std::min<size_t>(kMaxLeafTriangles, ids_.size() - next_);
    stride_ = (count_ + kUnitTriangles - 1) / kUnitTriangles * kUnitTriangles;
    WriteLeafRows(geometry_, ids_.subspan(next_, count_), stride_, rows_);
    next_ += count_;
    return true;
  }

  // Valid until Next(). REQUIRES: Next() was true.
  LeafView view() const {
    return LeafView(rows_, static_cast<uint32_t>(stride_), static_cast<uint32_t>(count_));
  }

 private:
  const SceneGeometry& geometry_;
  const std::span<const uint32_t> ids_;
  size_t next_ = 0, count_ = 0, stride_ = 0;
  alignas(64) float rows_[kMaxLeafTriangles * kLeafRows + kLeafPadding];  // Not initialized.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_RANGE_LEAF_H_
