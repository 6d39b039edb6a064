// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/measure.h"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <limits>

#include "core/base/check.h"

namespace sightline::bench {
namespace {

// A mode's trial is repeated, since a sample lasts milliseconds, but not for longer than this.
constexpr int kMostTrials = 5;
constexpr double kTrialSeconds = 10;

void Begin(size_t sides, size_t repeats, Timings* timings) {
  timings->queries.assign(repeats, 0.0);
  timings->seconds.assign(sides, std::vector<double>(repeats, 0.0));
}

}  // namespace

double ThreadSeconds() {
  timespec spent;
  SIGHTLINE_CHECK_EQ(clock_gettime(CLOCK_THREAD_CPUTIME_ID, &spent), 0);
  return static_cast<double>(spent.tv_sec) + 1e-9 * static_cast<double>(spent.tv_nsec);
}

Clock ClockFor(int threads) { return threads == 1 ? ThreadSeconds : Now; }

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

PeerMode PickMode(Workload& workload, const EmbreeScene& peer, const Clock& now) {
  const std::vector<PeerMode> modes = workload.peer_modes();
  std::vector<double> best(modes.size(), std::numeric_limits<double>::infinity());
  const double start = now();
  for (int trial = 0; trial < kMostTrials; ++trial) {
    for (size_t m = 0; m < modes.size(); ++m) {
      const double begin = now();
      for (size_t unit = 0; unit < workload.units(); ++unit) {
        workload.RunPeer(peer, modes[m], unit, Share::kSample);
      }
      best[m] = std::min(best[m], now() - begin);
    }
    if (now() - start > kTrialSeconds) break;
  }
  return modes[static_cast<size_t>(std::min_element(best.begin(), best.end()) - best.begin())];
}

Spread Timings::Rate(size_t side) const {
  std::vector<double> rates;
  for (size_t r = 0; r < queries.size(); ++r) {
    if (queries[r] > 0) rates.push_back(queries[r] / seconds[side][r]);
  }
  return SpreadOf(std::move(rates));
}

Spread Timings::Ratio(size_t a, size_t b) const {
  std::vector<double> ratios;
  for (size_t r = 0; r < queries.size(); ++r) {
    if (queries[r] > 0) ratios.push_back(seconds[b][r] / seconds[a][r]);
  }
  return SpreadOf(std::move(ratios));
}

Timings TimeByTurns(const Units& units, const std::vector<Side>& sides, size_t repeats,
                    const std::function<void(size_t repetition)>& progress, const Clock& now) {
  Timings timings;
  Begin(sides.size(), repeats, &timings);
  size_t groups = 0;
  for (size_t unit = 0; unit < units.count && units.group != nullptr; ++unit) {
    groups = std::max(groups, units.group(unit) + 1);
  }
  timings.groups.resize(groups);
  for (Timings& group : timings.groups) Begin(sides.size(), repeats, &group);
  const size_t least = (units.count + repeats - 1) / repeats;  // Units of a repetition.
  size_t unit = 0, pass = 0;
  for (size_t repetition = 0; repetition < repeats; ++repetition) {
    progress(repetition);
    const auto any = [&](const auto& which) {
      return std::any_of(timings.seconds.begin(), timings.seconds.end(),
                         [&](const std::vector<double>& side) { return which(side[repetition]); });
    };
    for (size_t done = 1;; ++done) {
      Timings* const group = groups == 0 ? nullptr : &timings.groups[units.group(unit)];
      for (size_t k = 0; k < sides.size(); ++k) {
        const size_t side = (unit + pass + k) % sides.size();
        const double begin = now();
        sides[side].run(unit);
        const double spent = now() - begin;
        timings.seconds[side][repetition] += spent;
        if (group != nullptr) group->seconds[side][repetition] += spent;
        if (sides[side].clean_up != nullptr) sides[side].clean_up();
      }
      const auto queries = static_cast<double>(units.queries(unit));
      timings.queries[repetition] += queries;
      if (group != nullptr) group->queries[repetition] += queries;
      if (++unit == units.count) {
        unit = 0;
        ++pass;
      }
      const bool whole = done % units.count == 0;
      if (whole && !any([](double spent) { return spent < kMinSeconds; })) break;
      if (done >= least && done < units.count &&
          any([](double spent) { return spent >= kMaxSeconds; })) {
        break;
      }
    }
  }
  return timings;
}

}  // namespace sightline::bench
