// SPDX-License-Identifier: Apache-2.0
#include "client/load/knee.h"

#include <gtest/gtest.h>

#include "absl/status/status.h"

namespace sightline::load {
namespace {

absl::StatusOr<KneeTrial> Model(double rate, double capacity) {
  return KneeTrial{.rate = rate, .answered = std::min(rate, capacity), .held = rate <= capacity};
}

TEST(KneeTest, TheKneeIsFoundFromEitherSide) {
  for (const double capacity : {3.0, 50.0, 51.0, 777.0, 123'456.0}) {
    for (const double first : {1.0, 50.0, 1000.0}) {
      const absl::StatusOr<Knee> knee =
          FindKnee(first, [&](double rate) { return Model(rate, capacity); });
      ASSERT_TRUE(knee.ok());
      EXPECT_LE(knee->rate, capacity) << first;
      EXPECT_GE(knee->rate * (1 + kKneePrecision), capacity * 0.999) << first;
      EXPECT_GT(knee->missed, capacity);
      EXPECT_LE(knee->trials.size(), static_cast<size_t>(kMaxTrials));
    }
  }
}

TEST(KneeTest, OneBadTrialIsForgiven) {
  int trials = 0;
  const absl::StatusOr<Knee> knee = FindKnee(100, [&](double rate) {
    absl::StatusOr<KneeTrial> result = Model(rate, 1000);
    if (++trials == 2) result->held = false;  // 200, which holds otherwise.
    return result;
  });
  ASSERT_TRUE(knee.ok());
  EXPECT_GE(knee->rate, 950);
}

TEST(KneeTest, WhatNeverHoldsHasNoKnee) {
  const absl::StatusOr<Knee> knee = FindKnee(100, [](double rate) { return Model(rate, 0); });
  ASSERT_TRUE(knee.ok());
  EXPECT_EQ(knee->rate, 0);
  EXPECT_LE(knee->trials.size(), static_cast<size_t>(kMaxTrials));
}

TEST(KneeTest, WhatNeverMissesEndsAfterTheMostTrials) {
  const absl::StatusOr<Knee> knee = FindKnee(1, [](double rate) { return Model(rate, 1e300); });
  ASSERT_TRUE(knee.ok());
  EXPECT_EQ(knee->missed, 0);
  EXPECT_EQ(knee->trials.size(), static_cast<size_t>(kMaxTrials));
}

// What a trial met and a whole run does not gives way, step by step.
TEST(KneeTest, AKneeThatDoesNotHoldStepsBack) {
  for (const double capacity : {1000.0, 950.0, 700.0}) {
    Knee knee{.rate = 1000, .missed = 1040, .trials = {{.rate = 1000, .held = true}}};
    std::vector<double> rates;
    ASSERT_TRUE(HoldKnee(&knee, [&](double rate) {
                  rates.push_back(rate);
                  return Model(rate, capacity);
                }).ok());
    EXPECT_LE(knee.rate, capacity);
    EXPECT_GE(knee.rate, std::min(capacity, 1000.0) * kStepBack);
    EXPECT_EQ(rates.back(), knee.rate);
    ASSERT_EQ(knee.trials.size(), 1 + rates.size());  // The one of before, and the runs.
    EXPECT_FALSE(knee.trials[0].whole);
    for (size_t i = 0; i < rates.size(); ++i) {
      EXPECT_EQ(knee.trials[1 + i].rate, rates[i]);
      EXPECT_TRUE(knee.trials[1 + i].whole);
      EXPECT_EQ(knee.trials[1 + i].held, i + 1 == rates.size());
    }
    EXPECT_DOUBLE_EQ(knee.missed, rates.size() == 1 ? 1040 : knee.rate / kStepBack);
  }
}

// A rate is not called the knee because nothing below it was tried.
TEST(KneeTest, SteppingBackEndsWithoutAKnee) {
  Knee knee{.rate = 1000};
  int runs = 0;
  ASSERT_TRUE(HoldKnee(&knee, [&](double rate) {
                ++runs;
                return Model(rate, 1);
              }).ok());
  EXPECT_EQ(runs, kStepsBack + 1);
  EXPECT_EQ(knee.trials.size(), static_cast<size_t>(kStepsBack + 1));
  EXPECT_EQ(knee.rate, 0);
  EXPECT_EQ(knee.missed, knee.trials.back().rate);
  Knee other{.rate = 1000};
  const absl::Status gone =
      HoldKnee(&other, [](double) -> absl::StatusOr<KneeTrial> { return absl::AbortedError("x"); });
  EXPECT_TRUE(absl::IsAborted(gone)) << gone;
}

TEST(KneeTest, AnErrorEndsTheSearch) {
  int trials = 0;
  const absl::StatusOr<Knee> knee = FindKnee(1, [&](double rate) -> absl::StatusOr<KneeTrial> {
    if (++trials == 3) return absl::UnavailableError("gone");
    return Model(rate, 100);
  });
  EXPECT_EQ(knee.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(trials, 3);
}

}  // namespace
}  // namespace sightline::load
