// SPDX-License-Identifier: Apache-2.0
//
// Whether a kd-tree is one of a given geometry: what kd_tree.h promises, checked. For tests, and
// for trees that come from files.
//
// Thread safety: functions only.
//
//   SL_RETURN_IF_ERROR(ValidateKdTree(tree, geometry));
#ifndef SIGHTLINE_CORE_ACCEL_KD_VALIDATION_H_
#define SIGHTLINE_CORE_ACCEL_KD_VALIDATION_H_

#include <cstdint>

#include "absl/status/status.h"
#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/mesh/scene_geometry.h"

namespace sightline {

// OK, or DataLoss naming the first fault found and where it is. Checks that every index is in range
// and every node, leaf and id is reached once, in order; that splits lie within their cells; that
// every triangle stands in each leaf it must and in no other; leaf boxes, reach, bounds, counts and
// depth. Cancelled or DeadlineExceeded from `cancel`. Whatever the tree, takes time in proportion
// to its nodes and to its references (KdTree::ids) times the depth, most of it in parallel within
// the calling thread's pool, and memory in proportion to nodes, references and triangles
// (KdValidationBytes); never reads out of bounds.
absl::Status ValidateKdTree(const KdTree& tree, const SceneGeometry& geometry,
                            const CancelToken* cancel = nullptr);

// At most the memory that takes meanwhile, about, of a sound tree: `ids` is the number of its
// references.
uint64_t KdValidationBytes(uint64_t triangles, uint64_t nodes, uint64_t ids, bool perfect,
                           int threads);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_KD_VALIDATION_H_
