// SPDX-License-Identifier: Apache-2.0
#include "core/query/shadows.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/query/point_bits.h"
#include "core/query/point_order.h"
#include "core/query/ray_block.h"
#include "core/query/sample_tracer.h"

namespace sightline {
namespace {

// What a range of points may hold beside their positions: as much, or nothing.
template <typename T>
bool FitsOrEmpty(std::span<const T> row, const PointRange& points) {
  return row.empty() || row.size() == points.positions.size();
}
template <typename T>
std::span<const T> PartOf(std::span<const T> row, size_t first, size_t count) {
  return row.empty() ? row : row.subspan(first, count);
}

// The flags of `count` points that are all valid, where none were given: of a usual range they
// stay in caches, and `more` holds those of a longer one.
std::span<const uint8_t> AllValid(size_t count, std::vector<uint8_t>* more) {
  static constexpr auto kAllValid = [] {
    std::array<uint8_t, 2 * kGroupRays> flags{};
    flags.fill(1);
    return flags;
  }();
  if (count <= kAllValid.size()) return std::span(kAllValid).first(count);
  more->assign(count, 1);
  return *more;
}

absl::Status CheckArguments(const PointRange& points, std::span<const LightSample> samples,
                            std::span<const double> weights, const ShadowOptions& shadow,
                            const ShadowOutputs& outputs) {
  const size_t n = points.positions.size();
  if (n > kMaxShadowPoints) {
    return absl::InvalidArgumentError(
        absl::StrCat("a range of ", n, " points, of which one call takes up to ", kMaxShadowPoints,
                     ": hand them over in several"));
  }
  if (!FitsOrEmpty(points.sources, points) || !FitsOrEmpty(points.valid, points)) {
    return absl::InvalidArgumentError(absl::StrCat("a point range holds ", n, " positions, ",
                                                   points.sources.size(), " sources and ",
                                                   points.valid.size(), " validity flags"));
  }
  const PointRange& coming = shadow.next;
  if (!FitsOrEmpty(coming.sources, coming) || !FitsOrEmpty(coming.valid, coming)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "the points that come next hold ", coming.positions.size(), " positions, ",
        coming.sources.size(), " sources and ", coming.valid.size(), " validity flags"));
  }
  if (outputs.weighted_sums && weights.size() != samples.size()) {
    return absl::InvalidArgumentError(absl::StrCat("weighted sums over ", samples.size(),
                                                   " light samples need as many weights, not ",
                                                   weights.size()));
  }
  if (shadow.hints != nullptr && !shadow.hints->first_leaves.empty() &&
      (shadow.hints->first_leaves.size() != samples.size() ||
       shadow.hints->covered.size() != samples.size() ||
       shadow.hints->patches.size() != samples.size() ||
       shadow.hints->clear.size() != samples.size())) {
    return absl::InvalidArgumentError(absl::StrCat("hints of ", shadow.hints->first_leaves.size(),
                                                   " light samples for ", samples.size(),
                                                   "; they are good for one set of samples alone"));
  }
  if (!(shadow.t_min >= 0 && shadow.t_min < 1)) {
    return absl::InvalidArgumentError(absl::StrCat("t_min = ", shadow.t_min, " is outside [0, 1)"));
  }
  return absl::OkStatus();
}

// What the points before left behind, where that was of this scene: of another's leaves this one
// has none, or others.
ShadowHints TakeHints(const IndexedGeometry& scene, ShadowHints* hints) {
  const uint64_t bvh = scene.bvh.number.value();
  if (hints == nullptr) return {.bvh = bvh};
  ShadowHints taken = std::exchange(*hints, {});
  if (taken.bvh == bvh) return taken;
  return {.bvh = bvh, .ray_cost = taken.bvh == 0 ? taken.ray_cost : 0};
}

// Has the tracer fetch points from `first` on while it asks about others.
void FetchMeanwhile(const PointRange& points, size_t first, SampleTracer* tracer) {
  const size_t count = points.positions.size() - first;
  tracer->FetchMeanwhile(points.positions.subspan(first), PartOf(points.sources, first, count),
                         PartOf(points.valid, first, count));
}

