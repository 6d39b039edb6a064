// SPDX-License-Identifier: Apache-2.0
#include "client/load/histogram.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/base/check.h"

namespace sightline::load {
namespace {

constexpr int64_t kSteps = int64_t{1} << LatencyHistogram::kStepBits;
constexpr int kLinearBits = LatencyHistogram::kStepBits + 1;  // Below 2 * kSteps: one step each.
constexpr size_t kStepCount =
    static_cast<size_t>(2 * kSteps + kSteps * (LatencyHistogram::kLargestBits - kLinearBits));

}  // namespace

size_t LatencyHistogram::StepOf(int64_t nanoseconds) {
  const auto value =
      static_cast<uint64_t>(std::clamp<int64_t>(nanoseconds, 0, (int64_t{1} << kLargestBits) - 1));
  const int shift = std::max(0, static_cast<int>(std::bit_width(value)) - kLinearBits);
  // The leading bit and the kStepBits behind it: kSteps .. 2 * kSteps - 1 where anything is cut.
  return static_cast<size_t>(shift) * kSteps + static_cast<size_t>(value >> shift);
}

int64_t LatencyHistogram::StepBegin(size_t step) {
  if (step < 2 * kSteps) return static_cast<int64_t>(step);
  const size_t shift = step / kSteps - 1;
  return static_cast<int64_t>(step % kSteps + kSteps) << shift;
}

void LatencyHistogram::Record(absl::Duration latency, uint64_t times) {
  if (times == 0) return;
  const int64_t value = std::max<int64_t>(0, absl::ToInt64Nanoseconds(latency));
  const size_t step = StepOf(value);
  if (step >= counts_.size()) counts_.resize((step / kSteps + 1) * kSteps);
  counts_[step] += times;
  min_ = count_ == 0 ? value : std::min(min_, value);
  max_ = std::max(max_, value);
  count_ += times;
  sum_ += static_cast<double>(value) * static_cast<double>(times);
}

void LatencyHistogram::Merge(const LatencyHistogram& other) {
  if (other.count_ == 0) return;
  if (counts_.size() < other.counts_.size()) counts_.resize(other.counts_.size());
  for (size_t i = 0; i < other.counts_.size(); ++i) counts_[i] += other.counts_[i];
  min_ = count_ == 0 ? other.min_ : std::min(min_, other.min_);
  max_ = std::max(max_, other.max_);
  count_ += other.count_;
  sum_ += other.sum_;
}

absl::Duration LatencyHistogram::mean() const {
  return count_ == 0 ? absl::ZeroDuration() : absl::Nanoseconds(sum_ / static_cast<double>(count_));
}

absl::Duration LatencyHistogram::standard_deviation() const {
  if (count_ == 0) return absl::ZeroDuration();
  const double mean = sum_ / static_cast<double>(count_);
  double squares = 0;
  for (size_t i = 0; i < counts_.size(); ++i) {
    if (counts_[i] == 0) continue;
    const auto begin = static_cast<double>(StepBegin(i));
    const double middle = (begin + static_cast<double>(StepBegin(i + 1)) - 1) / 2;
    squares += static_cast<double>(counts_[i]) * (middle - mean) * (middle - mean);
  }
  return absl::Nanoseconds(std::sqrt(squares / static_cast<double>(count_)));
}

absl::Duration LatencyHistogram::PercentileOf(double percent) const {
  SIGHTLINE_CHECK(percent >= 0 && percent <= 100) << "percentile " << percent;
  if (count_ == 0) return absl::ZeroDuration();
  // In millionths, so that no rounding of 99.9 / 100 asks for one value more.
  constexpr uint64_t kWhole = 1'000'000;
  const auto share = static_cast<uint64_t>(std::llround(percent * (kWhole / 100)));
  const uint64_t rank = std::max<uint64_t>(
      1, count_ / kWhole * share + (count_ % kWhole * share + kWhole - 1) / kWhole);
  uint64_t below = 0;
  for (size_t i = 0; i < counts_.size(); ++i) {
    below += counts_[i];
    if (below >= rank) {
      // Values beyond the last step are known by their largest alone.
      const int64_t end = i + 1 == kStepCount ? max_ : StepBegin(i + 1) - 1;
      return absl::Nanoseconds(std::clamp(end, min_, max_));
    }
  }
  return max();
}

uint64_t LatencyHistogram::CountUpTo(absl::Duration latency) const {
  if (count_ == 0) return 0;
  if (latency >= max()) return count_;
  const int64_t limit = absl::ToInt64Nanoseconds(latency);
  uint64_t below = 0;
  // Values in the last step may be any number.
  const size_t steps = std::min(counts_.size(), kStepCount - 1);
  for (size_t i = 0; i < steps && StepBegin(i + 1) - 1 <= limit; ++i) below += counts_[i];
  return below;
}

}  // namespace sightline::load
