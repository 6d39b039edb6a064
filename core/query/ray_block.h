// SPDX-License-Identifier: Apache-2.0
//
// A block of rays that belong together, answered by whichever walk the strategy names: the seam
// between what is asked (tiles, shadows, segments) and how it is found. Internal to core/query.
//
// Thread safety: plain values and functions.
#ifndef SIGHTLINE_CORE_QUERY_RAY_BLOCK_H_
#define SIGHTLINE_CORE_QUERY_RAY_BLOCK_H_

#include <array>
#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/query/query_run.h"
#include "core/query/walk_choice.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

inline constexpr int kBlockRays = RayPacket::kMaxRays;
// Neighbouring blocks that begin their walks at a common cut.
inline constexpr int kGroupBlocks = 16;
inline constexpr int kGroupRays = kGroupBlocks * kBlockRays;

enum class HitKind : uint8_t { kAny, kClosest };

// What the rays of a block have in common.
// Mirrored: one origin, and hits count from `near` on.
enum class RayForm : uint8_t { kFree, kOneOrigin, kMirrored, kParallel };

// What is used where a strategy was asked for: what AUTO chooses for so many rays together, and
// what stands in for a strategy that such rays have no walk of. Never kAuto.
Strategy ChooseStrategy(const QueryRun& run, RayForm form, HitKind kind, size_t rays);
// What blocks of rays may be walked by instead, block by block, where that chose shafts.
WalkChoice::Others OtherWalks(const QueryRun& run, RayForm form, HitKind kind);

// All below take what ChooseStrategy gave, and add to *stats what they did. REQUIRES: CheckOptions.

// Any rays: kSingle or kBruteForce. With kAny a hit's triangle is some blocker's id; its t is
// meaningless.
absl::Status TraceRayBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                           Strategy strategy, std::span<const TraceRay> rays, std::span<Hit> hits,
                           WalkStats* stats);

// Where the packets of a group begin their walks as shafts: made into *cut, or null (from the root)
// where they fit none together. The packets stand for all rays between theirs, too: a camera's tile
// is given by its corners (core/shaft/margins.h).
const ShaftCut* CutGroup(const IndexedGeometry& scene, const QueryRun& run,
                         std::span<const RayPacket> packets, ShaftCut* cut);
const ShaftCut* CutGroup(const IndexedGeometry& scene, const QueryRun& run,
                         std::span<const ParallelPacket> packets, ShaftCut* cut);

// Up to kBlockRays rays with one origin. packet.origin … want_barycentrics are read, its results
// written; the mask is taken from the packet. `cut` as in kernels.h, used by shafts alone. Under
// kRtt as many rays that follow one another as a tile has are one, all where that is more than a
// packet holds.
absl::Status TracePacketBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                              Strategy strategy, RayPacket* packet, const ShaftCut* cut,
                              WalkStats* stats);

// One tile of kRtt that is more than a packet, cut into packets with one origin and some rays each;
// else as TracePacketBlock. REQUIRES: RttTileRays(rtt_antialiasing) > kBlockRays.
absl::Status TraceRttTile(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                          std::span<RayPacket> packets, WalkStats* stats);

// Up to kBlockRays rays with one direction, any hit: as one shaft, as packets (over the BVH, by the
// predicate), or by kSingle.
absl::Status TraceParallelBlock(const IndexedGeometry& scene, const QueryRun& run,
                                Strategy strategy, ParallelPacket* packet, const ShaftCut* cut,
                                WalkStats* stats);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_RAY_BLOCK_H_