// Not inlined: float_environment.h says why.
ABSL_ATTRIBUTE_NOINLINE
absl::Status Compute(const IndexedGeometry& scene, const PointRange& points,
                     std::span<const LightSample> samples, std::span<const double> weights,
                     const ShadowOptions& shadow, const ShadowOutputs& outputs,
                     const QueryOptions& options, ShadowResult* result) {
  ShadowResult out = std::exchange(*result, {});  // Its memory serves again.
  SL_RETURN_IF_ERROR(CheckArguments(points, samples, weights, shadow, outputs));
  SL_RETURN_IF_ERROR(CheckOptions(scene, options));
  const QueryRun run(scene, options);
  const size_t n = points.positions.size(), row_bytes = (n + 7) / 8;
  const size_t pairs = samples.size() * n;
  out.lit_bits.assign(outputs.bits ? samples.size() * row_bytes : 0, 0);
  out.lit_counts.assign(outputs.counts ? n : 0, 0);
  out.weighted_sums.assign(outputs.weighted_sums ? n : 0, 0.0);
  out.blocker.assign(outputs.blockers ? pairs : 0, kNoTriangle);
  out.blocker_t.assign(outputs.blockers ? pairs : 0, std::numeric_limits<float>::infinity());
  out.answered_by.assign(outputs.answered_by ? pairs : 0, AnsweredBy::kNoRay);
  out.stats = {};
  const HitKind kind = outputs.blockers ? HitKind::kClosest : HitKind::kAny;

  std::vector<uint8_t> more_flags;
  const std::span<const uint8_t> valid_points =
      points.valid.empty() ? AllValid(n, &more_flags) : points.valid;
  // Points that do not follow one another are gathered here.
  std::vector<Vec3f> positions;
  std::vector<uint32_t> sources;
  std::vector<size_t> index;
  ShadowHints hints = TakeHints(scene, shadow.hints);
  const float known_cost = hints.ray_cost;
  SampleTracer tracer(scene, run, kind, shadow.t_min, samples, &out.stats, std::move(hints));
  if (outputs.answered_by) tracer.RecordAnsweredBy();
  std::optional<OwnOrder> own;
  if (!shadow.ordered) {
    // A few hundred nanoseconds a point where they are shuffled.
    const auto fired = [&] { return options.cancel != nullptr && options.cancel->cancelled(); };
    if (fired()) return options.cancel->ToStatus();
    own = OrderThatPays(points.positions, valid_points, samples.size(), known_cost, options.simd,
                        options.cancel);
    if (fired()) return options.cancel->ToStatus();
  }
  const bool ordered = own.has_value();
  const PartedPoints order = ordered ? std::move(own->points) : PartedPoints();
  const size_t group = tracer.GroupPoints();
  // What comes next is fetched while a group's last walks are under way: fetched earlier, it would
  // be gone again.
  size_t last_sample = samples.size();
  for (size_t s = 0; s < samples.size(); ++s) {
    if (samples[s].valid) last_sample = s;
  }
  const size_t end = ordered ? order.numbers.size() : n;
  for (size_t next = 0; next < end;) {
    // A group of valid points, put to every sample in turn, so that sums run in sample order.
    const size_t first = next;
    size_t count = 0;
    const size_t most = std::min(group, end - first);
    if (ordered) {
      count = most;
      next += count;
    } else {
      const uint8_t* valid = valid_points.data() + first;
      const void* not_valid = std::memchr(valid, 0, most);
      count = not_valid == nullptr ? most : static_cast<const uint8_t*>(not_valid) - valid;
      next += count;
    }
    // Mostly they follow one another and are taken where they are.
    const bool dense = !ordered && count > 0 && (next == end || count == group) && first % 8 == 0;
    if (dense) {
      tracer.SetPoints(points.positions.subspan(first, count),
                       PartOf(points.sources, first, count));
    } else if (ordered) {
      if (!points.sources.empty()) {
        sources.resize(count);
        for (size_t i = 0; i < count; ++i) sources[i] = points.sources[order.numbers[first + i]];
      }
      tracer.SetPoints({order.positions.data() + first, count}, sources);
    } else {
      positions.resize(std::min(group, n));
      if (!points.sources.empty()) sources.resize(positions.size());
      index.resize(positions.size());
      next = first;
      for (count = 0; next < end && count < group; ++next) {
        if (!valid_points[next]) continue;
        positions[count] = points.positions[next];
        if (!points.sources.empty()) sources[count] = points.sources[next];
        index[count++] = next;
      }
      tracer.SetPoints(std::span<const Vec3f>(positions.data(), count),
                       std::span<const uint32_t>(sources.data(), sources.empty() ? 0 : count));
    }
    const auto point = [&](size_t i) {
      return dense ? first + i : ordered ? size_t{order.numbers[first + i]} : index[i];
    };
    for (size_t s = 0; s < samples.size(); ++s) {
      if (!samples[s].valid) continue;
      if (s == last_sample && (!ordered || next == end)) {
        const bool last = next == end;
        FetchMeanwhile(last ? shadow.next : points, last ? 0 : next, &tracer);
      }
      SL_RETURN_IF_ERROR(tracer.Trace(s));
      if (outputs.bits) {
        uint8_t* row = out.lit_bits.data() + s * row_bytes;
        if (dense || ordered) {
          tracer.CopyLit(row + first / 8);  // Groups of points hold whole bytes of them.
        } else {
          uint64_t words[kGroupRays / 64] = {};
          tracer.CopyLit(reinterpret_cast<uint8_t*>(words));
          for (size_t w = 0; 64 * w < count; ++w) {
            for (uint64_t lit = words[w]; lit != 0; lit &= lit - 1) {
              const size_t p = index[64 * w + static_cast<size_t>(std::countr_zero(lit))];
              row[p / 8] |= uint8_t(1u << (p % 8));
            }
          }
        }
      }
      for (size_t i = 0; i < count && outputs.answered_by; ++i) {
        out.answered_by[s * n + point(i)] = tracer.answered_by(i);
      }
      if (!(outputs.counts || outputs.weighted_sums || outputs.blockers)) continue;
      for (size_t i = 0; i < count; ++i) {
        const size_t p = point(i);
        if (tracer.triangle(i) != kNoTriangle) {
          if (outputs.blockers) {
            out.blocker[s * n + p] = tracer.triangle(i);
            out.blocker_t[s * n + p] =
                samples[s].directional ? tracer.t(i) : std::min(tracer.t(i), 1.0f);
          }
          continue;
        }
        if (outputs.counts) ++out.lit_counts[p];
        if (outputs.weighted_sums) out.weighted_sums[p] += weights[s];
      }
    }
  }
  if (ordered && outputs.bits) {
    const PointBits bits = order.ranks.empty() ? PointBits(order.numbers, n, options.cancel)
                                               : PointBits::ByRanks(order.ranks, n);
    if (!bits.PutBack(out.lit_bits, options.cancel)) return options.cancel->ToStatus();
  }
  if (shadow.hints != nullptr) {
    float after = known_cost;
    if (const std::optional<float> took = tracer.RayCost(); took.has_value()) {
      const float cost = *took * (ordered ? own->gain : 1);
      after = known_cost > 0 ? (known_cost + cost) / 2 : cost;
    }
    *shadow.hints = tracer.ReleaseHints();
    shadow.hints->ray_cost = after;
  }
  *result = std::move(out);
  return absl::OkStatus();
}

}  // namespace

absl::Status ComputeShadows(const IndexedGeometry& scene, const PointRange& points,
                            std::span<const LightSample> samples, std::span<const double> weights,
                            const ShadowOptions& shadow, const ShadowOutputs& outputs,
                            const QueryOptions& options, ShadowResult* result) {
  const ScopedFloatEnvironment environment;
  return Compute(scene, points, samples, weights, shadow, outputs, options, result);
}

}  // namespace sightline
