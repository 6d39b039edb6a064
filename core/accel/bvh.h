// SPDX-License-Identifier: Apache-2.0
//
// The bounding volume hierarchy: eight-wide nodes in structure-of-arrays order over leaves of at
// most sixteen triangles, whose corners are stored in structure-of-arrays order too (full leaves
// keep SIMD lanes busy and make the build faster, as papers 000 and 004 found too).
//
// Layout
//  * BvhNode: eight child boxes; a child is empty, an inner node
//    or a leaf (ChildRef). Empty slots come last and have an
//    inverted box (lo = +inf, hi = -inf), so no test accepts them.
//  * A leaf is 1..4 consecutive units of `leaves`, one unit for each four
//    triangles (count rounded up). With n units, row r (0..9) of the leaf is
//    `4n` floats at leaves[unit·kUnitFloats + r·4n]: rows 0-2 corner A's x, y,
//    z; 3-5 B; 6-8 C; row 9 the triangle ids as uint32 bits. Unused lanes repeat
//    nothing: their corners are 0 and their id is kNoTriangle. The array ends
//    with kLeafPadding floats, so that sixteen lanes may be loaded from any row.
//  * A compact BVH has no `leaves`: a unit is four ids in `leaf_ids`, kNoTriangle where there is
//    none, and walks fetch the corners from the scene (core/traverse/leaf_view.h).
//  * Boxes hold the stored floats of their triangles
//    exactly: they are minima and maxima, never rounded.
//  * Within a leaf, triangle ids ascend.
//
// Thread safety: immutable after construction.
#ifndef SIGHTLINE_CORE_ACCEL_BVH_H_
#define SIGHTLINE_CORE_ACCEL_BVH_H_

#include <cstdint>

#include "core/accel/child_ref.h"
#include "core/accel/leaf_mates.h"
#include "core/base/aligned_vector.h"
#include "core/base/serial_number.h"
#include "core/geometry/box3.h"

namespace sightline {

inline constexpr int kBvhWidth = 8;
inline constexpr int kLeafRows = 10;
inline constexpr int kUnitFloats = kUnitTriangles * kLeafRows;
inline constexpr int kLeafPadding = 16;

struct alignas(64) BvhNode {
  // bounds[axis] is the eight children's lower faces, bounds[axis + 3] their upper ones.
  float bounds[6][kBvhWidth];
  ChildRef child[kBvhWidth];
  uint32_t child_count = 0;
  uint32_t reserved[7] = {};
};
static_assert(sizeof(BvhNode) == 256);

struct Bvh {
  AlignedVector<BvhNode> nodes;      // nodes[0] is the root; empty for a scene with nothing to hit.
  AlignedVector<float> leaves;       // Empty if compact.
  AlignedVector<uint32_t> leaf_ids;  // Empty unless compact.
  LeafMates mates;                   // Where there are none, that costs speed alone.
  Box3f bounds;
  uint32_t leaf_count = 0;
  uint32_t triangle_count = 0;
  uint32_t max_depth = 0;  // Inner nodes on the longest path from the root, the root included.
  // What the heuristic expects a ray through the bounds to cost, over what it expected when the
  // tree was built: above 1 once it was fitted to triangles that moved apart (bvh_refit.h). Goes
  // along into a native scene file.
  double cost_growth = 1;
  // By which whoever notes leaves of it (ChildRefs) knows it again; of no native scene file.
  SerialNumber number;

  bool empty() const { return nodes.empty(); }
  bool has_leaf_rows() const { return leaf_ids.empty(); }
  // Of all leaves.
  size_t units() const {
    if (!has_leaf_rows()) return leaf_ids.size() / kUnitTriangles;
    return leaves.empty() ? 0 : (leaves.size() - kLeafPadding) / kUnitFloats;
  }
  // Whether `ref` is a leaf within what is stored of them.
  bool HoldsLeaf(ChildRef ref) const {
    const size_t end = size_t{ref.leaf_unit()} + ref.leaf_units();
    return ref.is_leaf() && (has_leaf_rows() ? end * kUnitFloats + kLeafPadding <= leaves.size()
                                             : end * kUnitTriangles <= leaf_ids.size());
  }
  size_t MemoryBytes() const {
    return nodes.size() * sizeof(BvhNode) + leaves.size() * sizeof(float) +
           leaf_ids.size() * sizeof(uint32_t) + mates.MemoryBytes();
  }
};

// Bound of max_depth that builders keep, so that walks can use fixed stacks.
inline constexpr uint32_t kMaxBvhDepth = 64;
// Entries a depth-first walk can have pending: at most kBvhWidth - 1 siblings per level, and the
// last ones.
inline constexpr uint32_t kBvhStackSize = kMaxBvhDepth * (kBvhWidth - 1) + 1;

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_BVH_H_
