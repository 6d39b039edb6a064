// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/measure.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include "core/base/check.h"

namespace sightline::bench {
namespace {

// A mode's trial is repeated, since a sample lasts milliseconds, but not for longer than this.
constexpr int kMostTrials = 5;
constexpr double kTrialSeconds = 10;

}  // namespace

double Now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

Spread SpreadOf(std::vector<double> values) {
  SIGHTLINE_CHECK(!values.empty());
  std::sort(values.begin(), values.end());
  const size_t n = values.size();
  return {.median = (values[(n - 1) / 2] + values[n / 2]) / 2,
          .min = values.front(),
          .max = values.back()};
}

PeerMode PickMode(Workload& workload, const EmbreeScene& peer) {
  const std::vector<PeerMode> modes = workload.peer_modes();
  std::vector<double> best(modes.size(), std::numeric_limits<double>::infinity());
  const double start = Now();
  for (int trial = 0; trial < kMostTrials; ++trial) {
    for (size_t m = 0; m < modes.size(); ++m) {
      const double begin = Now();
      for (size_t unit = 0; unit < workload.units(); ++unit) {
        workload.RunPeer(peer, modes[m], unit, Share::kSample);
      }
      best[m] = std::min(best[m], Now() - begin);
    }
    if (Now() - start > kTrialSeconds) break;
  }
  return modes[static_cast<size_t>(std::min_element(best.begin(), best.end()) - best.begin())];
}

Spread Timings::Rate(size_t side) const {
  std::vector<double> rates;
  for (size_t r = 0; r < queries.size(); ++r) rates.push_back(queries[r] / seconds[side][r]);
  return SpreadOf(std::move(rates));
}

Spread Timings::Ratio(size_t a, size_t b) const {
  std::vector<double> ratios;
  for (size_t r = 0; r < queries.size(); ++r) ratios.push_back(seconds[b][r] / seconds[a][r]);
  return SpreadOf(std::move(ratios));
}

Timings TimeByTurns(const Units& units, const std::vector<Side>& sides, size_t repeats,
                    const std::function<void(size_t repetition)>& progress) {
  Timings timings;
  timings.seconds.resize(sides.size());
  size_t pass = 0;
  for (size_t repetition = 0; repetition < repeats; ++repetition) {
    progress(repetition);
    std::vector<double> spent(sides.size(), 0.0);
    double queries = 0;
    do {
      for (size_t unit = 0; unit < units.count; ++unit) {
        for (size_t k = 0; k < sides.size(); ++k) {
          const size_t side = (unit + pass + k) % sides.size();
          const double begin = Now();
          sides[side].run(unit);
          spent[side] += Now() - begin;
          if (sides[side].clean_up != nullptr) sides[side].clean_up();
        }
        queries += static_cast<double>(units.queries(unit));
      }
      ++pass;
    } while (*std::min_element(spent.begin(), spent.end()) < kMinSeconds);
    timings.queries.push_back(queries);
    for (size_t side = 0; side < sides.size(); ++side) {
      timings.seconds[side].push_back(spent[side]);
    }
  }
  return timings;
}

}  // namespace sightline::bench
