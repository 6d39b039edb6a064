// SPDX-License-Identifier: Apache-2.0
#include "core/base/check.h"

#include <vector>

#include "gtest/gtest.h"

namespace sightline {
namespace {

enum class Colour : unsigned char { kRed = 7 };
struct Opaque {
  int value;
  bool operator==(const Opaque&) const = default;
};

TEST(CheckTest, PassingChecksEvaluateOnceAndSayNothing) {
  int calls = 0;
  SIGHTLINE_CHECK(++calls == 1) << "unreached " << ++calls;
  SIGHTLINE_CHECK_EQ(++calls, 2) << "unreached";
  EXPECT_EQ(calls, 2);
}

TEST(CheckTest, WorksWithinAnUnbracedIfElse) {
  const bool never = testing::UnitTest::GetInstance() == nullptr;
  bool reached = false;
  if (never)
    SIGHTLINE_CHECK(false);
  else
    reached = true;
  if (never)
    SIGHTLINE_CHECK_EQ(1, 2);
  else
    EXPECT_TRUE(reached);
}

TEST(CheckDeathTest, NamesPlaceConditionAndMessage) {
  EXPECT_DEATH(SIGHTLINE_CHECK(1 > 2) << "leaf " << 42,
               "tests/core/base/check_test.cc:[0-9]+: check failed: 1 > 2 leaf 42");
}

TEST(CheckDeathTest, ComparisonsPrintBothValues) {
  const std::vector<int> three(3);
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(three.size(), 4u), "three.size\\(\\) == 4u \\(3 against 4\\)");
  EXPECT_DEATH(SIGHTLINE_CHECK_NE(1, 1), "1 against 1");
  EXPECT_DEATH(SIGHTLINE_CHECK_LT(2, 1), "2 against 1");
  EXPECT_DEATH(SIGHTLINE_CHECK_LE(2, 1), "2 against 1");
  EXPECT_DEATH(SIGHTLINE_CHECK_GT(1, 2), "1 against 2");
  EXPECT_DEATH(SIGHTLINE_CHECK_GE(1, 2) << "why", "1 against 2\\) why");
}

TEST(CheckDeathTest, PrintsEnumsBytesAndOpaqueValues) {
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(Colour::kRed, Colour{8}), "7 against 8");
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(static_cast<unsigned char>(9), 10), "9 against 10");
  EXPECT_DEATH(SIGHTLINE_CHECK_EQ(Opaque{1}, Opaque{2}), "4 bytes");
}

#if defined(SIGHTLINE_DEBUG_CHECKS)
TEST(CheckDeathTest, DebugChecksAreOnInDebugAndSanitizerBuilds) {
  EXPECT_DEATH(SIGHTLINE_DCHECK(false) << "seen", "seen");
  EXPECT_DEATH(SIGHTLINE_DCHECK_EQ(1, 2), "1 against 2");
}
#else
TEST(CheckTest, DebugChecksEvaluateNothingInReleaseBuilds) {
  int calls = 0;
  SIGHTLINE_DCHECK(++calls == 100) << "unreached";
  SIGHTLINE_DCHECK_EQ(++calls, 100);
  EXPECT_EQ(calls, 0);
}
#endif

}  // namespace
}  // namespace sightline
