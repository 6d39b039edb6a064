// SPDX-License-Identifier: Apache-2.0
#include "core/query/ray_block.h"

#include <algorithm>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/intersect/hit.h"

namespace sightline {
namespace {

// AUTO's rule for rays that belong together: a shaft of one to three rays costs more than the
// single walk, which tests eight boxes and sixteen triangles a step whatever the number of rays.
constexpr size_t kMinShaftRays = 4;

// What a walk's rays are answered by, as far as its strategy tells.
AnsweredBy AnsweredByWalk(Strategy strategy) {
  // A tile's list says so itself.
  return strategy == Strategy::kShaft    ? AnsweredBy::kShaft
         : strategy == Strategy::kPacket ? AnsweredBy::kPacket
                                         : AnsweredBy::kRay;
}

// The lanes of a packet whose answers are wanted (RayPacket::unasked), in their order.
class AskedLanes {
 public:
  AskedLanes(int count, const uint16_t* unasked) {
    for (int lane = 0; lane < count; ++lane) {
      if (LaneBits(unasked, static_cast<size_t>(lane), 1) == 0) lanes_[size_++] = lane;
    }
  }
  size_t size() const { return size_; }
  int operator[](size_t k) const { return lanes_[k]; }

 private:
  size_t size_ = 0;
  std::array<int, kBlockRays> lanes_;
};

bool TraceOnePacket(const IndexedGeometry& scene, const QueryRun& run, bool any, RayPacket& packet,
                    WalkStats* stats) {
  if (run.culling() != nullptr) {
    const CulledKernels& culled = run.culled_kernels();
    return (any ? culled.occluded_packet : culled.closest_packet)(scene, *run.culling(), packet,
                                                                  run.cancel(), stats);
  }
  const Kernels& kernels = run.kernels();
  const TracePacketFn trace = run.on_kd_tree()
                                  ? (any ? kernels.occluded_kd_packet : kernels.closest_kd_packet)
                                  : (any ? kernels.occluded_packet : kernels.closest_packet);
  return trace(scene, packet, run.cancel(), stats);
}

// By as many rays at a time as were asked for.
bool TracePackets(const IndexedGeometry& scene, const QueryRun& run, bool any, RayPacket* packet,
                  WalkStats* stats) {
  const int rays = run.options().packet_side * run.options().packet_side;
  if (packet->count <= rays) return TraceOnePacket(scene, run, any, *packet, stats);
  RayPacket part;
  part.first_leaf = packet->first_leaf;  // Each part's leaf is the next one's.
  for (int first = 0; first < packet->count; first += rays) {
    const int count = std::min(rays, packet->count - first);
    packet->CopyLanes(first, count, &part);
    if (!TraceOnePacket(scene, run, any, part, stats)) return false;
    std::copy_n(part.triangle, count, packet->triangle + first);
    if (any) continue;
    std::copy_n(part.t, count, packet->t + first);
    if (!packet->want_barycentrics) continue;
    std::copy_n(part.u, count, packet->u + first);
    std::copy_n(part.v, count, packet->v + first);
  }
  packet->first_leaf = part.first_leaf;
  return true;
}

// Rays of one direction walk together over the BVH alone, by the predicate, and do not cull within
// leaves.
bool HasParallelPackets(const QueryRun& run) {
  return !run.on_kd_tree() && !run.on_binary_bvh() && run.culling() == nullptr;
}

// As TracePackets.
bool TraceParallelPackets(const IndexedGeometry& scene, const QueryRun& run, ParallelPacket* packet,
                          WalkStats* stats) {
  const TraceParallelPacketFn trace = run.kernels().occluded_parallel_packet;
  const int rays = run.options().packet_side * run.options().packet_side;
  if (packet->count <= rays) return trace(scene, *packet, run.cancel(), stats);
  ParallelPacket part;
  part.first_leaf = packet->first_leaf;
  for (int first = 0; first < packet->count; first += rays) {
    packet->CopyLanes(first, std::min(rays, packet->count - first), &part);
    if (!trace(scene, part, run.cancel(), stats)) return false;
    std::copy_n(part.triangle, part.count, packet->triangle + first);
  }
  packet->first_leaf = part.first_leaf;
  return true;
}

absl::Status TraceRtt(const IndexedGeometry& scene, const QueryRun& run, bool any,
                      std::span<RayPacket> packets, int tile_rays, WalkStats* stats) {
  const RttOptions options{.tile_rays = tile_rays,
                           .side_by_side = run.options().rtt_side_by_side,
                           .shared_edges = run.options().rtt_shared_edges};
  const Kernels& kernels = run.kernels();
  const TraceRttFn trace = any ? kernels.occluded_rtt : kernels.closest_rtt;
  return trace(scene, packets, options, run.cancel(), stats) ? absl::OkStatus() : run.Stopped();
}

}  // namespace

Strategy ChooseStrategy(const QueryRun& run, RayForm form, HitKind kind, size_t rays) {
  const Strategy asked = run.options().strategy;
  const bool one_origin = form == RayForm::kOneOrigin || form == RayForm::kMirrored;
  const bool any_parallel = form == RayForm::kParallel && kind == HitKind::kAny;
  const bool shaft_fits = form == RayForm::kOneOrigin || any_parallel;
  switch (asked) {
    case Strategy::kAuto:
      // On the kd-tree packets were the fastest of all (core/traverse/DESIGN.md).
      if (run.on_kd_tree() || run.on_binary_bvh() || form == RayForm::kMirrored) {
        return one_origin && rays >= kMinShaftRays ? Strategy::kPacket : Strategy::kSingle;
      }
      return shaft_fits && rays >= kMinShaftRays ? Strategy::kShaft : Strategy::kSingle;
    case Strategy::kRtt:
      return one_origin ? Strategy::kRtt : Strategy::kSingle;
    case Strategy::kShaft:
      // The shaft's walk bounds the nearest hit before it knows it, and has no other end to count
      // from.
      return shaft_fits                   ? Strategy::kShaft
             : form == RayForm::kMirrored ? Strategy::kPacket
                                          : Strategy::kSingle;
    case Strategy::kPacket:
      return one_origin || (any_parallel && HasParallelPackets(run)) ? Strategy::kPacket
                                                                     : Strategy::kSingle;
    case Strategy::kSingle:
    case Strategy::kBruteForce:
      return asked;
  }
  return Strategy::kSingle;
}

WalkChoice::Others OtherWalks(const QueryRun& run, RayForm form, HitKind kind) {
  if (run.options().strategy != Strategy::kAuto) return WalkChoice::Others::kNone;
  return form == RayForm::kParallel ? WalkChoice::Others::kParallel
         : kind == HitKind::kAny    ? WalkChoice::Others::kOneOrigin
                                    : WalkChoice::Others::kClosest;
}

absl::Status TraceRayBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                           Strategy strategy, std::span<const TraceRay> rays, std::span<Hit> hits,
                           WalkStats* stats) {
  SIGHTLINE_CHECK_LE(rays.size(), hits.size());
  if (rays.empty()) return absl::OkStatus();
  const Kernels& kernels = run.kernels();
  const bool brute = strategy == Strategy::kBruteForce;
  const bool any = kind == HitKind::kAny;
  if (brute ? run.by_intersector() : run.culling() != nullptr) {
    const CulledKernels& culled = run.culled_kernels();
    const TraceCulledRaysFn trace = brute ? (any ? culled.occluded_brute : culled.closest_brute)
                                    : any ? culled.occluded_single
                                          : culled.closest_single;
    return trace(scene, *run.culling(), rays, hits, run.cancel(), stats) ? absl::OkStatus()
                                                                         : run.Stopped();
  }
  const TraceRaysFn trace = brute ? (any ? kernels.occluded_brute : kernels.closest_brute)
                            : run.on_kd_tree()
                                ? (any ? kernels.occluded_kd_single : kernels.closest_kd_single)
                                : (any ? kernels.occluded_single : kernels.closest_single);
  return trace(scene, rays, hits, run.cancel(), stats) ? absl::OkStatus() : run.Stopped();
}

