// SPDX-License-Identifier: Apache-2.0
//
// How two sides are timed against each other: in one process, by turns.
//
// A pass takes the units of a workload (views, lights, shares of points) in turn, and each unit
// each side in turn, so that no cache stays warm for one of them; the side that begins changes from
// unit to unit and from pass to pass. A repetition is as many passes as bring every side to
// kMinSeconds. Where a single pass would take any side longer than kMaxSeconds, a repetition is a
// share of the units, and the next one goes on where it ended: as many as fit, but at least so many
// that all have their turn within the repetitions. (A unit is never cut: it may take longer.) The
// figure is the median over the repetitions of the ratio of the sides' times: where a repetition is
// a share of the units, a median over shares of the work that differ. Beside it stands the ratio of
// all the times of whole rounds, in which every unit counts alike.
//
// Sides of one thread are timed by that thread's own clock, so that what else runs on a machine
// takes caches and memory from them, but no time.
//
// Thread safety: functions only; nothing else should run on the machine meanwhile.
//
//   const Clock clock = ClockFor(threads);
//   const PeerMode mode = PickMode(*workload, peer, clock);
//   Timings timings = TimeByTurns(units, sides, /*repeats=*/5, progress, clock);
#ifndef SIGHTLINE_TESTS_BENCH_MEASURE_H_
#define SIGHTLINE_TESTS_BENCH_MEASURE_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "tests/bench/embree_peer.h"
#include "tests/bench/workload.h"

namespace sightline::bench {

// Steady seconds since some point in the past.
double Now();
// Seconds that the calling thread has had a core for: what others do with the machine meanwhile is
// not in them.
double ThreadSeconds();

inline constexpr double kMinSeconds = 0.3, kMaxSeconds = 3;
// What --quick asks for instead: one pass, however short, which says nothing of speed.
double MinSeconds(bool quick);

using Clock = std::function<double()>;
// ThreadSeconds where a single thread, the caller's, does all the work; Now for several.
Clock ClockFor(int threads);

// Median (the mean of the middle two of an even number), least and greatest. REQUIRES: not empty.
struct Spread {
  double median = 0, min = 0, max = 0;
};
Spread SpreadOf(std::vector<double> values);

// The fastest of the workload's modes on a sample of the work. Modes are tried by turns, several
// times, and each is judged by its best time. Where the sample pays more than its share for sorting
// and a mode that does not sort won it, that one and the best that does are tried on all of the
// work, likewise, and the faster of the two is it.
PeerMode PickMode(Workload& workload, const EmbreeScene& peer, const Clock& now = Now);

// One of the things that are timed by turns.
struct Side {
  std::function<void(size_t unit)> run;
  // Called after it, outside the timing; may be null.
  std::function<void()> clean_up = nullptr;
};

// What they all do: units, and how much there is to do in each (queries, triangles, frames).
struct Units {
  size_t count = 0;
  std::function<uint64_t(size_t unit)> queries;
  // Units that also get figures of their own, together: the views that they come from. Numbered
  // from 0; null: there are none.
  std::function<size_t(size_t unit)> group = nullptr;
  double min_seconds = kMinSeconds;  // That a repetition brings every side to.
};

struct Timings {
  std::vector<double> queries;               // Per repetition, of each side.
  std::vector<std::vector<double>> seconds;  // By side, then by repetition.
  std::vector<size_t> units;                 // Per repetition: how many each side ran.
  std::vector<double> whole_seconds;         // By side: of the rounds that took every unit.
  std::vector<Timings> groups;               // Each group's share of the above.

  // Queries per second of a side, and how many times side `a` is as fast as side `b`: over the
  // repetitions that had any of these units.
  Spread Rate(size_t side) const;
  Spread Ratio(size_t a, size_t b) const;
  // The latter by the sums of seconds of whole rounds.
  double TotalRatio(size_t a, size_t b) const;
  double UnitsPerRepetition() const;  // On average, of those that had any.
};

// Nothing is warmed up here: what is to be warm must have run before.
Timings TimeByTurns(const Units& units, const std::vector<Side>& sides, size_t repeats,
                    const std::function<void(size_t repetition)>& progress, const Clock& now = Now);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_MEASURE_H_
