// SPDX-License-Identifier: Apache-2.0
//
// A histogram of latencies in nanoseconds, log-linear: 128 equal steps for each power of two, so
// that a percentile is never more than 1/128 (0.8 %) above the value that was recorded, at any
// scale, in 37 KB at most (20 KB where nothing takes longer than 67 ms). Below 256 ns every value
// has a step of its own.
//
// Invariants
//  1. min <= any percentile <= max; min, max, count and mean are exact.
//  2. PercentileOf(p) is the least step at or below which at least p percent of the values lie: the
//     end of the step, but never more than max.
//  3. Merging gives what recording all values in one histogram would have given.
//
// After Gil Tene's HdrHistogram, whose text layout FormatHgrm (hgrm.h) writes.
//
// Thread safety: none; one writer, or a lock around it.
//
//   LatencyHistogram histogram;
//   histogram.Record(absl::Milliseconds(3));
//   absl::Duration p99 = histogram.PercentileOf(99);
#ifndef SIGHTLINE_CLIENT_LOAD_HISTOGRAM_H_
#define SIGHTLINE_CLIENT_LOAD_HISTOGRAM_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/time/time.h"

namespace sightline::load {

class LatencyHistogram {
 public:
  // Of steps per power of two; the relative error of a percentile.
  static constexpr int kStepBits = 7;
  static constexpr double kRelativeError = 1.0 / (1 << kStepBits);
  // Values from here on (73 minutes) share the last step; max stays exact.
  static constexpr int kLargestBits = 42;

  // Less than zero counts as zero: two clocks never disagree by much.
  void Record(absl::Duration latency, uint64_t times = 1);
  void Merge(const LatencyHistogram& other);

  uint64_t count() const { return count_; }
  // Zero while nothing is recorded.
  absl::Duration min() const { return absl::Nanoseconds(count_ == 0 ? 0 : min_); }
  absl::Duration max() const { return absl::Nanoseconds(max_); }
  absl::Duration mean() const;
  // Of the values as their steps have them (the middle of each).
  absl::Duration standard_deviation() const;
  // REQUIRES: 0 <= percent <= 100, taken to 1/10000 of a percent.
  absl::Duration PercentileOf(double percent) const;
  // How many values lie in steps that end at or below `latency`.
  uint64_t CountUpTo(absl::Duration latency) const;

 private:
  static size_t StepOf(int64_t nanoseconds);
  static int64_t StepBegin(size_t step);

  std::vector<uint64_t> counts_;  // By step, as far as any value was; whole powers of two.
  uint64_t count_ = 0;
  double sum_ = 0;
  int64_t min_ = 0, max_ = 0;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_HISTOGRAM_H_
