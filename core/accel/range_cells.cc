// SPDX-License-Identifier: Apache-2.0
//
// Ranges that fit a second-level cache, divided by the cells of a grid of their own: their
// primitives are looked at three times, for what would be five levels of binning and moving them.
#include <algorithm>
#include <bit>
#include <memory>
#include <span>

#include "core/accel/cell_grid.h"
#include "core/accel/range_builder.h"

namespace sightline::bvh_build {
namespace {

// Some cells for each leaf, so that lines fill leaves: one for each two to four triangles, until
// there are kRangeCells.
constexpr int kTrianglesPerCellBits = 2;
constexpr int kRangeCellBits = 7;
constexpr size_t kRangeCells = 1 << kRangeCellBits;

int CellBits(size_t n) {
  return std::min(static_cast<int>(std::bit_width(n)) - kTrianglesPerCellBits, kRangeCellBits);
}

}  // namespace

struct RangeBuilder::CellDivision {
  struct Part {  // What becomes a leaf, or is built as a range.
    uint32_t node;
    int depth;
    uint32_t first, count;  // From the range's first.
  };
  struct Inner {
    uint32_t node, child;
  };
  CellDivision(NodeBlock& block, int last_cost_depth)
      : block(block), last_cost_depth(last_cost_depth) {}
  NodeBlock& block;
  const int last_cost_depth;
  uint32_t placed = 0;
  size_t part_count = 0, inner_count = 0;
  Part parts[kRangeCells];
  Inner inner[kRangeCells];
  uint8_t part_of[kRangeCells];  // By cell.
};

// Makes `node` a part, or an inner node over two halves of the cells.
void RangeBuilder::DivideCells(std::span<Cell> cells, uint32_t node, int depth,
                               CellDivision& division) {
  CellSum sum;
  for (const Cell& cell : cells) sum.Extend(cell);
  BinaryNode& out = tree_.nodes[node];
  out.SetBox(sum.bounds);
  out.count = sum.count;
  if (cells.size() == 1 || sum.count <= static_cast<uint32_t>(cost_.max_leaf_triangles)) {
    for (const Cell& cell : cells) {
      division.part_of[cell.index] = static_cast<uint8_t>(division.part_count);
    }
    division.parts[division.part_count++] = {node, depth, division.placed, sum.count};
    division.placed += sum.count;
    return;
  }
  const size_t left = PartitionCells(
      cells, depth <= division.last_cost_depth ? CheapestLine(cells, cost_) : MiddleLine(cells));
  const uint32_t child = AllocatePair(division.block);
  division.inner[division.inner_count++] = {node, child};
  DivideCells(cells.first(left), child, depth + 1, division);
  DivideCells(cells.subspan(left), child + 1, depth + 1, division);
}

// Not inlined, for its tables are not to be on the stack of every level below. Places the ids, and
// the primitives of parts that are no leaves, in the order of the parts.
__attribute__((noinline)) bool RangeBuilder::DivideByCells(const Buffers& buffers,
                                                           const Range& range, uint32_t node,
                                                           int depth, CellDivision& division) {
  const size_t n = range.size();
  const Float4 lo = LowHalf(range.centroids.faces), hi = -HighHalf(range.centroids.faces);
  const CellGrid grid(lo, hi, CellBits(n));
  const Primitive* const primitives = buffers.primitives[range.buffer] + range.begin;
  uint8_t cell_of[kCellTriangles];
  Unset<CellSum, kRangeCells> sums;
  std::uninitialized_fill_n(sums.at, grid.cells(), CellSum());
  for (size_t i = 0; i < n; ++i) {
    const uint32_t cell = grid.CellOf(primitives[i]);
    cell_of[i] = static_cast<uint8_t>(cell);
    sums.at[cell].Extend(primitives[i]);
  }
  Unset<Cell, kRangeCells> cells;
  size_t cell_count = 0;
  for (uint32_t i = 0; i < grid.cells(); ++i) {
    if (sums.at[i].count == 0) continue;
    Cell& cell = *std::construct_at(&cells.at[cell_count++]);
    static_cast<CellSum&>(cell) = sums.at[i];
    cell.index = static_cast<uint16_t>(i);
    cell.place = grid.Place(i);
  }
  if (cell_count == 1) return false;
  DivideCells({cells.at, cell_count}, node, depth, division);

  uint32_t next[kRangeCells];
  bool all_leaves = true;
  for (size_t p = 0; p < division.part_count; ++p) {
    next[p] = division.parts[p].first;
    all_leaves = all_leaves && IsLeafSize(division.parts[p].count);
  }
  uint32_t* const ids = buffers.ids + range.begin;
  Primitive* const target = buffers.primitives[1 - range.buffer] + range.begin;
  for (size_t i = 0; i < n; ++i) {
    const uint32_t place = next[division.part_of[cell_of[i]]]++;
    ids[place] = primitives[i].id;
    if (!all_leaves) target[place] = Primitive(primitives[i].box());
  }
  return true;
}

bool RangeBuilder::BuildByCells(const Buffers& buffers, const Range& range, uint32_t node,
                                int depth, NodeBlock& block) {
  const size_t n = range.size();
  const int last_cost_depth = options_.max_depth - kRangeCellBits - MedianLevels(n);
  if (depth > last_cost_depth) return false;
  CellDivision division(block, last_cost_depth);
  if (!DivideByCells(buffers, range, node, depth, division)) return false;
  size_t placed = n;  // But for parts that count as placed by themselves.
  for (const CellDivision::Part& part :
       std::span<const CellDivision::Part>(division.parts, division.part_count)) {
    const size_t begin = range.begin + part.first;
    if (IsLeafSize(part.count)) {
      BinaryNode& leaf = tree_.nodes[part.node];
      leaf.first = buffers.first_id + static_cast<uint32_t>(begin);
      leaf.wide.SetLeaf(leaf.HalfArea(cost_.area_scale), leaf.count, cost_);
      continue;
    }
    Range rest{.begin = begin, .end = begin + part.count, .buffer = 1 - range.buffer};
    for (size_t i = begin; i < rest.end; ++i) {
      const Primitive& p = buffers.primitives[rest.buffer][i];
      rest.bounds.Extend(p);
      rest.centroids.Extend(p.centroid());
    }
    Build(buffers, rest, part.node, part.depth, block);
    if (part.count >= kTaskTriangles) placed -= part.count;
  }
  // Children were divided after their parents.
  for (size_t i = division.inner_count; i-- > 0;) {
    SetInner(division.inner[i].node, division.inner[i].child);
  }
  if (n >= kTaskTriangles) ReportPlaced(placed);
  return true;
}

}  // namespace sightline::bvh_build
