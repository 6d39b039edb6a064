// SPDX-License-Identifier: Apache-2.0
//
// Whole blocks of a camera's pixels (16 by 16), laid out as the rays of a packet and written back
// as an image's rows. A block's lanes run through squares of 4 by 4 pixels, square by square, so
// that the lanes of a SIMD vector are neighbours in both directions. Compiled for AVX2 and AVX-512
// from one source (pixel_blocks-inl.h), in the manner of core/traverse/kernels.h: at a thousand
// rays a microsecond this is a tenth of a picture's time.
//
// Thread safety: functions only.
//
//   const PixelBlockKernels& kernels = PixelBlockKernelsFor(SimdTarget::kBest);
//   kernels.lay_out(columns, rows, packet.target_x);
//   kernels.write(packet.t, depth, width);
#ifndef SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_H_
#define SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_H_

#include <cstddef>
#include <cstdint>

#include "core/traverse/simd_target.h"

namespace sightline {

struct PixelBlockKernels {
  static constexpr uint32_t kSide = 16;  // Of a block, in pixels.
  static constexpr uint32_t kRun = 4;    // Of a square of lanes.

  // The lane of a block's pixel (x, y).
  static constexpr uint32_t LaneOf(uint32_t x, uint32_t y) {
    return (y / kRun * (kSide / kRun) + x / kRun) * kRun * kRun + y % kRun * kRun + x % kRun;
  }

  // One axis of the directions through the block's pixels: lane of (x, y) is columns[x] + rows[y]
  // (camera.h: PixelColumn, PixelRow), rounded once. `lanes` is aligned to 64 bytes.
  void (*lay_out)(const double* columns, const double* rows, float* lanes);
  // The block's lanes to its pixels, the first of which is *to, in rows `stride` pixels apart. Row
  // by row: where results go to memory, coming back to a line costs twice as much.
  void (*write)(const float* lanes, float* to, size_t stride);
  void (*write_ids)(const uint32_t* lanes, uint32_t* to, size_t stride);
  // The same past the caches: no line is fetched to be overwritten. Others see it after
  // hwy::FlushStream. REQUIRES: `to` is aligned to 64 bytes, and `stride` pixels are.
  void (*stream)(const float* lanes, float* to, size_t stride);
  void (*stream_ids)(const uint32_t* lanes, uint32_t* to, size_t stride);
};

// kBest resolved. CHECKs that the target is available.
const PixelBlockKernels& PixelBlockKernelsFor(SimdTarget target);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_PIXEL_BLOCKS_H_
