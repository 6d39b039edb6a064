// SPDX-License-Identifier: Apache-2.0
//
// A histogram as HdrHistogram's percentile distribution, the .hgrm text that its plotters read:
// value in milliseconds, percentile as a share, how many values up to there, 1/(1 - percentile).
// Percentiles come in five steps for each halving of the distance to 1, as HdrHistogram has them.
//
// Thread safety: free functions.
//
//   WriteFile("run.hgrm", FormatHgrm(histogram));
#ifndef SIGHTLINE_CLIENT_LOAD_HGRM_H_
#define SIGHTLINE_CLIENT_LOAD_HGRM_H_

#include <string>
#include <vector>

#include "absl/time/time.h"
#include "client/load/histogram.h"

namespace sightline::load {

struct PercentilePoint {
  double percent = 0;  // 0 to 100; the last point is 100.
  absl::Duration latency;
};

// The rows of the distribution, each value once; empty for an empty histogram.
std::vector<PercentilePoint> PercentileDistribution(const LatencyHistogram& histogram);

std::string FormatHgrm(const LatencyHistogram& histogram);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_HGRM_H_
