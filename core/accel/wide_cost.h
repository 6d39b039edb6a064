// SPDX-License-Identifier: Apache-2.0
//
// How a binary tree is best gathered into eight-wide nodes: for every binary subtree the least cost
// of representing it by at most i children of one wide node, i = 1 .. 7, found bottom-up (dynamic
// programming after Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through
// Compressed Wide BVHs", 2017, section 3.3). It decides at once which subtrees become leaves.
// Private to core/accel.
//
//   C(n, 1) = min(leaf: area · Leaf(count) if it fits, inner: area · node_visit + D(n, 8))
//   C(n, i) = min(D(n, i), C(n, i - 1))
//   D(n, j) = min over k of C(left, k) + C(right, j - k)
//
// Greedily opening the largest child leaves more nodes and leaves half empty at the bottom of the
// tree.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_ACCEL_WIDE_COST_H_
#define SIGHTLINE_CORE_ACCEL_WIDE_COST_H_

#include <algorithm>
#include <cstdint>
#include <limits>

#include "core/accel/sah_split.h"

namespace sightline::bvh_build {

inline constexpr int kWidth = 8;

class WideCost {
 public:
  // Of a binary leaf: it can only be a leaf.
  void SetLeaf(float area, uint32_t count, const SahCost& cost) {
    std::fill_n(cost_, kWidth - 1, area * cost.Leaf(count));
    choices_ = kIsLeaf | kIsBinaryLeaf;
  }

  // Of a binary inner node over these two.
  void SetInner(float area, uint32_t count, const WideCost& left, const WideCost& right,
                const SahCost& cost) {
    choices_ = 0;
    float best[kWidth + 1];
    for (int j = 2; j <= kWidth; ++j) {
      best[j] = std::numeric_limits<float>::infinity();
      int best_k = 1;
      for (int k = 1; k < j; ++k) {
        const float c = left.cost_[k - 1] + right.cost_[j - k - 1];
        if (c < best[j]) {
          best[j] = c;
          best_k = k;
        }
      }
      SetChoice(j, best_k);
    }
    cost_[0] = area * cost.node_visit + best[kWidth];
    if (count <= static_cast<uint32_t>(cost.max_leaf_triangles)) {
      const float leaf = area * cost.Leaf(count);
      if (leaf <= cost_[0]) {
        cost_[0] = leaf;
        choices_ |= kIsLeaf;
      }
    }
    for (int i = 2; i < kWidth; ++i) {
      cost_[i - 1] = std::min(best[i], cost_[i - 2]);
      if (cost_[i - 2] <= best[i]) SetChoice(i, 0);
    }
  }

  // As one child: a leaf, not an inner node.
  bool is_leaf() const { return (choices_ & kIsLeaf) != 0; }
  // A leaf of the binary tree.
  bool is_binary_leaf() const { return (choices_ & kIsBinaryLeaf) != 0; }
  // How many of j children the left side gets; 0: better use one child fewer. REQUIRES: 2 <= j
  // <= 8.
  int LeftChildren(int j) const { return static_cast<int>(choices_ >> (3 * (j - 2)) & 7); }
  float cost() const { return cost_[0]; }

 private:
  static constexpr uint32_t kIsLeaf = 1u << 30;
  static constexpr uint32_t kIsBinaryLeaf = 1u << 31;
  void SetChoice(int j, int k) {
    choices_ &= ~(7u << (3 * (j - 2)));
    choices_ |= static_cast<uint32_t>(k) << (3 * (j - 2));
  }

  float cost_[kWidth - 1];  // C(n, 1) .. C(n, 7).
  uint32_t choices_;        // Three bits each for j = 2 .. 8, and the flags.
};
static_assert(sizeof(WideCost) == 32);

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_WIDE_COST_H_