const ShaftCut* CutGroup(const IndexedGeometry& scene, const QueryRun& run,
                         std::span<const RayPacket> packets, ShaftCut* cut) {
  return run.kernels().cut_shaft(scene, packets, cut) ? cut : nullptr;
}

const ShaftCut* CutGroup(const IndexedGeometry& scene, const QueryRun& run,
                         std::span<const ParallelPacket> packets, ShaftCut* cut) {
  return run.kernels().cut_parallel_shaft(scene, packets, cut) ? cut : nullptr;
}

absl::Status TracePacketBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                              Strategy strategy, RayPacket* packet, const ShaftCut* cut,
                              WalkStats* stats) {
  SIGHTLINE_CHECK_LE(packet->count, kBlockRays);
  SIGHTLINE_CHECK(strategy != Strategy::kAuto);
  if (packet->count == 0) return absl::OkStatus();
  if (packet->answered_by != nullptr) {
    std::fill_n(packet->answered_by, packet->count, AnsweredByWalk(strategy));
  }
  const bool any = kind == HitKind::kAny;
  const Kernels& kernels = run.kernels();
  if (strategy == Strategy::kRtt) {
    return TraceRtt(scene, run, any, {packet, 1},
                    std::min(RttTileRays(run.options().rtt_antialiasing), kBlockRays), stats);
  }
  if (strategy == Strategy::kPacket) {
    packet->cut = cut;
    const bool whole = TracePackets(scene, run, any, packet, stats);
    packet->cut = nullptr;
    return whole ? absl::OkStatus() : run.Stopped();
  }
  if (strategy == Strategy::kShaft) {
    return (any ? kernels.occluded_shaft : kernels.closest_shaft)(scene, *packet, cut, run.cancel(),
                                                                  stats)
               ? absl::OkStatus()
               : run.Stopped();
  }
  std::array<TraceRay, kBlockRays> rays;
  std::array<Hit, kBlockRays> hits;
  const AskedLanes asked(packet->count, packet->unasked);
  for (size_t k = 0; k < asked.size(); ++k) rays[k] = packet->trace_ray(asked[k]);
  SL_RETURN_IF_ERROR(
      TraceRayBlock(scene, run, kind, strategy, {rays.data(), asked.size()}, hits, stats));
  for (size_t k = 0; k < asked.size(); ++k) {
    const int i = asked[k];
    packet->t[i] = hits[k].t;
    packet->triangle[i] = hits[k].triangle;
    packet->u[i] = packet->v[i] = 0;
    if (packet->want_barycentrics && kind == HitKind::kClosest && hits[k].triangle != kNoTriangle) {
      const auto [a, b, c] = scene.geometry.Corners(hits[k].triangle);
      if (run.options().intersector == Intersector::kExact) {
        HitBarycentrics(packet->ray(i), a, b, c, &packet->u[i], &packet->v[i]);
        continue;
      }
      IntersectorHit at;
      IntersectRay(run.options().intersector, packet->ray(i), a, b, c, &at);
      packet->u[i] = at.u;
      packet->v[i] = at.v;
    }
  }
  return absl::OkStatus();
}

