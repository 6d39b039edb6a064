// SPDX-License-Identifier: Apache-2.0
//
// A cell of a kd-tree under construction: its references and their sorted events, and how they are
// handed down to its halves. Private to core/accel.
//
// Invariants: a reference's box lies within the cell and is not empty; events[axis] holds exactly
// the events of all references, sorted. Linear in the references, but for the sorting of those that
// the plane cuts.
//
// Thread safety: plain values; several cells may be worked on at once.
//
//   KdCell cell = RootCell(geometry, cancel);
//   auto [below, above] = SplitCell(geometry, std::move(cell), split, /*perfect=*/false);
#ifndef SIGHTLINE_CORE_ACCEL_KD_CELL_H_
#define SIGHTLINE_CORE_ACCEL_KD_CELL_H_

#include <cstdint>
#include <utility>
#include <vector>

#include "core/accel/kd_sweep.h"
#include "core/base/cancel.h"
#include "core/geometry/box3.h"
#include "core/mesh/scene_geometry.h"

namespace sightline::kd_build {

// What of a triangle lies in a cell.
struct KdReference {
  Box3f box;
  uint32_t id;
};

struct KdCell {
  Box3f bounds;
  std::vector<KdReference> refs;
  KdEvents events;
};

// All triangles that are not inert, by id. Incomplete once `cancel` has fired. REQUIRES: there are
// some, fewer than kMaxCellRefs.
KdCell RootCell(const SceneGeometry& geometry, const CancelToken* cancel);

// The lower and the upper half. With `perfect`, references that the plane cuts become the boxes of
// what of their triangles lies in a half. REQUIRES: split.axis >= 0, split.at within the bounds.
std::pair<KdCell, KdCell> SplitCell(const SceneGeometry& geometry, KdCell cell,
                                    const KdSplit& split, bool perfect);

}  // namespace sightline::kd_build

#endif  // SIGHTLINE_CORE_ACCEL_KD_CELL_H_
