// SPDX-License-Identifier: Apache-2.0
//
// The second half of a BVH build: gathers a binary tree into eight-wide nodes, as its WideCosts
// decided, and lays out the leaves. Private to core/accel.
//
// Nodes stand in depth-first order, each before what is below it; leaves in the order in which the
// nodes that hold them stand. A node's children stand by what they are expected to cost, the
// cheapest last.
//
// Thread safety: functions only.
#ifndef SIGHTLINE_CORE_ACCEL_WIDE_TREE_H_
#define SIGHTLINE_CORE_ACCEL_WIDE_TREE_H_

#include "absl/status/statusor.h"
#include "core/accel/binary_tree.h"
#include "core/accel/bvh.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline::bvh_build {

// Compact without `leaf_rows`. ResourceExhausted: more leaf units than a ChildRef can number.
// Incomplete once `cancel` has fired. REQUIRES: a complete tree over triangles of `geometry`. Sorts
// the ids within its leaves.
absl::StatusOr<Bvh> GatherWideTree(BinaryTree& tree, const SceneGeometry& geometry, bool leaf_rows,
                                   const CancelToken* cancel);

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_WIDE_TREE_H_
