// SPDX-License-Identifier: Apache-2.0
#include "core/accel/cell_grid.h"

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>

namespace sightline::bvh_build {
namespace {

constexpr int kMaxLines = 1 << kMaxCellAxisBits;
// lines / extent of extents from this on is finite.
constexpr float kMinExtent = 0x1p-119f;
static_assert(kMaxLines / kMinExtent < std::numeric_limits<float>::max());

// First and last place along each axis.
struct Extents {
  int first[3] = {kMaxLines, kMaxLines, kMaxLines};
  int last[3] = {-1, -1, -1};

  explicit Extents(std::span<const Cell> cells) {
    for (const Cell& cell : cells) {
      for (size_t axis = 0; axis < 3; ++axis) {
        first[axis] = std::min<int>(first[axis], cell.place[axis]);
        last[axis] = std::max<int>(last[axis], cell.place[axis]);
      }
    }
  }
};

}  // namespace

CellGrid::CellGrid(Float4 lo, Float4 hi, int bits) : base_{lo[0], lo[1], lo[2], 0} {
  Float4 cell = hi - lo;
  for (int bit = 0; bit < bits; ++bit) {
    int axis = -1;
    for (int i = 0; i < 3; ++i) {
      if (bits_[i] < kMaxCellAxisBits && (axis < 0 || cell[i] > cell[axis])) axis = i;
    }
    ++bits_[axis];
    cell[axis] *= 0.5f;
  }
  for (int axis = 0; axis < 3; ++axis) {
    const float extent = hi[axis] - lo[axis];
    if (extent >= kMinExtent) scale_[axis] = static_cast<float>(1 << bits_[axis]) / extent;
    last_[axis] = (1 << bits_[axis]) - 1;
  }
  stride_ = Int4{1, 1 << bits_[0], 1 << (bits_[0] + bits_[1]), 0};
}

CellLine MiddleLine(std::span<const Cell> cells) {
  const Extents extents(cells);
  CellLine line;
  int widest = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const int first = extents.first[axis], last = extents.last[axis];
    if (last - first > widest) {
      widest = last - first;
      line = {axis, first + (widest + 1) / 2};
    }
  }
  return line;
}

CellLine CheapestLine(std::span<const Cell> cells, const SahCost& cost) {
  const auto cost_of = [&](const CellSum& sum) {
    return sum.bounds.HalfArea(cost.area_scale) * cost.Subtree(sum.count);
  };
  const Extents extents(cells);
  CellLine best;
  float best_cost = std::numeric_limits<float>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const int first = extents.first[axis], last = extents.last[axis];
    if (first == last) continue;
    Unset<CellSum, kMaxLines> slabs;
    std::uninitialized_fill(slabs.at + first, slabs.at + last + 1, CellSum());
    for (const Cell& cell : cells) slabs.at[cell.place[static_cast<size_t>(axis)]].Extend(cell);
    float right_cost[kMaxLines];
    CellSum right;
    for (int i = last; i > first; --i) {
      right.Extend(slabs.at[i]);
      right_cost[i] = cost_of(right);
    }
    CellSum left;
    for (int i = first + 1; i <= last; ++i) {
      left.Extend(slabs.at[i - 1]);
      const float c = cost_of(left) + right_cost[i];
      if (c < best_cost) {
        best_cost = c;
        best = {axis, i};
      }
    }
  }
  return best.axis >= 0 ? best : MiddleLine(cells);
}

size_t PartitionCells(std::span<Cell> cells, CellLine line) {
  const auto middle = std::partition(cells.begin(), cells.end(), [&](const Cell& cell) {
    return cell.place[static_cast<size_t>(line.axis)] < line.line;
  });
  return static_cast<size_t>(middle - cells.begin());
}

}  // namespace sightline::bvh_build
