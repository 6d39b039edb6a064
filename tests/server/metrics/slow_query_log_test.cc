// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/slow_query_log.h"

#include <chrono>

#include "absl/time/time.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using std::chrono::nanoseconds;

TEST(SlowQueryLogTest, WantsWhatTookAsLongAsItsThreshold) {
  const SlowQueryLog slow(absl::Milliseconds(500));
  EXPECT_FALSE(slow.Wants(nanoseconds(0)));
  EXPECT_FALSE(slow.Wants(nanoseconds(499'999'999)));
  EXPECT_TRUE(slow.Wants(nanoseconds(500'000'000)));
  EXPECT_TRUE(slow.Wants(std::chrono::hours(1)));
}

TEST(SlowQueryLogTest, WithoutAThresholdItWantsNothingAndWithZeroEverything) {
  EXPECT_FALSE(SlowQueryLog(absl::InfiniteDuration()).Wants(std::chrono::hours(10'000)));
  EXPECT_TRUE(SlowQueryLog(absl::ZeroDuration()).Wants(nanoseconds(0)));
}

}  // namespace
}  // namespace sightline
