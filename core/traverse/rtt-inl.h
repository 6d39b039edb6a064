// SPDX-License-Identifier: Apache-2.0
//
// Relevant triangles tracing (paper 002) on the kd-tree: the four corner rays of a tile's shaft
// walk together, and gather the triangles that a ray between them may meet. As long as they go
// through the same cells, no ray between them can go through another; its answer is the list's
// (rtt_walk-inl.h). The rays of tiles whose corners part walk as a packet does (kd_packet-inl.h).
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_RTT_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <span>
#include <utility>

#include "core/accel/kd_tree.h"
#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/traverse/finish-inl.h"
#include "core/traverse/kd_packet-inl.h"
#include "core/traverse/leaf_range.h"
#include "core/traverse/packet_lanes-inl.h"
#include "core/traverse/rtt.h"
#include "core/traverse/rtt_walk-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// The rays of one packet are put to a list of triangles.
template <bool kAny>
void PutToList(const SceneGeometry& geometry, std::span<const uint32_t> ids, int first, int count,
               PacketLanes<kAny>& lanes) {
  const hn::CappedTag<float, 16> d;
  const uint32_t width = static_cast<uint32_t>(hn::Lanes(d));
  const uint32_t begin = static_cast<uint32_t>(first) / width;
  const uint32_t end = (static_cast<uint32_t>(first + count) + width - 1) / width;
  const LeafRange range = LeafRange::Of(ids);
  for (uint32_t at = 0; at < range.count; at += kMaxLeafTriangles) {
    const RangeView some(geometry, range, at);
    const LeafView& view = some.leaf;
    FacingTriangle facing[kMaxLeafTriangles];
    const uint32_t turned = TurnTriangles(lanes, view, (1u << view.count) - 1, facing);
    for (uint32_t group = begin; group < end; ++group) {
      for (uint32_t i = 0; i < turned && lanes.active(group) != 0; ++i) {
        lanes.Test(view, facing[i], group, lanes.active(group));
      }
    }
  }
}

// Answers packets of rays with one origin by their tiles, and walks with the rest.
template <bool kAny>
class RttTracer {
 public:
  RttTracer(const IndexedGeometry& scene, const RttOptions& options, const CancelToken* cancel,
            WalkStats* stats)
      : scene_(scene),
        options_(options),
        side_by_side_(options.side_by_side == 0 ? kMaxRttTiles
                                                : std::min(options.side_by_side, kMaxRttTiles)),
        cancel_(cancel),
        poll_(cancel),
        stats_(stats) {}

  // Tiles of a packet. Returns false if the token fired.
  bool TracePacket(RayPacket& packet) {
    PacketLanes<kAny> lanes(scene_, packet, stats_);
    const int tile = std::min(options_.tile_rays, packet.count);
    stats_->tiles += static_cast<uint32_t>((packet.count + tile - 1) / tile);
    Pass pass = {&packet, &lanes, SquaresOf({&packet, 0, packet.count})};
    // Camera rays are a square of squares, of which a quarter is no range; points come by tiles.
    const bool quarters = options_.tile_rays == kQuarterRays &&
                          packet.count == RayPacket::kMaxRays && !packet.segments;
    return (quarters ? TryQuarters(&pass) : TryTiles(&pass)) && WalkRest(pass);
  }

  // All packets as one tile.
  bool TraceTogether(std::span<RayPacket> packets) {
    if (cancel_ != nullptr && cancel_->cancelled()) return false;
    RttRays rays[kMaxPackets];
    for (size_t i = 0; i < packets.size(); ++i) {
      PadTargets(packets[i]);
      rays[i] = {&packets[i], 0, packets[i].count};
    }
    const std::span<const RttRays> all(rays, packets.size());
    RttTile& tile = tiles_[0];
    ++stats_->tiles;
    bool gathered = tile.shaft.Bound(all);
    if (gathered) {
      tile.list.emplace(scene_, tile.shaft, all, kAny, options_.shared_edges, stats_);
      gathered = RttWalk<1>(scene_, &tile, 1, stats_, &poll_).Run() != 0;
      if (poll_.stopped()) return false;
    }
    stats_->tiles_answered += gathered;
    if (gathered) stats_->relevant_triangles += tile.list->ids().size();
    for (RayPacket& packet : packets) {
      PacketLanes<kAny> lanes(scene_, packet, stats_);
      const RttRays own = {&packet, 0, packet.count};
      if (gathered) Answer(*tile.list, own, &lanes);
      if (!WalkRest({&packet, &lanes, gathered ? 0 : SquaresOf(own)})) return false;
    }
    return true;
  }

  static constexpr size_t kMaxPackets = 16;

 private:
  // Squares of four by four rays follow one another in a packet, four to a row where it is full.
  static constexpr int kSquareRays = RttTileRays(1);
  static constexpr int kQuarterRays = RttTileRays(2);
  static_assert(RayPacket::kMaxRays == 16 * kSquareRays && kQuarterRays == 4 * kSquareRays);

  struct Pass {
    RayPacket* packet;
    PacketLanes<kAny>* lanes;
    uint32_t left;  // Its squares that have no answer yet.
  };

  static void PadTargets(RayPacket& packet) {
    const int lanes = 16;
    for (int i = packet.count; i % lanes != 0; ++i) {
      packet.target_x[i] = packet.target_x[packet.count - 1];
      packet.target_y[i] = packet.target_y[packet.count - 1];
      packet.target_z[i] = packet.target_z[packet.count - 1];
      packet.target_source[i] = kNoTriangle;
    }
  }

  // REQUIRES: first is a square's.
  static uint32_t SquaresOf(const RttRays& rays) {
    const int first = rays.first / kSquareRays,
              end = (rays.first + rays.count + kSquareRays - 1) / kSquareRays;
    return ((1u << end) - 1) & ~((1u << first) - 1);
  }

