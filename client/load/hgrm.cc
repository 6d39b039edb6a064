// SPDX-License-Identifier: Apache-2.0
#include "client/load/hgrm.h"

#include <bit>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace sightline::load {
namespace {

constexpr int kTicksPerHalfDistance = 5;
// Finer than 1 in 2^20 the histogram's percentiles are not asked for.
constexpr int kMostHalvings = 20;

double Milliseconds(absl::Duration duration) { return absl::ToDoubleMilliseconds(duration); }

}  // namespace

std::vector<PercentilePoint> PercentileDistribution(const LatencyHistogram& histogram) {
  std::vector<PercentilePoint> points;
  if (histogram.count() == 0) return points;
  double percent = 0;
  for (int half = 0; half < kMostHalvings; ++half) {
    const double tick = 100.0 / std::exp2(half + 1) / kTicksPerHalfDistance;
    for (int i = 0; i < kTicksPerHalfDistance; ++i) {
      const absl::Duration latency = histogram.PercentileOf(percent);
      if (latency >= histogram.max()) {
        points.push_back({100, histogram.max()});
        return points;
      }
      if (points.empty() || latency > points.back().latency) points.push_back({percent, latency});
      percent += tick;
    }
  }
  points.push_back({100, histogram.max()});
  return points;
}

std::string FormatHgrm(const LatencyHistogram& histogram) {
  std::string text = absl::StrFormat("%12s %14s %10s %14s\n\n", "Value", "Percentile", "TotalCount",
                                     "1/(1-Percentile)");
  for (const PercentilePoint& point : PercentileDistribution(histogram)) {
    const double share = point.percent / 100;
    absl::StrAppend(&text, absl::StrFormat("%12.3f %2.12f %10d", Milliseconds(point.latency), share,
                                           histogram.CountUpTo(point.latency)));
    absl::StrAppend(&text, share < 1 ? absl::StrFormat(" %14.2f\n", 1 / (1 - share)) : "\n");
  }
  absl::StrAppend(
      &text,
      absl::StrFormat("#[Mean    = %12.3f, StdDeviation   = %12.3f]\n",
                      Milliseconds(histogram.mean()), Milliseconds(histogram.standard_deviation())),
      absl::StrFormat("#[Max     = %12.3f, Total count    = %12d]\n", Milliseconds(histogram.max()),
                      histogram.count()),
      absl::StrFormat("#[Buckets = %12d, SubBuckets     = %12d]\n",
                      LatencyHistogram::kLargestBits - LatencyHistogram::kStepBits,
                      2 << LatencyHistogram::kStepBits));
  return text;
}

}  // namespace sightline::load
