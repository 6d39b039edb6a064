// SPDX-License-Identifier: Apache-2.0
//
// The rays of a picture's blocks that meet mirrors, and packets of what they see there
// (core/query/mirrors.h). Internal to core/query.
//
// Thread safety: belongs to one thread.
//
//   MirroredRays rays(blocks.size(), packets[0], /*record_answered_by=*/false);
//   rays.Meet(mirrors, blocks[0], SquareLanes::kWhole, packets[0], 0);
//   if (rays.LayOut(mirrors[0], 1, packets, /*tile_rays=*/0) > 0) ... rays.packets() are to walk.
#ifndef SIGHTLINE_CORE_QUERY_MIRRORED_RAYS_H_
#define SIGHTLINE_CORE_QUERY_MIRRORED_RAYS_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/query/mirrors.h"
#include "core/query/pixel_runs.h"
#include "core/query/tile_result.h"
#include "core/traverse/answered_by.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

class MirroredRays {
 public:
  // Of so many blocks at a time, whose rays have in common what `eye` says.
  MirroredRays(size_t blocks, const RayPacket& eye, bool record_answered_by);
  // Packets refer to what is beside them.
  MirroredRays(const MirroredRays&) = delete;
  MirroredRays& operator=(const MirroredRays&) = delete;

  // Which mirrors block `b` meets: `packet` is traced, its lanes are those of `block`.
  void Meet(std::span<const PreparedMirror> mirrors, const TileRect& block, SquareLanes lanes,
            const RayPacket& packet, size_t b);
  // By lane of a block: the mirror's number from 1 on, or 0.
  const uint8_t* mirror_of(size_t b) const { return mirror_of_[b].data(); }

  // Makes packets of the rays of `blocks` that meet mirror `number`, one for each block that has
  // some. Returns how many rays of pixels they hold. `tile_rays`: where it is not 0, as in
  // RttOptions: tiles that meet the mirror stay tiles, in which others of their rays stand again
  // for those that miss it.
  size_t LayOut(const PreparedMirror& mirror, uint8_t number, std::span<const RayPacket> blocks,
                int tile_rays);
  std::span<RayPacket> packets() { return {packets_.data(), count_}; }
  // What a packet is of: the block, and by lane the block's.
  size_t block_of(size_t packet) const { return of_[packet].block; }
  const int* lanes_of(size_t packet) const { return of_[packet].lanes; }

 private:
  static constexpr size_t kRays = RayPacket::kMaxRays;
  struct Of {
    alignas(64) float near[kRays];
    AnsweredBy answered_by[kRays];
    int lanes[kRays];
    size_t block;
  };

  std::vector<std::array<uint8_t, kRays>> mirror_of_;  // By block.
  static_assert(kMaxMirrors < 256);
  std::vector<RayPacket> packets_;
  std::vector<Of> of_;  // By packet.
  size_t count_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_MIRRORED_RAYS_H_
