// SPDX-License-Identifier: Apache-2.0
//
// Paper 000's other way to the boxes of a kd-tree's leaves: computed on the way, not stored. The
// engine's walks know stored ones, and cells in their place (LeafCulling::cell_boxes); this is the
// same walk with a leaf's box made, at every visit, of its triangles' corners, cut to the cell.
// That is the stored box again, but with perfect splits: what it takes to make it is all that
// differs.
//
// Thread safety: functions over constant data.
//
//   culling.tree = CulledTree::kKdTree;
//   TracePackets(scene, culling, picture, &stats, ClosestWithComputedBoxes());
#ifndef SIGHTLINE_TESTS_BENCH_PAPERS_LEAF_BOXES_H_
#define SIGHTLINE_TESTS_BENCH_PAPERS_LEAF_BOXES_H_

#include "core/traverse/culled_kernels.h"

namespace sightline::bench {

// As CulledKernels::closest_packet, by the widest registers of this machine; `cell_boxes` is not
// read. REQUIRES, of a call: the scene has a kd-tree.
TraceCulledPacketFn ClosestWithComputedBoxes();

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PAPERS_LEAF_BOXES_H_
