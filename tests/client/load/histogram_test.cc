// SPDX-License-Identifier: Apache-2.0
#include "client/load/histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::load {
namespace {

using testing_support::ScaledCount;
using testing_support::TestRng;

absl::Duration Ns(int64_t value) { return absl::Nanoseconds(value); }

// The definition: the least value at or below which at least `percent` of them lie.
int64_t ExactPercentile(const std::vector<int64_t>& sorted, double percent) {
  const double wanted = std::ceil(percent * static_cast<double>(sorted.size()) / 100 - 1e-9);
  const auto rank = static_cast<size_t>(std::max(1.0, wanted));
  return sorted[rank - 1];
}

TEST(HistogramTest, AnEmptyOneIsZeroEverywhere) {
  const LatencyHistogram histogram;
  EXPECT_EQ(histogram.count(), 0u);
  EXPECT_EQ(histogram.PercentileOf(99.99), absl::ZeroDuration());
  EXPECT_EQ(histogram.min(), absl::ZeroDuration());
  EXPECT_EQ(histogram.max(), absl::ZeroDuration());
  EXPECT_EQ(histogram.mean(), absl::ZeroDuration());
  EXPECT_EQ(histogram.standard_deviation(), absl::ZeroDuration());
  EXPECT_EQ(histogram.CountUpTo(absl::Hours(1)), 0u);
}

TEST(HistogramTest, SmallValuesAreExact) {
  LatencyHistogram histogram;
  for (int i = 0; i < 250; ++i) histogram.Record(Ns(i));
  for (int i = 1; i <= 250; ++i) {
    EXPECT_EQ(histogram.PercentileOf(0.4 * i), Ns(i - 1)) << i;
  }
  EXPECT_EQ(histogram.mean(), absl::Nanoseconds(124.5));
}

TEST(HistogramTest, PercentilesAreWithinTheBoundAtEveryScale) {
  TestRng rng;
  std::vector<int64_t> values;
  LatencyHistogram histogram;
  for (int64_t i = 0; i < ScaledCount(100'000); ++i) {
    const auto value = static_cast<int64_t>(std::exp(rng.Uniform(0, std::log(4e12))));
    values.push_back(value);
    histogram.Record(Ns(value));
  }
  std::sort(values.begin(), values.end());
  for (const double percent : {0.0, 0.01, 1.0, 25.0, 50.0, 90.0, 99.0, 99.9, 99.99, 100.0}) {
    const auto exact = static_cast<double>(ExactPercentile(values, percent));
    const auto given =
        static_cast<double>(absl::ToInt64Nanoseconds(histogram.PercentileOf(percent)));
    EXPECT_GE(given, exact) << percent;
    EXPECT_LE(given, exact * (1 + LatencyHistogram::kRelativeError)) << percent;
  }
  EXPECT_EQ(histogram.min(), Ns(values.front()));
  EXPECT_EQ(histogram.max(), Ns(values.back()));
}

TEST(HistogramTest, StepsMeetWithoutGapOrOverlap) {
  // A value at each power of two and its neighbours is found where it was put.
  for (int bits = 1; bits < LatencyHistogram::kLargestBits; ++bits) {
    for (const int64_t value : {(int64_t{1} << bits) - 1, int64_t{1} << bits}) {
      LatencyHistogram histogram;
      histogram.Record(Ns(value));
      histogram.Record(Ns(value) * 4);
      EXPECT_EQ(histogram.CountUpTo(Ns(value) * 2), 1u) << value;
      EXPECT_GE(histogram.PercentileOf(50), Ns(value));
      EXPECT_LE(histogram.PercentileOf(50), Ns(value) * (1 + LatencyHistogram::kRelativeError))
          << value;
    }
  }
}

TEST(HistogramTest, NoPercentileAsksForOneValueMoreThanItsShare) {
  // 99.9 / 100 * 1000 is a hair above 999 in doubles.
  LatencyHistogram histogram;
  histogram.Record(Ns(1), 999);
  histogram.Record(absl::Seconds(1));
  EXPECT_EQ(histogram.PercentileOf(99.9), Ns(1));
  EXPECT_EQ(histogram.PercentileOf(99.91), absl::Seconds(1));
}

TEST(HistogramTest, MergingIsRecordingAllInOne) {
  TestRng rng;
  LatencyHistogram parts[3], whole;
  for (int i = 0; i < 3000; ++i) {
    // Of a microsecond, a millisecond and a second: histograms of different lengths.
    const size_t part = rng.Below(3);
    const absl::Duration value = Ns(static_cast<int64_t>(rng.Below(uint64_t{1000} << 10 * part)));
    parts[part].Record(value);
    whole.Record(value);
  }
  for (const std::array<size_t, 3>& order : {std::array<size_t, 3>{0, 1, 2}, {2, 1, 0}}) {
    LatencyHistogram merged;
    merged.Merge(LatencyHistogram());
    for (const size_t part : order) merged.Merge(parts[part]);
    EXPECT_EQ(merged.count(), whole.count());
    EXPECT_EQ(merged.min(), whole.min());
    EXPECT_EQ(merged.max(), whole.max());
    EXPECT_EQ(merged.mean(), whole.mean());
    for (double percent = 0; percent <= 100; percent += 0.37) {
      EXPECT_EQ(merged.PercentileOf(percent), whole.PercentileOf(percent)) << percent;
    }
  }
}

TEST(HistogramTest, ExtremesKeepTheirPlace) {
  LatencyHistogram histogram;
  histogram.Record(absl::Seconds(-1));
  histogram.Record(absl::Hours(1000));
  EXPECT_EQ(histogram.min(), absl::ZeroDuration());
  EXPECT_EQ(histogram.max(), absl::Hours(1000));
  EXPECT_EQ(histogram.PercentileOf(50), absl::ZeroDuration());
  EXPECT_EQ(histogram.PercentileOf(100), absl::Hours(1000));
}

TEST(HistogramTest, DeviationIsThatOfTheValues) {
  LatencyHistogram histogram;
  histogram.Record(absl::Milliseconds(10), 50);
  histogram.Record(absl::Milliseconds(30), 50);
  EXPECT_EQ(histogram.mean(), absl::Milliseconds(20));
  EXPECT_NEAR(absl::ToDoubleMilliseconds(histogram.standard_deviation()), 10, 0.1);
}

}  // namespace
}  // namespace sightline::load
