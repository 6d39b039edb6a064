// SPDX-License-Identifier: Apache-2.0
#include "client/load/stability.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace sightline::load {
namespace {

Window Of(uint64_t answers, double milliseconds) {
  Window window{.answered = answers};
  window.planned.Record(absl::Milliseconds(milliseconds), answers);
  return window;
}

TEST(StabilityTest, ThreeWindowsThatAgreeAreStable) {
  const std::vector<Window> windows = {Of(10, 90), Of(100, 5), Of(104, 5.2), Of(108, 5.1)};
  const Stability result = JudgeStability(windows, 0.10);
  EXPECT_TRUE(result.stable);
  EXPECT_NEAR(result.rate_spread, 0.08, 1e-9);
  EXPECT_NEAR(result.latency_spread, 0.04, 0.01);
}

TEST(StabilityTest, TwoAreNotEnough) {
  const std::vector<Window> windows = {Of(100, 5), Of(100, 5)};
  EXPECT_FALSE(JudgeStability(windows, 0.10).stable);
  EXPECT_TRUE(std::isinf(JudgeStability(windows, 0.10).rate_spread));
  EXPECT_FALSE(JudgeStability({}, 0.10).stable);
}

TEST(StabilityTest, RateAndLatencyMustBothAgree) {
  EXPECT_FALSE(JudgeStability(std::vector{Of(100, 5), Of(100, 5), Of(115, 5)}, 0.10).stable);
  // A server that falls behind: as many answers, each later than the ones before.
  EXPECT_FALSE(JudgeStability(std::vector{Of(100, 5), Of(100, 50), Of(100, 95)}, 0.10).stable);
}

TEST(StabilityTest, AWindowWithoutAnswersIsNotStable) {
  const std::vector<Window> silent = {Window(), Window(), Window()};
  EXPECT_FALSE(JudgeStability(silent, 0.10).stable);
  EXPECT_FALSE(JudgeStability(std::vector{Of(100, 5), Window(), Of(100, 5)}, 0.10).stable);
}

}  // namespace
}  // namespace sightline::load
