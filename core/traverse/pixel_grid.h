// SPDX-License-Identifier: Apache-2.0
//
// A camera's pixels in a shaft's frame, up to 64 by 64 of them together. The ray of a pixel is the
// sum of a column's and a row's term (core/geometry/camera.h), so that rays lie between those of
// their square's corners, and so do their slopes and depths: whole packets of pixels are bounded by
// what 64 corners are, in four vectors, and no ray is projected.
//
// A packet's lanes are in blocks of sixteen, each a run of four columns by a run of four rows, runs
// of columns first; kept are the two outer columns and rows of every run.
//
// Invariant: the frame holds every pixel's ray (core/shaft/frame.h).
//
// Thread safety: plain values.
//
//   PixelGrid grid;
//   if (MakePixelGrid({columns[0], columns[1], columns[2]}, 64, {rows[0], rows[1], rows[2]}, 64,
//                     &grid)) {
//     packet.grid = &grid;
//     packet.grid_column = packet.grid_row = 16;  // Of its first pixel.
//   }
#ifndef SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_H_
#define SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_H_

#include <array>
#include <cstdint>

#include "core/shaft/frame.h"

namespace sightline {

struct PixelGrid {
  static constexpr uint32_t kMostSide = 64;  // Of pixels.
  static constexpr uint32_t kRun = 4;
  static constexpr uint32_t kRuns = kMostSide / kRun;
  static constexpr uint32_t kPacketSide = 16;  // Of a packet, in pixels.

  // The lanes of a packet's corner pixels.
  static constexpr int kCornerLanes[] = {0, 51, 204, 255};

  ShaftFrame frame;
  float norm_inf;  // Bounds |D|_inf of every pixel's ray D.
  // Along the frame's axes u, v and w: the term of the first ([0]) and of the last column of every
  // run; the same of rows, four times each, as lanes have them.
  alignas(64) float columns[2][3][kRuns];
  alignas(64) float rows[2][3][kRuns][kRun];
};

// One axis of the directions, by column or row.
using PixelTerms = std::array<const double*, 3>;

// Of `width` columns and `height` rows of pixels, 1 .. kMostSide each (PixelColumn, PixelRow). Runs
// that are not whole hold nothing of use. False, and no grid, if no one frame holds all rays.
bool MakePixelGrid(const PixelTerms& columns, uint32_t width, const PixelTerms& rows,
                   uint32_t height, PixelGrid* grid);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_H_
