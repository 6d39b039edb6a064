// SPDX-License-Identifier: Apache-2.0
#include "client/load/plain_number.h"

#include <gtest/gtest.h>

#include <limits>

namespace sightline::load {
namespace {

TEST(PlainNumberTest, DigitsAreAsAsked) {
  EXPECT_EQ(PlainNumber(0, 3), "0");
  EXPECT_EQ(PlainNumber(1.2345, 3), "1.23");
  EXPECT_EQ(PlainNumber(-123.45, 4), "-123.5");
  EXPECT_EQ(PlainNumber(600, 4), "600");
}

TEST(PlainNumberTest, WhatIsBeforeThePointIsThereInFull) {
  EXPECT_EQ(PlainNumber(999.4, 3), "999");
  EXPECT_EQ(PlainNumber(999.6, 3), "1000");  // 1e+03 in three digits.
  EXPECT_EQ(PlainNumber(12345.6, 4), "12346");
  EXPECT_EQ(PlainNumber(-12345.6, 4), "-12346");
  EXPECT_EQ(PlainNumber(1e6, 4), "1000000");
}

TEST(PlainNumberTest, SmallOnesHaveTheirZeros) {
  EXPECT_EQ(PlainNumber(0.0001, 3), "0.0001");
  EXPECT_EQ(PlainNumber(0.00000751, 3), "0.00000751");
  EXPECT_EQ(PlainNumber(-0.00001, 3), "-0.00001");
  EXPECT_EQ(PlainNumber(0.000009996, 3), "0.00001");  // 1e-05 in three digits.
}

TEST(PlainNumberTest, NoNumberIsAWord) {
  EXPECT_EQ(PlainNumber(std::numeric_limits<double>::infinity(), 3), "inf");
  EXPECT_EQ(PlainNumber(std::numeric_limits<double>::quiet_NaN(), 3), "nan");
}

TEST(PlainNumberTest, LatenciesAreInMilliseconds) {
  EXPECT_EQ(MillisecondsText(absl::ZeroDuration()), "0");
  EXPECT_EQ(MillisecondsText(absl::Nanoseconds(1)), "0.000001");
  EXPECT_EQ(MillisecondsText(absl::Microseconds(1234)), "1.23");
  EXPECT_EQ(MillisecondsText(absl::Milliseconds(3370.4)), "3370");
  EXPECT_EQ(MillisecondsText(absl::Hours(1)), "3600000");
}

}  // namespace
}  // namespace sightline::load
