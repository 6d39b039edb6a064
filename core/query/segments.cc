// SPDX-License-Identifier: Apache-2.0
#include "core/query/segments.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/mesh/rebase.h"
#include "core/query/ray_block.h"

namespace sightline {
namespace {

absl::Status CheckSources(const char* name, std::span<const uint32_t> sources, size_t segments,
                          size_t triangles) {
  if (sources.empty()) return absl::OkStatus();
  if (sources.size() != segments) {
    return absl::InvalidArgumentError(absl::StrCat(name, " holds ", sources.size(),
                                                   " triangles for ", segments,
                                                   " segments; give none or one each"));
  }
  for (size_t i = 0; i < sources.size(); ++i) {
    if (sources[i] != kNoTriangle && sources[i] >= triangles) {
      return absl::InvalidArgumentError(absl::StrCat(
          name, "[", i, "] = ", sources[i], ", but the scene has ", triangles, " triangles"));
    }
  }
  return absl::OkStatus();
}

void SetSources(std::span<const uint32_t> sources, size_t n, std::vector<uint32_t>* out) {
  if (sources.empty()) {
    out->assign(n, kNoTriangle);
  } else {
    out->assign(sources.begin(), sources.end());
  }
}

// `store(end, &stored)` tells whether the end is one, and what is stored of it. Not inlined, as
// Test: float_environment.h says why.
template <typename End, typename Store>
ABSL_ATTRIBUTE_NOINLINE absl::Status Prepare(const IndexedGeometry& scene,
                                             std::span<const std::array<End, 2>> ends,
                                             std::span<const uint32_t> from_sources,
                                             std::span<const uint32_t> to_sources,
                                             const Store& store, PreparedSegments* segments) {
  const size_t n = ends.size(), triangles = scene.geometry.triangles.size();
  SL_RETURN_IF_ERROR(CheckSources("from_sources", from_sources, n, triangles));
  SL_RETURN_IF_ERROR(CheckSources("to_sources", to_sources, n, triangles));
  SetSources(from_sources, n, &segments->from_source);
  SetSources(to_sources, n, &segments->to_source);
  segments->from.resize(n);
  segments->to.resize(n);
  segments->valid.resize(n);
  segments->invalid = 0;
  for (size_t i = 0; i < n; ++i) {
    Vec3f from, to;
    // Both, always: storing one is as fast as a branch over it.
    const bool from_valid = store(ends[i][0], &from), to_valid = store(ends[i][1], &to);
    const bool valid = from_valid && to_valid;
    if (!valid) {
      from = to = {};
      ++segments->invalid;
    }
    segments->from[i] = from;
    segments->to[i] = to;
    segments->valid[i] = valid;
  }
  return absl::OkStatus();
}

// Bit first + i of `bits`, which is 0 before, for hit i. Without a branch that depends on a hit:
// whether there is one cannot be foretold.
void PutBits(std::span<const Hit> hits, size_t first, uint8_t* bits) {
  for (size_t i = 0; i < hits.size();) {
    const size_t at = (first + i) % 8, count = std::min(8 - at, hits.size() - i);
    uint32_t byte = 0;
    for (size_t k = 0; k < count; ++k) {
      byte |= static_cast<uint32_t>(hits[i + k].triangle != kNoTriangle) << (at + k);
    }
    bits[(first + i) / 8] |= static_cast<uint8_t>(byte);
    i += count;
  }
}

ABSL_ATTRIBUTE_NOINLINE
absl::Status Test(const IndexedGeometry& scene, const PreparedSegments& segments,
                  const SegmentOutputs& outputs, const QueryOptions& options,
                  SegmentResult* result) {
  SegmentResult out = std::exchange(*result, {});  // Its memory serves again.
  SL_RETURN_IF_ERROR(CheckOptions(scene, options));
  const QueryRun run(scene, options);
  const size_t n = segments.size();
  out.blocked_bits.assign(outputs.bits ? (n + 7) / 8 : 0, 0);
  out.triangle.assign(outputs.first_hits ? n : 0, kNoTriangle);
  out.t.assign(outputs.first_hits ? n : 0, std::numeric_limits<float>::infinity());
  out.stats = {};
  const HitKind kind = outputs.first_hits ? HitKind::kClosest : HitKind::kAny;
  std::array<TraceRay, kBlockRays> rays;
  std::array<Hit, kBlockRays> hits;
  std::array<size_t, kBlockRays> index;
  const Strategy strategy = ChooseStrategy(run, RayForm::kFree, kind, n);
  for (size_t next = 0; next < n;) {
    const size_t first = next;
    size_t count = 0;
    for (; next < n && count < kBlockRays; ++next) {
      if (!segments.valid[next]) continue;
      rays[count] = {.ray = PredicateRay::Segment(segments.from[next], segments.to[next]),
                     .mask = options.mask,
                     .from_source = segments.from_source[next],
                     .to_source = segments.to_source[next]};
      index[count++] = next;
    }
    const bool dense = next - first == count;  // All of them valid.
    StatsScope scope(&out.stats, strategy, count);
    SL_RETURN_IF_ERROR(TraceRayBlock(scene, run, kind, strategy,
                                     std::span<const TraceRay>(rays.data(), count), hits,
                                     scope.walk()));
    // Free rays share nothing.
    if (options.count_answers) {
      out.stats.answered_by[static_cast<size_t>(AnsweredBy::kRay)] += count;
    }
    if (outputs.bits) {
      const std::span<const Hit> found(hits.data(), count);
      if (dense) {
        PutBits(found, first, out.blocked_bits.data());
      } else {
        for (size_t i = 0; i < count; ++i)
          PutBits(found.subspan(i, 1), index[i], out.blocked_bits.data());
      }
    }
    for (size_t i = 0; i < count && outputs.first_hits; ++i) {
      if (hits[i].triangle == kNoTriangle) continue;
      out.triangle[index[i]] = hits[i].triangle;
      out.t[index[i]] =
          std::min(hits[i].t, 1.0f);  // Rounding may have left it just beyond the end.
    }
  }
  *result = std::move(out);
  return absl::OkStatus();
}

}  // namespace

absl::Status PrepareSegments(const IndexedGeometry& scene,
                             std::span<const std::array<Vec3d, 2>> ends,
                             std::span<const uint32_t> from_sources,
                             std::span<const uint32_t> to_sources, PreparedSegments* segments) {
  const ScopedFloatEnvironment environment;
  const Vec3d origin = scene.geometry.origin;
  return Prepare(
      scene, ends, from_sources, to_sources,
      [origin](Vec3d end, Vec3f* stored) { return Rebase(end, origin, stored); }, segments);
}

absl::Status PrepareStoredSegments(const IndexedGeometry& scene,
                                   std::span<const std::array<Vec3f, 2>> ends,
                                   std::span<const uint32_t> from_sources,
                                   std::span<const uint32_t> to_sources,
                                   PreparedSegments* segments) {
  const ScopedFloatEnvironment environment;
  return Prepare(
      scene, ends, from_sources, to_sources,
      [](Vec3f end, Vec3f* stored) {
        *stored = WithoutNegativeZero(end);
        return IsInRange(end);
      },
      segments);
}

absl::Status TestSegments(const IndexedGeometry& scene, const PreparedSegments& segments,
                          const SegmentOutputs& outputs, const QueryOptions& options,
                          SegmentResult* result) {
  const ScopedFloatEnvironment environment;
  return Test(scene, segments, outputs, options, result);
}

}  // namespace sightline
