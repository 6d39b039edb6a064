// SPDX-License-Identifier: Apache-2.0
//
// A packet's shaft (shaft-inl.h), or what answers the packet where no frame holds its rays.
//
// Thread safety: a walk is one thread's own.

#if defined(SIGHTLINE_CORE_TRAVERSE_TRACE_SHAFT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_TRACE_SHAFT_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_TRACE_SHAFT_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_TRACE_SHAFT_INL_H_
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/base/fill-inl.h"
#include "core/traverse/occluded_packet-inl.h"
#include "core/traverse/packet-inl.h"
#include "core/traverse/shaft-inl.h"
#include "core/traverse/single-inl.h"
#include "core/traverse/trace_ray.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Says by bits what `triangle` says, if that is wanted.
template <class Packet>
HWY_NOINLINE void SayBlocked(Packet& packet) {
  if (packet.blocked == nullptr) return;
  for (int b = 0; b < kShaftBlocks; ++b) {
    uint32_t bits = 0;
    const int first = b * kShaftBlockRays;
    for (int i = first; i < std::min(first + kShaftBlockRays, packet.count); ++i) {
      bits |= (packet.triangle[i] != kNoTriangle ? 1u : 0u) << (i - first);
    }
    if (packet.unasked != nullptr) bits &= ~uint32_t{packet.unasked[b]};
    packet.blocked[b] = static_cast<uint16_t>(bits);
  }
}

// Rays that no frame holds walk as a packet.
template <bool kAny>
bool TraceShaft(const IndexedGeometry& scene, RayPacket& packet, const ShaftCut* cut,
                const CancelToken* cancel, WalkStats* stats) {
  SIGHTLINE_DCHECK(packet.near == nullptr && packet.unseen.count == 0);  // It knows neither.
  if (packet.count == 0) return true;
  if (cut != nullptr && cut->node_count == 0) {
    // Nothing is in reach of any ray.
    if (kAny && packet.blocked != nullptr) {
      std::fill_n(packet.blocked, kShaftBlocks, uint16_t{0});
      return true;
    }
    FillRow(packet.triangle, static_cast<size_t>(packet.count), kNoTriangle);
    if constexpr (!kAny) FillMisses(packet, 0, static_cast<size_t>(packet.count));
    return true;
  }
  ShaftWalk<kAny, false> walk(scene, packet, stats);
  if (walk.Prepare()) return walk.Run(cut, cancel);
  MarkAll(packet, AnsweredBy::kPacket);
  if constexpr (kAny) {
    if (!TraceOccludedPacket<OriginLanes>(scene, packet, cancel, stats)) return false;
    SayBlocked(packet);
    return true;
  } else {
    return TraceClosestPacket(scene, packet, cancel, stats);
  }
}

// False: it answers nothing, since no frame holds the rays, or `cancel` fired. Pair: PacketPair, of
// which nothing is compiled where nobody asks.
template <class Pair>
bool TraceShaftPair(const IndexedGeometry& scene, Pair& packets, const ShaftCut* cut,
                    const CancelToken* cancel, WalkStats* stats) {
  if (cut != nullptr && cut->node_count == 0) {
    std::fill_n(packets.blocked, kShaftBlocks, uint32_t{0});
    return true;
  }
  ShaftWalk<true, false, Pair> walk(scene, packets, stats);
  return walk.Prepare() && walk.Run(cut, cancel);
}

// Rays that no frame holds walk by themselves.
inline bool TraceParallelShaft(const IndexedGeometry& scene, ParallelPacket& packet,
                               const ShaftCut* cut, const CancelToken* cancel, WalkStats* stats) {
  if (packet.count == 0) return true;
  ShaftWalk<true, true> walk(scene, packet, stats);
  if (walk.Prepare()) return walk.Run(cut, cancel);
  MarkAll(packet, AnsweredBy::kRay);
  TraceRay rays[ParallelPacket::kMaxRays];
  Hit hits[ParallelPacket::kMaxRays];
  const size_t count = static_cast<size_t>(packet.count);
  for (size_t i = 0; i < count; ++i) {
    rays[i] = packet.trace_ray(static_cast<int>(i));
  }
  if (!TraceSingle<true>(scene, {rays, count}, hits, cancel, stats)) return false;
  for (size_t i = 0; i < count; ++i) packet.triangle[i] = hits[i].triangle;
  SayBlocked(packet);
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
