// SPDX-License-Identifier: Apache-2.0
#include "core/query/mirrored_rays.h"

#include <algorithm>
#include <iterator>

#include "core/base/check.h"
#include "core/traverse/rtt.h"

namespace sightline {
namespace {

// The lanes that meet the mirror.
int LanesThatMeet(const uint8_t* mirror_of, int count, uint8_t number, int* lanes) {
  int met = 0;
  for (int lane = 0; lane < count; ++lane) {
    if (mirror_of[lane] == number) lanes[met++] = lane;
  }
  return met;
}

// The lanes of the tiles that meet the mirror, square by square, as a walk takes tiles from a
// packet.
int TilesThatMeet(const uint8_t* mirror_of, int count, int tile_rays, uint8_t number, int* lanes) {
  constexpr int kSquare = RttTileRays(1), kMostSquares = RayPacket::kMaxRays / kSquare;
  // Of a full packet tiles of four squares are its quarters (rtt.h); else squares follow one
  // another.
  constexpr int kByQuarters[] = {0, 1, 4, 5, 2, 3, 6, 7, 8, 9, 12, 13, 10, 11, 14, 15};
  static_assert(std::size(kByQuarters) == kMostSquares);
  const bool quarters = count == RayPacket::kMaxRays && tile_rays == RttTileRays(2);
  const auto square = [&](int i) { return quarters ? kByQuarters[i] : i; };
  const auto first_of = [&](int i) {
    const uint8_t* const begin = mirror_of + square(i) * kSquare;
    const uint8_t* const found = std::find(begin, begin + kSquare, number);
    return found == begin + kSquare ? -1 : static_cast<int>(found - mirror_of);
  };
  SIGHTLINE_CHECK(count % kSquare == 0 && tile_rays % kSquare == 0) << count << ' ' << tile_rays;
  const int squares = count / kSquare, tile = tile_rays / kSquare;
  int met = 0;
  for (int begin = 0; begin < squares; begin += tile) {
    const int end = std::min(begin + tile, squares);
    int stand_in = -1;
    for (int i = begin; i < end && stand_in < 0; ++i) stand_in = first_of(i);
    if (stand_in < 0) continue;
    for (int i = begin; i < end; ++i) {
      if (const int own = first_of(i); own >= 0) stand_in = own;
      for (int lane = square(i) * kSquare; lane < (square(i) + 1) * kSquare; ++lane) {
        if (mirror_of[lane] == number) stand_in = lane;
        lanes[met++] = stand_in;
      }
    }
  }
  if (!quarters || met < RayPacket::kMaxRays) return met;
  // All of them: the packet is full, and parted as the block is.
  int by_quarters[RayPacket::kMaxRays];
  std::copy_n(lanes, RayPacket::kMaxRays, by_quarters);
  for (int i = 0; i < kMostSquares; ++i) {
    std::copy_n(by_quarters + i * kSquare, kSquare, lanes + square(i) * kSquare);
  }
  return met;
}

}  // namespace

MirroredRays::MirroredRays(size_t blocks, const RayPacket& eye, bool record_answered_by)
    : mirror_of_(blocks), packets_(blocks), of_(blocks) {
  for (size_t i = 0; i < blocks; ++i) {
    packets_[i].segments = false;
    packets_[i].mask = eye.mask;
    packets_[i].want_barycentrics = eye.want_barycentrics;
    packets_[i].near = of_[i].near;
    if (record_answered_by) packets_[i].answered_by = of_[i].answered_by;
  }
}

void MirroredRays::Meet(std::span<const PreparedMirror> mirrors, const TileRect& block,
                        SquareLanes lanes, const RayPacket& packet, size_t b) {
  uint8_t* const mirror_of = mirror_of_[b].data();
  std::fill_n(mirror_of, kRays, 0);
  ForEachRun(block, lanes, [&](const PixelRun& run) {
    for (int lane = run.lane; lane < run.lane + static_cast<int>(run.count); ++lane) {
      for (size_t m = 0; m < mirrors.size() && mirror_of[lane] == 0; ++m) {
        if (!mirrors[m].triangles().Holds(packet.triangle[lane])) continue;
        mirror_of[lane] = static_cast<uint8_t>(m + 1);
      }
    }
  });
}

size_t MirroredRays::LayOut(const PreparedMirror& mirror, uint8_t number,
                            std::span<const RayPacket> blocks, int tile_rays) {
  SIGHTLINE_CHECK_LE(blocks.size(), packets_.size());
  size_t rays = 0;
  count_ = 0;
  for (size_t b = 0; b < blocks.size(); ++b) {
    const uint8_t* const met = mirror_of(b);
    const auto of_block = static_cast<size_t>(std::count(met, met + kRays, number));
    if (of_block == 0) continue;
    rays += of_block;
    RayPacket& seen = packets_[count_];
    Of& of = of_[count_++];
    of.block = b;
    seen.origin = mirror.eye();
    seen.unseen = mirror.triangles();
    seen.count = tile_rays == 0 ? LanesThatMeet(met, blocks[b].count, number, of.lanes)
                                : TilesThatMeet(met, blocks[b].count, tile_rays, number, of.lanes);
    for (int at = 0; at < seen.count; ++at) {
      const int lane = of.lanes[at];
      const Vec3f direction = mirror.Direction(blocks[b].target(lane));
      seen.target_x[at] = direction.x;
      seen.target_y[at] = direction.y;
      seen.target_z[at] = direction.z;
      of.near[at] = blocks[b].t[lane];
    }
  }
  return rays;
}

}  // namespace sightline