absl::Status TraceRttTile(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                          std::span<RayPacket> packets, WalkStats* stats) {
  const int tile_rays = RttTileRays(run.options().rtt_antialiasing);
  SIGHTLINE_CHECK_GT(tile_rays, kBlockRays);
  return TraceRtt(scene, run, kind == HitKind::kAny, packets, tile_rays, stats);
}

absl::Status TraceParallelBlock(const IndexedGeometry& scene, const QueryRun& run,
                                Strategy strategy, ParallelPacket* packet, const ShaftCut* cut,
                                WalkStats* stats) {
  SIGHTLINE_CHECK_LE(packet->count, kBlockRays);
  if (packet->count == 0) return absl::OkStatus();
  if (packet->answered_by != nullptr) {
    std::fill_n(packet->answered_by, packet->count, AnsweredByWalk(strategy));
  }
  if (strategy == Strategy::kSingle) {
    std::array<TraceRay, kBlockRays> rays;
    std::array<Hit, kBlockRays> hits;
    const AskedLanes asked(packet->count, packet->unasked);
    for (size_t k = 0; k < asked.size(); ++k) rays[k] = packet->trace_ray(asked[k]);
    SL_RETURN_IF_ERROR(TraceRayBlock(scene, run, HitKind::kAny, strategy,
                                     {rays.data(), asked.size()}, hits, stats));
    for (size_t k = 0; k < asked.size(); ++k) packet->triangle[asked[k]] = hits[k].triangle;
    return absl::OkStatus();
  }
  if (strategy == Strategy::kPacket) {
    packet->cut = cut;
    const bool whole = TraceParallelPackets(scene, run, packet, stats);
    packet->cut = nullptr;
    return whole ? absl::OkStatus() : run.Stopped();
  }
  SIGHTLINE_CHECK(strategy == Strategy::kShaft);
  return run.kernels().occluded_parallel_shaft(scene, *packet, cut, run.cancel(), stats)
             ? absl::OkStatus()
             : run.Stopped();
}

}  // namespace sightline
