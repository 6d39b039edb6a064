// SPDX-License-Identifier: Apache-2.0
//
// When a run has settled: its last three windows agree within a tolerance, in their rate of answers
// and in their median latency from the planned time (the rule of NVIDIA's perf_analyzer). A server
// that falls behind never settles: its latencies grow from window to window.
//
// Thread safety: free functions.
//
//   if (JudgeStability(measured.windows, 0.10).stable) driver.Stop();
#ifndef SIGHTLINE_CLIENT_LOAD_STABILITY_H_
#define SIGHTLINE_CLIENT_LOAD_STABILITY_H_

#include <cstddef>
#include <span>

#include "client/load/measurement.h"

namespace sightline::load {

inline constexpr size_t kStableWindows = 3;

struct Stability {
  bool stable = false;
  // By how much the largest of the last three exceeds the smallest; 0.04 is 4 %. Infinite with
  // fewer windows, or where one has no answer.
  double rate_spread = 0, latency_spread = 0;
};

// REQUIRES: tolerance > 0.
Stability JudgeStability(std::span<const Window> windows, double tolerance);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_STABILITY_H_
