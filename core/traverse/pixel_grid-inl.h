// SPDX-License-Identifier: Apache-2.0
//
// Where a shaft's frame sees the blocks of a packet of pixels (pixel_grid.h): between the corners
// of each.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_PIXEL_GRID_INL_H_
#endif

#include "core/traverse/pixel_grid.h"
#include "core/traverse/shaft_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Slopes and depths of the corners of a packet's blocks, the packet's first pixel in the column and
// row given: rows of kShaftBlocks floats. With kSlopeMargin around the rectangles, and within what
// kDepthScale allows of the depths, they hold all of the blocks' rays (core/shaft/margins.h).
HWY_INLINE void BoundBlocks(const PixelGrid& grid, uint32_t column, uint32_t row, float* x0,
                            float* x1, float* y0, float* y1, float* farthest) {
  const ShaftD d;
  static_assert(PixelGrid::kRun * PixelGrid::kRun == kShaftBlocks);
  const uint32_t first_column = column / PixelGrid::kRun, first_row = row / PixelGrid::kRun;
  for (size_t at = 0; at < kShaftBlocks; at += hn::Lanes(d)) {
    ShaftV least_x, most_x, least_y, most_y, most_z;
    for (int corner = 0; corner < 4; ++corner) {
      const auto along = [&](int k) HWY_ATTR {
        const float* rows = grid.rows[corner >> 1][k][first_row];
        return hn::Add(hn::LoadDup128(d, grid.columns[corner & 1][k] + first_column),
                       hn::Load(d, rows + at));
      };
      const ShaftV z = along(2), inverse = hn::Div(hn::Set(d, 1.0f), z);
      const ShaftV x = hn::Mul(along(0), inverse), y = hn::Mul(along(1), inverse);
      least_x = corner == 0 ? x : hn::Min(least_x, x);
      most_x = corner == 0 ? x : hn::Max(most_x, x);
      least_y = corner == 0 ? y : hn::Min(least_y, y);
      most_y = corner == 0 ? y : hn::Max(most_y, y);
      most_z = corner == 0 ? z : hn::Max(most_z, z);
    }
    hn::Store(least_x, d, x0 + at);
    hn::Store(most_x, d, x1 + at);
    hn::Store(least_y, d, y0 + at);
    hn::Store(most_y, d, y1 + at);
    hn::Store(most_z, d, farthest + at);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
