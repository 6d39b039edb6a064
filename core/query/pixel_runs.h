// SPDX-License-Identifier: Apache-2.0
//
// A block of pixels as lanes of a packet: squares of four by four, row by row, and within a square
// runs of up to four pixels of a row. Blocks that are whole, sixteen by sixteen, have kernels of
// their own (pixel_blocks.h); these are for all others.
//
// Thread safety: functions only.
//
//   ForEachRun(block, SquareLanes::kOfPixels, [&](const PixelRun& run) {
//     std::copy_n(lanes + run.lane, run.count, rows + run.y * width + run.x);
//   });
#ifndef SIGHTLINE_CORE_QUERY_PIXEL_RUNS_H_
#define SIGHTLINE_CORE_QUERY_PIXEL_RUNS_H_

#include <algorithm>
#include <cstdint>

#include "core/query/pixel_blocks.h"
#include "core/query/tiles.h"

namespace sightline {

// A row of at most four pixels: lanes `lane` .. of a block, pixels from (x, y) of it.
struct PixelRun {
  int lane;
  uint32_t x, y, count;
};

// The lanes of a square that a block's border cuts: its pixels', one after another, or those of a
// whole square, some of them without a pixel.
enum class SquareLanes : uint8_t { kOfPixels, kWhole };

// Of so many pixels of a row or column: those of the squares that they lie in.
constexpr uint32_t WholeSquares(uint32_t pixels) {
  constexpr uint32_t kRun = PixelBlockKernels::kRun;
  return (pixels + kRun - 1) / kRun * kRun;
}

// fn(run) for the runs of a part of a block, square by square. `part` is in pixels of the block.
// REQUIRES: its sides are those of squares.
template <class Fn>
void ForEachRunOf(const TileRect& part, const TileRect& block, SquareLanes lanes, const Fn& fn) {
  constexpr uint32_t kRun = PixelBlockKernels::kRun;
  const bool whole = lanes == SquareLanes::kWhole;
  const uint32_t row = whole ? WholeSquares(block.width) : block.width;
  for (uint32_t gy = part.y; gy < part.y + part.height; gy += kRun) {
    const uint32_t height = std::min(kRun, block.height - gy);
    for (uint32_t gx = part.x; gx < part.x + part.width; gx += kRun) {
      const uint32_t count = std::min(kRun, block.width - gx);
      const uint32_t stride = whole ? kRun : count;
      uint32_t lane = gy * row + gx * (whole ? kRun : height);
      for (uint32_t y = gy; y < gy + height; ++y, lane += stride) {
        fn(PixelRun{static_cast<int>(lane), gx, y, count});
      }
    }
  }
}

// fn(run) for the runs of a block, in the order of its lanes.
template <class Fn>
void ForEachRun(const TileRect& block, SquareLanes lanes, const Fn& fn) {
  ForEachRunOf({0, 0, block.width, block.height}, block, lanes, fn);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_PIXEL_RUNS_H_
