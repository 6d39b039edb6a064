// SPDX-License-Identifier: Apache-2.0
#include "client/cli/progress.h"

#include <sstream>

#include "gtest/gtest.h"

namespace sightline::cli {
namespace {

TEST(ProgressTest, NumbersForPeople) {
  EXPECT_EQ(HumanCount(0), "0");
  EXPECT_EQ(HumanCount(999), "999");
  EXPECT_EQ(HumanCount(999.7), "1.00 k");
  EXPECT_EQ(HumanCount(12345), "12.3 k");
  EXPECT_EQ(HumanCount(45'678'901), "45.7 M");
  EXPECT_EQ(HumanCount(2.5e12), "2.50 T");
  EXPECT_EQ(GroupedCount(0), "0");
  EXPECT_EQ(GroupedCount(999), "999");
  EXPECT_EQ(GroupedCount(1000), "1,000");
  EXPECT_EQ(GroupedCount(1234567), "1,234,567");
  EXPECT_EQ(ClockTime(absl::Seconds(7)), "0:07");
  EXPECT_EQ(ClockTime(absl::Milliseconds(6100)), "0:07");
  EXPECT_EQ(ClockTime(absl::Seconds(3 * 3600 + 25 * 60)), "3:25:00");
}

TEST(ProgressTest, LineSaysShareRateAndTimeLeft) {
  std::ostringstream err;
  const Progress progress(err, true, "tracing", "rays", 4'000'000);
  EXPECT_EQ(progress.Line(1'000'000, absl::Seconds(2)), "tracing  25 %  500 k rays/s  0:06 left");
  EXPECT_EQ(progress.Line(0, absl::Seconds(2)), "tracing   0 %");
}

TEST(ProgressTest, SilentWithoutATerminal) {
  std::ostringstream err;
  {
    Progress progress(err, false, "tracing", "rays", 10);
    for (uint64_t i = 0; i <= 10; ++i) progress.Update(i);
  }
  EXPECT_EQ(err.str(), "");
}

}  // namespace
}  // namespace sightline::cli
