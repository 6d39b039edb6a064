// SPDX-License-Identifier: Apache-2.0
#include "core/query/ray_block.h"

#include <algorithm>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/intersect/hit.h"

namespace sightline {
namespace {

// AUTO's rule for rays with one origin: packets of one to three rays walk with most lanes idle,
// while the single walk tests eight boxes and sixteen triangles a step whatever the number of rays.
constexpr int kMinPacketRays = 4;

Strategy Choose(Strategy asked, bool common_origin, int rays) {
  if (asked == Strategy::kAuto) {
    return common_origin && rays >= kMinPacketRays ? Strategy::kPacket : Strategy::kSingle;
  }
  if ((asked == Strategy::kPacket || asked == Strategy::kShaft) && !common_origin) {
    return Strategy::kSingle;
  }
  return asked;
}

}  // namespace

absl::Status TraceRayBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                           Strategy strategy, std::span<const TraceRay> rays, std::span<Hit> hits,
                           QueryStats* stats) {
  SIGHTLINE_CHECK_LE(rays.size(), hits.size());
  if (rays.empty()) return absl::OkStatus();
  strategy = Choose(strategy, /*common_origin=*/false, static_cast<int>(rays.size()));
  StatsScope scope(stats, strategy, rays.size());
  const Kernels& kernels = run.kernels();
  const bool brute = strategy == Strategy::kBruteForce;
  const TraceRaysFn trace = kind == HitKind::kAny
                                ? (brute ? kernels.occluded_brute : kernels.occluded_single)
                                : (brute ? kernels.closest_brute : kernels.closest_single);
  return trace(scene, rays, hits, run.cancel(), scope.walk()) ? absl::OkStatus() : run.Stopped();
}

absl::Status TracePacketBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                              Strategy strategy, RayPacket* packet, QueryStats* stats) {
  SIGHTLINE_CHECK_LE(packet->count, kBlockRays);
  if (packet->count == 0) return absl::OkStatus();
  strategy = Choose(strategy, /*common_origin=*/true, packet->count);
  if (strategy == Strategy::kPacket || strategy == Strategy::kShaft) {
    StatsScope scope(stats, strategy, static_cast<uint64_t>(packet->count));
    const Kernels& kernels = run.kernels();
    const bool shaft = strategy == Strategy::kShaft;
    const TracePacketFn trace = kind == HitKind::kAny
                                    ? (shaft ? kernels.occluded_shaft : kernels.occluded_packet)
                                    : (shaft ? kernels.closest_shaft : kernels.closest_packet);
    return trace(scene, *packet, run.cancel(), scope.walk()) ? absl::OkStatus() : run.Stopped();
  }
  std::array<TraceRay, kBlockRays> rays;
  std::array<Hit, kBlockRays> hits;
  for (int i = 0; i < packet->count; ++i) {
    rays[i] = {.ray = packet->ray(i),
               .mask = packet->mask,
               .from_source = packet->origin_source,
               .to_source = packet->segments ? packet->target_source[i] : kNoTriangle};
  }
  SL_RETURN_IF_ERROR(TraceRayBlock(scene, run, kind, strategy,
                                   std::span<const TraceRay>(rays.data(), packet->count), hits,
                                   stats));
  for (int i = 0; i < packet->count; ++i) {
    packet->t[i] = hits[i].t;
    packet->triangle[i] = hits[i].triangle;
    packet->u[i] = packet->v[i] = 0;
    if (packet->want_barycentrics && kind == HitKind::kClosest && hits[i].triangle != kNoTriangle) {
      const auto [a, b, c] = scene.geometry.Corners(hits[i].triangle);
      HitBarycentrics(packet->ray(i), a, b, c, &packet->u[i], &packet->v[i]);
    }
  }
  return absl::OkStatus();
}

absl::Status TraceSampleBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                              const LightSample& sample, std::span<const Vec3f> positions,
                              std::span<const uint32_t> sources, double t_min, std::span<Hit> hits,
                              QueryStats* stats) {
  SIGHTLINE_CHECK(sample.valid);
  SIGHTLINE_CHECK_LE(positions.size(), static_cast<size_t>(kBlockRays));
  const int n = static_cast<int>(positions.size());
  const uint32_t mask = run.options().mask & sample.mask;
  const Vec3d toward = ToDouble(sample.value);
  // Where a segment's point end lies: moved toward the light by t_min, in double, rounded once.
  const auto point_end = [&](Vec3f p) {
    if (t_min == 0) return p;
    const Vec3d d = ToDouble(p);
    return ToFloat(d + (sample.directional ? toward : toward - d) * t_min);
  };
  if (sample.directional) {
    if (kind == HitKind::kAny && run.options().strategy == Strategy::kShaft) {
      ParallelPacket packet;
      packet.direction = sample.value;
      packet.mask = mask;
      packet.direction_source = sample.source_triangle;
      packet.count = n;
      for (int i = 0; i < n; ++i) {
        const Vec3f origin = point_end(positions[i]);
        packet.origin_x[i] = origin.x;
        packet.origin_y[i] = origin.y;
        packet.origin_z[i] = origin.z;
        packet.origin_source[i] = sources[i];
      }
      StatsScope scope(stats, Strategy::kShaft, static_cast<uint64_t>(n));
      if (!run.kernels().occluded_parallel_shaft(scene, packet, run.cancel(), scope.walk())) {
        return run.Stopped();
      }
      for (int i = 0; i < n; ++i) hits[i] = {0.0f, packet.triangle[i]};
      return absl::OkStatus();
    }
    std::array<TraceRay, kBlockRays> rays;
    for (int i = 0; i < n; ++i) {
      rays[i] = {.ray = PredicateRay::Ray(point_end(positions[i]), sample.value),
                 .mask = mask,
                 .from_source = sources[i],
                 .to_source = sample.source_triangle};
    }
    return TraceRayBlock(scene, run, kind, run.options().strategy,
                         std::span<const TraceRay>(rays.data(), n), hits, stats);
  }
  RayPacket packet;
  packet.origin = sample.value;
  packet.segments = true;
  packet.mask = mask;
  packet.origin_source = sample.source_triangle;
  packet.count = n;
  for (int i = 0; i < n; ++i) {
    const Vec3f end = point_end(positions[i]);
    packet.target_x[i] = end.x;
    packet.target_y[i] = end.y;
    packet.target_z[i] = end.z;
    packet.target_source[i] = sources[i];
  }
  SL_RETURN_IF_ERROR(
      TracePacketBlock(scene, run, kind, run.options().strategy, &packet, stats));
  for (int i = 0; i < n; ++i) hits[i] = packet.hit(i);
  return absl::OkStatus();
}

}  // namespace sightline
