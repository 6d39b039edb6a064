// SPDX-License-Identifier: Apache-2.0
#include "client/import/text_scanner.h"

#include <cmath>
#include <cstdlib>
#include <string>

#include "absl/strings/str_format.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

TEST(ParseDoubleTest, RoundsDecimalsOnceToTheNearestDouble) {
  EXPECT_EQ(ParseDouble("447422.999"), 447422.999);
  EXPECT_EQ(ParseDouble("0.1"), 0.1);
  EXPECT_EQ(ParseDouble("-.5e+2"), -50.0);
  EXPECT_EQ(ParseDouble("+7."), 7.0);
  // Halfway between two doubles, and a hair above: needs every digit.
  EXPECT_EQ(ParseDouble("9007199254740993"), 9007199254740992.0);
  EXPECT_EQ(ParseDouble("9007199254740993.0000000000000000000000001"), 9007199254740994.0);
  testing_support::TestRng rng;
  for (int i = 0; i < 20000; ++i) {
    const std::string text =
        absl::StrFormat("%.*g", static_cast<int>(1 + rng.Below(18)), rng.Uniform(-1e7, 1e7));
    ASSERT_EQ(ParseDouble(text), std::strtod(text.c_str(), nullptr)) << text;
  }
}

TEST(ParseDoubleTest, KnowsNonFiniteForms) {
  for (const char* text : {"nan", "-NaN", "1.#IND", "-1.#IND", "1.#QNAN", "1.#SNAN"}) {
    ASSERT_TRUE(ParseDouble(text).has_value()) << text;
    EXPECT_TRUE(std::isnan(*ParseDouble(text))) << text;
  }
  EXPECT_EQ(ParseDouble("inf"), HUGE_VAL);
  EXPECT_EQ(ParseDouble("-Infinity"), -HUGE_VAL);
  EXPECT_EQ(ParseDouble("-1.#INF"), -HUGE_VAL);
  EXPECT_EQ(ParseDouble("1e999"), HUGE_VAL);
  EXPECT_EQ(ParseDouble("1e-999"), 0.0);
}

TEST(ParseDoubleTest, RefusesWhatIsNoNumber) {
  for (const char* text : {"", "+", "-", "1,5", "1.5x", "0x10", "+-1", "e5", "1 2", "--1"}) {
    EXPECT_FALSE(ParseDouble(text).has_value()) << text;
  }
}

TEST(ParseIntTest, TakesWholeTokensThatFit) {
  EXPECT_EQ(ParseInt("-12"), -12);
  EXPECT_EQ(ParseInt("+12"), 12);
  for (const char* text : {"", "+-1", "1.0", "1/2", "9223372036854775808", "x"}) {
    EXPECT_FALSE(ParseInt(text).has_value()) << text;
  }
}

TEST(TextScannerTest, EndsLinesAsAnySystemDoes) {
  TextScanner scanner("a\r\nb\rc\n\nd");
  for (const char* line : {"a", "b", "c", "", "d"}) EXPECT_EQ(scanner.RestOfLine(), line);
  EXPECT_TRUE(scanner.AtEnd());
  EXPECT_EQ(scanner.RestOfLine(), "");
}

TEST(TextScannerTest, CutsTokensAcrossLines) {
  TextScanner scanner("  a\tb \n c");
  for (const char* token : {"a", "b", "c", ""}) EXPECT_EQ(scanner.Token(), token);
}

TEST(TextScannerTest, SkipsCommentsAndEmptyLines) {
  TextScanner scanner("# x\n\n  1 2 # y\n   \n3");
  EXPECT_EQ(scanner.ContentLine('#'), "1 2");
  EXPECT_EQ(scanner.ContentLine('#'), "3");
  EXPECT_EQ(scanner.ContentLine('#'), "");
}

TEST(QuotedTest, IsShortAndPrintable) {
  EXPECT_EQ(Quoted("a\n\x01"), "\"a\\n\\x01\"");
  EXPECT_LT(Quoted(std::string(100000, 'x')).size(), 80u);
}

}  // namespace
}  // namespace sightline
