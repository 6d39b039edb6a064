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
