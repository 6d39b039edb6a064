// SPDX-License-Identifier: Apache-2.0
#include "core/query/shadows.h"

#include <algorithm>
#include <array>
#include <limits>

#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/query/ray_block.h"

namespace sightline {
namespace {

absl::Status CheckArguments(const PointRange& points, std::span<const LightSample> samples,
                            std::span<const double> weights, const ShadowOptions& shadow,
                            const ShadowOutputs& outputs) {
  const size_t n = points.positions.size();
  if (points.sources.size() != n || points.valid.size() != n) {
    return absl::InvalidArgumentError(absl::StrCat("a point range holds ", n, " positions, ",
                                                   points.sources.size(), " sources and ",
                                                   points.valid.size(), " validity flags"));
  }
  if (outputs.weighted_sums && weights.size() != samples.size()) {
    return absl::InvalidArgumentError(absl::StrCat("weighted sums over ", samples.size(),
                                                   " light samples need as many weights, not ",
                                                   weights.size()));
  }
  if (!(shadow.t_min >= 0 && shadow.t_min < 1)) {
    return absl::InvalidArgumentError(absl::StrCat("t_min = ", shadow.t_min, " is outside [0, 1)"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ComputeShadows(const IndexedGeometry& scene, const PointRange& points,
                            std::span<const LightSample> samples, std::span<const double> weights,
                            const ShadowOptions& shadow, const ShadowOutputs& outputs,
                            const QueryOptions& options, ShadowResult* result) {
  const ScopedFloatEnvironment environment;
  SL_RETURN_IF_ERROR(CheckArguments(points, samples, weights, shadow, outputs));
  const QueryRun run(options);
  const size_t n = points.positions.size(), row_bytes = (n + 7) / 8;
  ShadowResult out;
  if (outputs.bits) out.lit_bits.assign(samples.size() * row_bytes, 0);
  if (outputs.counts) out.lit_counts.assign(n, 0);
  if (outputs.weighted_sums) out.weighted_sums.assign(n, 0.0);
  if (outputs.blockers) {
    out.blocker.assign(samples.size() * n, kNoTriangle);
    out.blocker_t.assign(samples.size() * n, std::numeric_limits<float>::infinity());
  }
  const HitKind kind = outputs.blockers ? HitKind::kClosest : HitKind::kAny;

  std::array<Vec3f, kBlockRays> positions;
  std::array<uint32_t, kBlockRays> sources;
  std::array<size_t, kBlockRays> index;
  std::array<Hit, kBlockRays> hits;
  for (size_t next = 0; next < n;) {
    // A block of valid points, put to every sample in turn, so that sums run in sample order.
    size_t count = 0;
    for (; next < n && count < kBlockRays; ++next) {
      if (!points.valid[next]) continue;
      positions[count] = points.positions[next];
      sources[count] = points.sources[next];
      index[count++] = next;
    }
    for (size_t s = 0; s < samples.size(); ++s) {
      if (!samples[s].valid) continue;
      SL_RETURN_IF_ERROR(TraceSampleBlock(
          scene, run, kind, samples[s], std::span<const Vec3f>(positions.data(), count),
          std::span<const uint32_t>(sources.data(), count), shadow.t_min, hits, &out.stats));
      for (size_t i = 0; i < count; ++i) {
        const size_t p = index[i];
        if (hits[i].triangle != kNoTriangle) {
          if (outputs.blockers) {
            out.blocker[s * n + p] = hits[i].triangle;
            out.blocker_t[s * n + p] =
                samples[s].directional ? hits[i].t : std::min(hits[i].t, 1.0f);
          }
          continue;
        }
        if (outputs.bits) out.lit_bits[s * row_bytes + p / 8] |= uint8_t(1u << (p % 8));
        if (outputs.counts) ++out.lit_counts[p];
        if (outputs.weighted_sums) out.weighted_sums[p] += weights[s];
      }
    }
  }
  *result = std::move(out);
  return absl::OkStatus();
}

}  // namespace sightline