  // Puts a tile to those that wait, and has them walk when they are enough. False: the token fired.
  bool AddTile(std::span<const RttRays> parts, Pass* pass) {
    RttTile& tile = tiles_[count_];
    tile.part_count = static_cast<int>(parts.size());
    std::copy(parts.begin(), parts.end(), tile.parts);
    if (!tile.shaft.Bound(tile.rays())) return true;
    tile.list.emplace(scene_, tile.shaft, tile.rays(), kAny, options_.shared_edges, stats_);
    return ++count_ < side_by_side_ || AnswerTiles(pass);
  }

  // Those that wait. False: the token fired.
  bool AnswerTiles(Pass* pass) {
    if (cancel_ != nullptr && cancel_->cancelled()) return false;
    if (count_ == 0) return true;
    const uint32_t gathered = WalkRttTiles(scene_, tiles_, count_, stats_, &poll_);
    if (poll_.stopped()) return false;
    for (int i = 0; i < count_; ++i) {
      if ((gathered >> i & 1) == 0) continue;
      const RttTile& tile = tiles_[i];
      for (const RttRays& part : tile.rays()) {
        Answer(*tile.list, part, pass->lanes);
        pass->left &= ~SquaresOf(part);
      }
      ++stats_->tiles_answered;
      stats_->relevant_triangles += tile.list->ids().size();
    }
    count_ = 0;
    return true;
  }

  // Rays that follow one another.
  bool TryTiles(Pass* pass) {
    const int end = pass->packet->count;
    for (int first = 0; first < end; first += options_.tile_rays) {
      const RttRays rays = {pass->packet, first, std::min(options_.tile_rays, end - first)};
      if (!AddTile({&rays, 1}, pass)) return false;
    }
    return AnswerTiles(pass);
  }

  // Two squares of a row, and the two below.
  bool TryQuarters(Pass* pass) {
    constexpr int kHalfRow = 2 * kSquareRays, kRow = 4 * kSquareRays;
    for (const int first : {0, kHalfRow, 2 * kRow, 2 * kRow + kHalfRow}) {
      const RttRays halves[] = {{pass->packet, first, kHalfRow},
                                {pass->packet, first + kRow, kHalfRow}};
      if (!AddTile(halves, pass)) return false;
    }
    return AnswerTiles(pass);
  }

  void Answer(const RttList& list, const RttRays& rays, PacketLanes<kAny>* lanes) {
    // Paper 002 tells tiles without a relevant triangle from those with some: one that covers the
    // tile is one, though no ray is put to it.
    const bool none = list.blocker() == kNoTriangle && list.ids().empty();
    if (list.blocker() != kNoTriangle) {
      const uint32_t end = GroupAt(rays.first + rays.count + kWidth - 1);
      for (uint32_t group = GroupAt(rays.first); group < end; ++group) {
        lanes->Block(list.blocker(), group, lanes->active(group));
      }
    } else if (!none) {
      PutToList(scene_.geometry, list.ids(), rays.first, rays.count, *lanes);
    }
    if (rays.packet->answered_by != nullptr) {
      std::fill_n(rays.packet->answered_by + rays.first, rays.count,
                  none ? AnsweredBy::kShaft : AnsweredBy::kTriangles);
    }
  }

  // What is left, as conventional SIMD ray tracing does it. Then what winners want.
  bool WalkRest(const Pass& pass) {
    RayPacket& packet = *pass.packet;
    uint32_t groups = 0;
    for (uint32_t left = pass.left; left != 0; left &= left - 1) {
      const int first = std::countr_zero(left) * kSquareRays;
      const int end = std::min(first + kSquareRays, packet.count);
      for (int i = first; i < end; i += kWidth) groups |= 1u << GroupAt(i);
      if (packet.answered_by != nullptr) {
        std::fill(packet.answered_by + first, packet.answered_by + end, AnsweredBy::kPacket);
      }
    }
    if (!WalkKdTree(scene_, *pass.lanes, groups, cancel_, stats_)) return false;
    if (kAny || !packet.want_barycentrics) return true;
    ReadyTriangles ready(scene_.geometry, packet.origin, /*weights=*/true);
    FinishHits(ready, packet);
    return true;
  }

  static constexpr int kWidth = static_cast<int>(hn::MaxLanes(hn::CappedTag<float, 16>()));
  static uint32_t GroupAt(int lane) { return static_cast<uint32_t>(lane / kWidth); }

  const IndexedGeometry& scene_;
  const RttOptions& options_;
  const int side_by_side_;
  const CancelToken* const cancel_;
  PacketPoll poll_;
  WalkStats* const stats_;
  RttTile tiles_[kMaxRttTiles];  // That wait for others to walk with.
  int count_ = 0;
};

template <bool kAny>
bool TraceRtt(const IndexedGeometry& scene, std::span<RayPacket> packets, const RttOptions& options,
              const CancelToken* cancel, WalkStats* stats) {
  RttTracer<kAny> tracer(scene, options, cancel, stats);
  if (options.tile_rays > RayPacket::kMaxRays) {
    SIGHTLINE_CHECK_LE(packets.size(), RttTracer<kAny>::kMaxPackets);
    for (const RayPacket& packet : packets) SIGHTLINE_CHECK_GT(packet.count, 0);
    return packets.empty() || tracer.TraceTogether(packets);
  }
  SIGHTLINE_CHECK(options.tile_rays > 0 && options.tile_rays % 16 == 0) << options.tile_rays;
  for (RayPacket& packet : packets) {
    if (packet.count > 0 && !tracer.TracePacket(packet)) return false;
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
