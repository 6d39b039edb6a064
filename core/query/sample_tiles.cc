// SPDX-License-Identifier: Apache-2.0
//
// A tracer's points by kRtt: in tiles, which need not divide its blocks.
#include <algorithm>
#include <memory>
#include <span>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/query/sample_tracer.h"
#include "core/traverse/rtt.h"

namespace sightline {
namespace {

// The packets that a tile takes, and the tiles that a packet holds, at most.
constexpr size_t kMostTilePackets =
    (RttTileRays(kMaxRttAntialiasing) + kBlockRays - 1) / kBlockRays;
constexpr size_t kMostPacketTiles = kBlockRays / RttTileRays(1);

}  // namespace

absl::Status SampleTracer::TraceTiles(const LightSample& sample, uint32_t mask, StatsScope* scope) {
  parallel_traced_ = packets_ready_ = false;
  packets_.Reserve(blocks());
  if (tile_packets_ == nullptr) {
    tile_packets_ = std::make_unique_for_overwrite<RayPacket[]>(kMostTilePackets);
    if (record_answered_by_) tile_answered_by_.resize(kMostTilePackets * kBlockRays);
  }
  const std::span<RayPacket> packets(tile_packets_.get(), kMostTilePackets);
  for (size_t i = 0; i < packets.size(); ++i) {
    packets[i].origin = sample.value;
    packets[i].segments = true;
    packets[i].mask = mask;
    packets[i].origin_source = sample.source_triangle;
    packets[i].answered_by =
        record_answered_by_ ? tile_answered_by_.data() + i * kBlockRays : nullptr;
  }
  const size_t tile = RttTileRays(run_.options().rtt_antialiasing), all = positions_.size();
  const bool large = tile > kBlockRays;
  const size_t most = large ? 1 : kBlockRays / tile;  // Tiles that are asked about together.
  for (size_t first = 0, tiles_before = 0; first < all;) {
    // Where each one's points begin, and where the last one's end.
    size_t begin[kMostPacketTiles + 1] = {first}, count = 0;
    for (; count < most && first < all; ++count) {
      const size_t end =
          tile_ends_.empty() ? std::min(first + tile, all) : size_t{tile_ends_[tiles_before++]};
      SIGHTLINE_CHECK(end > first && end - first <= tile) << first << " to " << end;
      begin[count + 1] = first = end;
    }
    // fn(packet, lane, point, count) for points in lanes that follow one another.
    const auto for_each_run = [&](const auto& fn) {
      for (size_t i = 0; i < count; ++i) {
        for (size_t at = begin[i]; at < begin[i + 1]; at += kBlockRays) {
          const size_t part = (at - begin[i]) / kBlockRays;
          fn(packets[part], i * tile, at, std::min<size_t>(kBlockRays, begin[i + 1] - at));
        }
      }
    };
    for_each_run([&](RayPacket& packet, size_t lane, size_t point, size_t points) {
      Box3f box;  // Nobody asks for it.
      LayOut(sample, point, points, packet.target_x + lane, packet.target_y + lane,
             packet.target_z + lane, packet.target_source + lane, &box);
      packet.count = static_cast<int>(lane + points);
      if (large) return;
      // Those that a tile lacks are its last one again: the next tile keeps its lanes.
      const auto fill = [&](auto* row) {
        std::fill_n(row + lane + points, tile - points, row[lane + points - 1]);
      };
      fill(packet.target_x);
      fill(packet.target_y);
      fill(packet.target_z);
      fill(packet.target_source);
    });
    const size_t parts = (begin[1] - begin[0] + kBlockRays - 1) / kBlockRays;
    SL_RETURN_IF_ERROR(large
                           ? TraceRttTile(scene_, run_, kind_, packets.first(parts), scope->walk())
                           : TracePacketBlock(scene_, run_, kind_, Strategy::kRtt, packets.data(),
                                              nullptr, scope->walk()));
    scope->Took(Strategy::kRtt);
    for_each_run([&](const RayPacket& packet, size_t lane, size_t point, size_t points) {
      for (size_t i = 0; i < points; ++i) {
        RayPacket& block = packets_[(point + i) / kBlockRays];
        block.triangle[(point + i) % kBlockRays] = packet.triangle[lane + i];
        block.t[(point + i) % kBlockRays] = packet.t[lane + i];
      }
      if (!record_answered_by_) return;
      std::copy_n(packet.answered_by + lane, points, answered_by_.data() + point);
    });
  }
  return absl::OkStatus();
}

}  // namespace sightline
