// SPDX-License-Identifier: Apache-2.0
//
// The kd-tree: space cut by axis-aligned planes into cells. A leaf names the triangles that reach
// into its cell, as a range of ids, and carries the box of what of them lies in it, so that splits
// which only cut empty space off a leaf are folded into that box (paper 000, section 2). Leaves may
// hold any number of triangles: with ray or vertex culling within them small trees are as fast as
// deep ones (papers 000 and 001).
//
// Layout
//  * KdNode: eight bytes. An inner node has a split position, an
//    axis and a pair of children side by side, the lower one first.
//    A leaf refers to a KdLeaf, or to nothing where its cell is
//    empty. nodes[0] is the root; no node is reached twice.
//  * KdLeaf: a box, and a range of `ids`, which ascend
//    within it. Leaves stand in depth-first order, the lower
//    child before the upper one, and so do their ranges.
//  * A triangle stands in each leaf whose cell its reference reaches into: with an extent along the
//    split axis on both sides, in both; one that merely touches the plane, on the side where it
//    lies; one that lies in the plane, on one of the two.
//  * A reference is the triangle's box cut to the cell, or with perfect splits the box of the
//    triangle cut to the cell, rounded outward. A leaf's box is the hull of its references.
//  * `reach`, with perfect splits only: by node, the hull of
//    the whole boxes of the triangles below.
//
// What walks may rely on, with the slab test of core/geometry/box_ray.h. A cell's interval along a
// ray, [entry, exit], is made of the same monotone products fl(fl(split - o)·inv) as a box's.
//  1. Any hit. A triangle is hit at a point p of it, at the exact parameter t. Some leaf that names
//     it has p in its closed cell and in its box, so entry <= t·kBoxExitScale + kBoxExitShift and t
//     <= exit·kBoxExitScale + kBoxExitShift hold there as they do for boxes: a walk that enters
//     every child for which
//         max(entry, 0) <= exit·kBoxExitScale + kBoxExitShift
//     comes to that leaf. No other margin is needed: these two carry the roundings of one product
//     each, and so do splits.
//  2. Closest hit, no perfect splits. Distances are held to the entry E of the triangle's own box
//     (core/intersect/hit.h), rightly so where the plane's quotient is off by more than the cell is
//     wide. Let e = max(E, 0), which with a hit is <= X·kBoxExitScale + kBoxExitShift, X being the
//     box's exit. Going down the tree, there is always a child that names the triangle, with entry
//     <= e and e <= exit·kBoxExitScale + kBoxExitShift: the near one if e <= T·kBoxExitScale +
//     kBoxExitShift for the split's parameter T and it names the triangle; if it does not, the box
//     lies beyond the plane, T <= E by monotony, and the far one will do; if e is greater, the far
//     one names it, or X <= T, against the hit. So a walk that leaves out what is entered after the
//     nearest distance found, without a margin, still tests every triangle with a distance that is
//     less, or equal: ties are found.
//  3. Closest hit, perfect splits. A cell may hold none of a triangle's
//     box's contents where 2 needs it, so its entry says nothing about
//     distances; that of `reach` never exceeds them. Below a node whose
//     reach is entered after the nearest distance nothing is closer.
//
// Thread safety: immutable after construction.
//
//   const KdNode& node = tree.nodes[0];
//   if (node.is_leaf() && !node.is_empty_leaf()) Test(tree.LeafIds(tree.leaves[node.leaf()]));
#ifndef SIGHTLINE_CORE_ACCEL_KD_TREE_H_
#define SIGHTLINE_CORE_ACCEL_KD_TREE_H_

#include <cstdint>
#include <span>

#include "core/base/aligned_vector.h"
#include "core/geometry/box3.h"

namespace sightline {

// Two bits of kind (an axis, or 3 for a leaf) below thirty of number.
class KdNode {
 public:
  static constexpr uint32_t kMaxIndex = (1u << 30) - 2;  // Of nodes and leaves.

  constexpr KdNode() = default;  // An empty leaf.
  // REQUIRES: axis in 0 .. 2; first_child <= kMaxIndex - 1.
  static constexpr KdNode Inner(int axis, float split, uint32_t first_child) {
    return KdNode(split, first_child << 2 | static_cast<uint32_t>(axis));
  }
  // REQUIRES: leaf <= kMaxIndex.
  static constexpr KdNode Leaf(uint32_t leaf) { return KdNode(0.0f, leaf << 2 | kLeafKind); }
  static constexpr KdNode EmptyLeaf() { return KdNode(); }

  constexpr bool is_leaf() const { return (bits_ & 3u) == kLeafKind; }
  constexpr bool is_empty_leaf() const { return bits_ == 0xFFFFFFFFu; }
  constexpr int axis() const { return static_cast<int>(bits_ & 3u); }  // REQUIRES: !is_leaf().
  constexpr float split() const { return split_; }
  // The lower child; the upper one follows it. REQUIRES: !is_leaf().
  constexpr uint32_t first_child() const { return bits_ >> 2; }
  constexpr uint32_t leaf() const { return bits_ >> 2; }  // REQUIRES: is_leaf(), not empty.
  friend constexpr bool operator==(KdNode, KdNode) = default;

 private:
  static constexpr uint32_t kLeafKind = 3;
  constexpr KdNode(float split, uint32_t bits) : split_(split), bits_(bits) {}

  float split_ = 0;
  uint32_t bits_ = 0xFFFFFFFFu;
};
static_assert(sizeof(KdNode) == 8);

// Half a cache line. Never empty: count >= 1, lo <= hi (a flat leaf has lo == hi along an axis).
struct KdLeaf {
  float lo[3];
  uint32_t first;  // In KdTree::ids.
  float hi[3];
  uint32_t count;

  Box3f box() const { return {{lo[0], lo[1], lo[2]}, {hi[0], hi[1], hi[2]}}; }
};
static_assert(sizeof(KdLeaf) == 32);

struct KdTree {
  AlignedVector<KdNode> nodes;  // Empty for a scene with nothing to hit.
  AlignedVector<KdLeaf> leaves;
  AlignedVector<uint32_t> ids;
  AlignedVector<Box3f>
      reach;     // By node with perfect splits, else empty. Empty boxes: nothing below.
  Box3f bounds;  // The root's cell: of the triangles that are not inert.
  uint32_t triangle_count = 0;
  uint32_t max_depth = 0;  // Inner nodes on the longest path from the root, the root included.

  bool empty() const { return nodes.empty(); }
  bool perfect() const { return !reach.empty(); }
  std::span<const uint32_t> LeafIds(const KdLeaf& leaf) const {
    return {ids.data() + leaf.first, leaf.count};
  }
  size_t MemoryBytes() const {
    return nodes.size() * sizeof(KdNode) + leaves.size() * sizeof(KdLeaf) +
           ids.size() * sizeof(uint32_t) + reach.size() * sizeof(Box3f);
  }
};

// Bound of max_depth that builders keep, so that walks can use fixed stacks: a depth-first walk has
// at most one sibling pending per level.
inline constexpr uint32_t kMaxKdDepth = 62;
inline constexpr uint32_t kKdStackSize = kMaxKdDepth + 1;

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_KD_TREE_H_
