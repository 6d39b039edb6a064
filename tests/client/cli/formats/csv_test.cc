// SPDX-License-Identifier: Apache-2.0
#include "client/cli/formats/csv.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::cli {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing_support::TestRng;

CsvTable Parse(const std::string& text) {
  absl::StatusOr<CsvTable> table = ParseCsv(text, "P.csv");
  EXPECT_TRUE(table.ok()) << table.status();
  return table.ok() ? *table : CsvTable();
}

std::string CsvError(const std::string& text) {
  const absl::StatusOr<CsvTable> table = ParseCsv(text, "P.csv");
  EXPECT_EQ(table.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(table.status().message()), HasSubstr("P.csv"));
  return std::string(table.status().message());
}

TEST(CsvTest, EverySeparator) {
  for (const char* text :
       {"1,2,3\n4,5,6\n", "1;2;3\n4;5;6", "1 2 3\n4 5 6\n", "1\t2\t3\r\n4\t5\t6\r\n",
        " 1 ,\t2, 3 \n4 , 5,6", "  1   2\t 3\n\n\n4 5 6\n\n", "\uFEFF1,2,3\n4,5,6\n"}) {
    const CsvTable table = Parse(text);
    EXPECT_EQ(table.rows, 2u) << text;
    EXPECT_EQ(table.columns, 3u) << text;
    EXPECT_THAT(table.values, ElementsAre(1, 2, 3, 4, 5, 6)) << text;
  }
}

TEST(CsvTest, HeadersAndComments) {
  const CsvTable table = Parse("# written by hand\nx,y,\"z\"\n1,2,3\n# more\n\"4\",5,6\n");
  EXPECT_THAT(table.header, ElementsAre("x", "y", "z"));
  EXPECT_THAT(table.values, ElementsAre(1, 2, 3, 4, 5, 6));
  const CsvTable one_word = Parse("points\n1,2,3\n");
  EXPECT_TRUE(one_word.header.empty());
  EXPECT_THAT(one_word.values, ElementsAre(1, 2, 3));
}

TEST(CsvTest, NumbersAreRoundedOnce) {
  const CsvTable table = Parse("447422.999,+1e-5,-0.1\nnan,inf,-inf\n1e400,1e-400,1e22\n");
  EXPECT_EQ(table.values[0], 447422.999);
  EXPECT_EQ(table.values[1], 1e-5);
  EXPECT_EQ(table.values[2], -0.1);
  EXPECT_TRUE(std::isnan(table.values[3]));
  EXPECT_EQ(table.values[4], std::numeric_limits<double>::infinity());
  EXPECT_EQ(table.values[5], -std::numeric_limits<double>::infinity());
  EXPECT_EQ(table.values[6], std::numeric_limits<double>::infinity());
  EXPECT_EQ(table.values[7], 0);
  EXPECT_EQ(table.values[8], 1e22);
}

TEST(CsvTest, MistakesNameTheirLine) {
  EXPECT_THAT(CsvError(""), HasSubstr("no row"));
  EXPECT_THAT(CsvError("x,y,z\n"), HasSubstr("no row"));
  EXPECT_THAT(CsvError("points\n"), HasSubstr("no row"));
  EXPECT_THAT(CsvError("# nothing\n\n"), HasSubstr("no row"));
  EXPECT_THAT(CsvError("1,2,3\n4,5\n"), AllOf(HasSubstr("line 2"), HasSubstr("2 columns")));
  EXPECT_THAT(CsvError("x,y,z\n1,2\n"), AllOf(HasSubstr("line 2"), HasSubstr("2 columns")));
  EXPECT_THAT(CsvError("1,2,3\n4,5,six\n"),
              AllOf(HasSubstr("line 2"), HasSubstr("column 3"), HasSubstr("six")));
  // A first line with a slip is no header: it must not vanish.
  EXPECT_THAT(CsvError("1,2x,3\n4,5,6\n"), AllOf(HasSubstr("line 1"), HasSubstr("2x")));
  EXPECT_THAT(CsvError("1,2,3\nx,y,z\n"), HasSubstr("line 2"));
  EXPECT_THAT(CsvError("x,y,z\na,b,c\n1,2,3\n"), HasSubstr("line 2"));
  EXPECT_THAT(CsvError("1,2,3,\n"), HasSubstr("column 4"));
  EXPECT_THAT(CsvError("1,5;2,5;3,5\n"), testing::AnyOf(HasSubstr("point"), HasSubstr("no row")));
  EXPECT_THAT(CsvError("x;y;z\n1,5;2;3\n"), HasSubstr("write decimals with a point"));
  EXPECT_THAT(CsvError(std::string("1,2,3\n4,5,\0\n", 12)), HasSubstr("zero byte"));
  EXPECT_THAT(CsvError("1,2,+-3\n"), HasSubstr("+-3"));
  EXPECT_THAT(CsvError("1,2," + std::string(100000, 'a')), HasSubstr("..."));
}

TEST(CsvTest, NoRandomTextCrashes) {
  TestRng rng;
  const std::string alphabet = "0123456789.,;- \t\n\r\"#xenaif+";
  for (int i = 0; i < 20000; ++i) {
    std::string text;
    for (uint64_t k = rng.Below(60); k > 0; --k) text += alphabet[rng.Below(alphabet.size())];
    const absl::StatusOr<CsvTable> table = ParseCsv(text, "x");
    if (!table.ok()) continue;
    EXPECT_EQ(table->values.size(), table->rows * table->columns) << text;
  }
}

}  // namespace
}  // namespace sightline::cli
