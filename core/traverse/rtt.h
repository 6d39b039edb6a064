// SPDX-License-Identifier: Apache-2.0
//
// How relevant triangles tracing (paper 002) goes about a packet. Speed only; the answers are the
// same.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_RTT_H_
#define SIGHTLINE_CORE_TRAVERSE_RTT_H_

#include <cstdint>

namespace sightline {

// Rays of a tile of 4×4 pixels with n×n rays a pixel.
constexpr int RttTileRays(int antialiasing) { return 16 * antialiasing * antialiasing; }
// Along a side.
constexpr uint32_t RttTileSide(int antialiasing) { return 4 * static_cast<uint32_t>(antialiasing); }
inline constexpr int kMaxRttAntialiasing = 6;
inline constexpr int kMaxRttSideBySide = 4;

struct RttOptions {
  // So many rays that follow one another are a tile: RttTileRays(1 .. kMaxRttAntialiasing). Of a
  // full packet of an eye's rays, which is sixteen squares of 4×4, RttTileRays(2) are a quarter
  // instead. Where a tile is more than a packet holds, all packets given together are one.
  int tile_rays = RttTileRays(1);
  // Tiles whose corner rays walk in one register: as many as it holds (two with AVX2, four with
  // AVX-512), or fewer. 0: as many as it holds.
  int side_by_side = 0;
  // Whether two triangles that share an edge may end the corner rays, too: of an eye's rays, and of
  // segments where any hit will do. Rays that leave a mirror, and segments whose first hit is asked
  // for, are ended by single triangles alone, or by none.
  bool shared_edges = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_RTT_H_
