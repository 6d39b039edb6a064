// SPDX-License-Identifier: Apache-2.0
//
// Builds the binary tree over a range of primitives: top-down, by the binned surface area
// heuristic, by object medians where that cannot split or has become too deep. Private to
// core/accel.
//
// Primitives go back and forth between two buffers, in the order that they had: so the order of a
// leaf's ids is that of the range, except where medians were needed.
//
// Thread safety: Build may run for several ranges at once, over different primitives.
//
//   RangeBuilder builder(tree, /*tasks=*/1, cost, options, cancel, progress);
//   RangeBuilder::NodeBlock block;
//   builder.Build(buffers, range, builder.AllocatePair(block), /*depth=*/1, block);
#ifndef SIGHTLINE_CORE_ACCEL_RANGE_BUILDER_H_
#define SIGHTLINE_CORE_ACCEL_RANGE_BUILDER_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <span>

#include "core/accel/binary_tree.h"
#include "core/accel/build_primitive.h"
#include "core/accel/cell_grid.h"
#include "core/accel/sah_split.h"
#include "core/base/cancel.h"

namespace sightline::bvh_build {

class RangeBuilder {
 public:
  // Two places for the primitives of a task, and one for their ids: all three by the same numbers.
  struct Buffers {
    Primitive* primitives[2];
    uint32_t* ids;
    uint32_t first_id;  // Place of ids[0] in the tree's.
  };
  struct Range {
    size_t begin = 0, end = 0;
    BuildBox bounds, centroids;
    int buffer = 0;  // Which of the two holds the primitives.

    size_t size() const { return end - begin; }
  };
  // Nodes set aside for one task, so that tasks meet at the shared counter rarely.
  struct NodeBlock {
    uint32_t next = 0, end = 0;
  };

  // Sizes the tree's nodes for up to `triangles`, in up to `tasks` calls with blocks of their own.
  // Everything must outlive the builder.
  RangeBuilder(BinaryTree& tree, size_t triangles, size_t tasks, const SahCost& cost,
               const BinaryTreeOptions& options, const CancelToken* cancel,
               const std::function<void(double)>& progress);

  uint32_t AllocatePair(NodeBlock& block);

  // `depth`: inner nodes on the path to `node`, and this one if it becomes one. Incomplete once the
  // token has fired. REQUIRES: range not empty; depth - 1 + MedianLevels(range.size()) <=
  // max_depth.
  void Build(const Buffers& buffers, const Range& range, uint32_t node, int depth,
             NodeBlock& block);

  // Sets the node over two that are complete.
  void SetInner(uint32_t node, uint32_t child);

  // Levels of inner nodes that median splits need below and at a range of n.
  int MedianLevels(size_t n) const;

  // Counts triangles as placed that Build has not counted.
  void ReportPlaced(size_t more);

  bool cancelled() const { return cancel_ != nullptr && cancel_->cancelled(); }

  // Subtrees of at least this many triangles are tasks of their own, and count as placed when done.
  static constexpr size_t kTaskTriangles = 1 << 11;
  // Ranges of at most this many may be divided by cells.
  static constexpr size_t kCellTriangles = 1 << 12;

 private:
  struct CellDivision;

  // Of a range that becomes a leaf whatever that costs.
  bool IsLeafSize(size_t n) const {
    return n == 1 || (options_.full_leaves && n <= static_cast<size_t>(cost_.max_leaf_triangles));
  }
  // All below `node`; false if it did nothing, since the range's primitives are in one cell, or the
  // node is too deep. REQUIRES: the range is larger than a leaf, but no larger than
  // kCellTriangles.
  bool BuildByCells(const Buffers& buffers, const Range& range, uint32_t node, int depth,
                    NodeBlock& block);
  bool DivideByCells(const Buffers& buffers, const Range& range, uint32_t node, int depth,
                     CellDivision& division);
  void DivideCells(std::span<Cell> cells, uint32_t node, int depth, CellDivision& division);

  bool Split(const Buffers& buffers, const Range& range, float area, int depth, Range& left,
             Range& right) const;
  SahSplit FindSahSplit(std::span<const Primitive> primitives, const BinMapping& mapping,
                        int single_axis) const;
  void SplitAtMedian(const Buffers& buffers, const Range& range, Range& left, Range& right) const;

  BinaryTree& tree_;
  const size_t triangles_;
  const SahCost& cost_;
  const BinaryTreeOptions& options_;
  const CancelToken* const cancel_;
  const std::function<void(double)>& progress_;
  std::atomic<uint32_t> next_node_{0};
  std::atomic<size_t> placed_{0};
};

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_RANGE_BUILDER_H_
