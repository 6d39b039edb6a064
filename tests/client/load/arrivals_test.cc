// SPDX-License-Identifier: Apache-2.0
#include "client/load/arrivals.h"

#include <gtest/gtest.h>

#include <cmath>

namespace sightline::load {
namespace {

TEST(ArrivalsTest, ConstantOnesAreEvenAndDoNotDrift) {
  ArrivalSchedule arrivals(Arrivals::kConstant, 3, 1);
  for (int i = 0; i < 3'000'000; ++i) {
    const absl::Duration due = arrivals.Next();
    if (i % 3 != 0) continue;
    ASSERT_EQ(due, absl::Seconds(i / 3)) << i;
  }
}

TEST(ArrivalsTest, PoissonOnesHaveExponentialGaps) {
  constexpr int kCount = 200'000;
  constexpr double kRate = 500;
  ArrivalSchedule arrivals(Arrivals::kPoisson, kRate, 42);
  double sum = 0, squares = 0;
  int longer = 0;  // Than the mean: a share of 1/e.
  absl::Duration before;
  for (int i = 0; i < kCount; ++i) {
    const absl::Duration due = arrivals.Next();
    ASSERT_GE(due, before);
    const double gap = absl::ToDoubleSeconds(due - before) * kRate;
    before = due;
    sum += gap;
    squares += gap * gap;
    longer += gap > 1 ? 1 : 0;
  }
  // Six standard deviations of each estimate.
  EXPECT_NEAR(sum / kCount, 1, 6 / std::sqrt(kCount));
  EXPECT_NEAR(squares / kCount, 2, 6 * std::sqrt(20.0 / kCount));
  EXPECT_NEAR(static_cast<double>(longer) / kCount, std::exp(-1), 6 * 0.5 / std::sqrt(kCount));
}

TEST(ArrivalsTest, TheSeedDecides) {
  ArrivalSchedule a(Arrivals::kPoisson, 10, 7), b(Arrivals::kPoisson, 10, 7),
      c(Arrivals::kPoisson, 10, 8);
  bool differs = false;
  for (int i = 0; i < 100; ++i) {
    const absl::Duration due = a.Next();
    EXPECT_EQ(due, b.Next());
    differs |= due != c.Next();
  }
  EXPECT_TRUE(differs);
}

}  // namespace
}  // namespace sightline::load
