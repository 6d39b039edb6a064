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
#include "core/light/light.h"
#include "core/query/query_run.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

inline constexpr int kBlockRays = RayPacket::kMaxRays;

enum class HitKind : uint8_t { kAny, kClosest };

// Any rays. With kAny a hit's triangle is some blocker's id; its t is meaningless.
absl::Status TraceRayBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                           Strategy strategy, std::span<const TraceRay> rays, std::span<Hit> hits,
                           QueryStats* stats);

// Up to kBlockRays rays with one origin. packet.origin … target_source are read, packet.hit is
// written; the mask is taken from the packet.
absl::Status TracePacketBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                              Strategy strategy, RayPacket* packet, QueryStats* stats);

// One light sample against up to kBlockRays points, all valid: hits[i] for positions[i]. A sample
// that is a point starts the segments, one that is a direction is what rays from the points run
// toward. REQUIRES: sample.valid.
absl::Status TraceSampleBlock(const IndexedGeometry& scene, const QueryRun& run, HitKind kind,
                              const LightSample& sample, std::span<const Vec3f> positions,
                              std::span<const uint32_t> sources, double t_min, std::span<Hit> hits,
                              QueryStats* stats);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_RAY_BLOCK_H_
