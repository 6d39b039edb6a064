// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/measure.h"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <limits>
#include <numeric>
#include <utility>

#include "core/base/check.h"

namespace sightline::bench {
namespace {

// A mode's trial is repeated, since a sample lasts milliseconds, but no trial begins after this.
constexpr int kMostTrials = 5;
constexpr double kTrialSeconds = 10;

void Begin(size_t sides, size_t repeats, Timings* timings) {
  timings->queries.assign(repeats, 0.0);
  timings->seconds.assign(sides, std::vector<double>(repeats, 0.0));
  timings->units.assign(repeats, 0);
  timings->whole_seconds.assign(sides, 0.0);
}

// Adds a round's seconds to those of whole rounds.
void EndRound(std::vector<double>* round, Timings* timings) {
  for (size_t side = 0; side < round->size(); ++side) {
    timings->whole_seconds[side] += std::exchange((*round)[side], 0.0);
  }
}

// Of each mode the best of several trials over all units.
std::vector<double> BestSeconds(Workload& workload, const EmbreeScene& peer,
                                const std::vector<PeerMode>& modes, Share share, const Clock& now) {
  std::vector<double> best(modes.size(), std::numeric_limits<double>::infinity());
  const double start = now();
  for (int trial = 0; trial < kMostTrials; ++trial) {
    for (size_t m = 0; m < modes.size(); ++m) {
      const double begin = now();
      for (size_t unit = 0; unit < workload.units(); ++unit) {
        workload.RunPeer(peer, modes[m], unit, share);
      }
      best[m] = std::min(best[m], now() - begin);
    }
    if (now() - start > kTrialSeconds) break;
  }
  return best;
}

}  // namespace

double ThreadSeconds() {
  timespec spent;
  SIGHTLINE_CHECK_EQ(clock_gettime(CLOCK_THREAD_CPUTIME_ID, &spent), 0);
  return static_cast<double>(spent.tv_sec) + 1e-9 * static_cast<double>(spent.tv_nsec);
}

double MinSeconds(bool quick) { return quick ? 0 : kMinSeconds; }

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
  const std::vector<double> sampled = BestSeconds(workload, peer, modes, Share::kSample, now);
  const auto best_of = [&](bool sorted) {
    size_t best = modes.size();  // None.
    for (size_t m = 0; m < modes.size(); ++m) {
      if (modes[m].sorted != sorted) continue;
      if (best == modes.size() || sampled[m] < sampled[best]) best = m;
    }
    return best;
  };
  const size_t as_they_come = best_of(false), sorted = best_of(true);
  if (sorted == modes.size()) return modes[as_they_come];
  if (as_they_come == modes.size() || sampled[sorted] < sampled[as_they_come]) return modes[sorted];
  if (!workload.sample_overpays_sorting()) return modes[as_they_come];
  const std::vector<PeerMode> last = {modes[as_they_come], modes[sorted]};
  const std::vector<double> whole = BestSeconds(workload, peer, last, Share::kAll, now);
  return last[whole[1] < whole[0] ? 1 : 0];
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

double Timings::TotalRatio(size_t a, size_t b) const { return whole_seconds[b] / whole_seconds[a]; }

double Timings::UnitsPerRepetition() const {
  const auto idle = std::count(units.begin(), units.end(), size_t{0});
  return static_cast<double>(std::accumulate(units.begin(), units.end(), size_t{0})) /
         static_cast<double>(std::ssize(units) - idle);
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
  // Of the round under way, by side: what it never comes to the end of is in no total.
  std::vector<double> round(sides.size(), 0.0);
  std::vector<std::vector<double>> group_rounds(groups, round);
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
        round[side] += spent;
        if (group != nullptr) {
          group->seconds[side][repetition] += spent;
          group_rounds[units.group(unit)][side] += spent;
        }
        if (sides[side].clean_up != nullptr) sides[side].clean_up();
      }
      const auto queries = static_cast<double>(units.queries(unit));
      timings.queries[repetition] += queries;
      ++timings.units[repetition];
      if (group != nullptr) {
        group->queries[repetition] += queries;
        ++group->units[repetition];
      }
      if (++unit == units.count) {
        unit = 0;
        ++pass;
        EndRound(&round, &timings);
        for (size_t g = 0; g < groups; ++g) EndRound(&group_rounds[g], &timings.groups[g]);
      }
      const bool whole = done % units.count == 0;
      if (whole && !any([&](double spent) { return spent < units.min_seconds; })) break;
      if (done >= least && done < units.count &&
          any([](double spent) { return spent >= kMaxSeconds; })) {
        break;
      }
    }
  }
  return timings;
}

}  // namespace sightline::bench
