// SPDX-License-Identifier: Apache-2.0
//
// Primitives counted into the cells of a grid by their centroids, and the surface area heuristic
// over those cells, with the grid's lines for planes: a primitive is then looked at once for what
// would be several levels of binning and moving it. Private to core/accel.
//
// Thread safety: const access from many threads.
//
//   const CellGrid grid(lo, hi, bits);
//   sums[grid.CellOf(primitive)].Extend(primitive);
//   const CellLine line = CheapestLine(cells, cost);  // Cells with place[line.axis] < line.line go
//                                                     // left.
#ifndef SIGHTLINE_CORE_ACCEL_CELL_GRID_H_
#define SIGHTLINE_CORE_ACCEL_CELL_GRID_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/accel/build_primitive.h"
#include "core/accel/sah_split.h"

namespace sightline::bvh_build {

inline constexpr int kMaxCellBits = 12;
inline constexpr int kMaxCellAxisBits = 6;

// Which cell a primitive belongs to: its doubled centroid's. What lies outside, by less than 2^31
// cells, belongs to the cell beside it.
class CellGrid {
 public:
  // 2^bits cells between `lo` and `hi`, doubled, as cubic as they can be. REQUIRES: lo <= hi in the
  // first three lanes; 0 <= bits <= kMaxCellBits.
  CellGrid(Float4 lo, Float4 hi, int bits);

  size_t cells() const { return size_t{1} << (bits_[0] + bits_[1] + bits_[2]); }
  uint32_t CellOf(const Primitive& p) const {
    Int4 at = __builtin_convertvector((LowHalf(p.centroid()) - base_) * scale_, Int4);
    at = at < last_ ? at : last_;
    at = at > Int4{} ? at : Int4{};
    at *= stride_;
    return static_cast<uint32_t>(at[0] + at[1] + at[2]);
  }
  std::array<uint8_t, 3> Place(uint32_t cell) const {
    std::array<uint8_t, 3> at;
    for (int axis = 0; axis < 3; ++axis) {
      at[axis] = static_cast<uint8_t>(cell & static_cast<uint32_t>(last_[axis]));
      cell >>= bits_[axis];
    }
    return at;
  }

 private:
  int bits_[3] = {};
  Float4 base_{}, scale_{};
  Int4 last_{}, stride_{};
};

struct CellSum {
  BuildBox bounds;
  uint32_t count = 0;

  void Extend(const Primitive& p) {
    bounds.Extend(p);
    ++count;
  }
  void Extend(const CellSum& other) {
    bounds.Extend(other.bounds);
    count += other.count;
  }
};

// Places for N of them, none set to anything before it is needed.
template <typename T, size_t N>
union Unset {
  Unset() {}  // NOLINT(modernize-use-equals-default): defaulted, it would be deleted.
  T at[N];
};

// One that holds something.
struct Cell : CellSum {
  uint16_t index = 0;
  std::array<uint8_t, 3> place{};
};
static_assert(sizeof(Cell) == 64);

struct CellLine {
  int axis = -1;
  int line = 0;  // Places below it go left.
};

// REQUIRES, of both: two cells or more.
CellLine CheapestLine(std::span<const Cell> cells, const SahCost& cost);
// Halves the places along the axis with the most of them.
CellLine MiddleLine(std::span<const Cell> cells);
// Those left of the line first; how many they are.
size_t PartitionCells(std::span<Cell> cells, CellLine line);

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_CELL_GRID_H_
