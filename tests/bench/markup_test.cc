// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/markup.h"

#include <cmath>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::bench {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

TEST(MarkupTest, ElementsComeInOrderWithWhatTheyHold) {
  const auto svg =
      ParseXml("<svg>\n<g><rect x=\"1.5\" fill=\"a > b\" /></g><text>1 &lt; 2</text>\n</svg>\n");
  ASSERT_TRUE(svg.ok()) << svg.status();
  ASSERT_EQ(svg->size(), 4u);
  EXPECT_EQ((*svg)[0].name, "svg");
  EXPECT_EQ((*svg)[1].name, "g");
  EXPECT_EQ((*svg)[2].name, "rect");
  EXPECT_EQ((*svg)[2].Number("x"), 1.5);
  EXPECT_EQ((*svg)[2].attributes.at("fill"), "a > b");
  EXPECT_TRUE(std::isnan((*svg)[2].Number("fill")));
  EXPECT_TRUE(std::isnan((*svg)[2].Number("y")));
  EXPECT_EQ((*svg)[3].text, "1 < 2");
}

TEST(MarkupTest, WhatIsNoXmlIsRefused) {
  for (const char* bad :
       {"", "words", "<a>", "<a></b>", "<a></a></a>", "<a/><b/>", "<a/>words", "<a>1 < 2</a>",
        "<a>1 & 2</a>", "<a x=\"1 & 2\"/>", "<a x=\"<\"/>", "<a x=1/>", "<a x=\"1/>",
        "<a x=\"1\" x=\"2\"/>", "<a", "<a></a", "<4/ >"}) {
    const auto read = ParseXml(bad);
    EXPECT_EQ(read.status().code(), absl::StatusCode::kInvalidArgument) << bad;
  }
}

TEST(MarkupTest, TablesHaveTheirCells) {
  const auto tables = ParseMarkdownTables(
      "# title\n\n| a | b |\n|---|--:|\n| 1 | x \\| y |\n\n| c |\n|:---|\n\nwords | and bars |\n");
  ASSERT_TRUE(tables.ok()) << tables.status();
  ASSERT_EQ(tables->size(), 2u);
  EXPECT_THAT((*tables)[0], ElementsAre(ElementsAre("a", "b"), ElementsAre("1", "x | y")));
  EXPECT_THAT((*tables)[1], ElementsAre(ElementsAre("c")));
}

TEST(MarkupTest, ATableThatIsBrokenIsRefused) {
  for (const char* bad :
       {"| a | b |\n", "| a | b |\n\n", "| a | b |\n| 1 | 2 |\n", "| a | b |\n|---|\n",
        "| a |\n|---|\n| 1 | 2 |\n", "| a |\n|---|\n| x | y |\n", "| a |\n|---|\n| 1\n"}) {
    const auto read = ParseMarkdownTables(bad);
    EXPECT_EQ(read.status().code(), absl::StatusCode::kInvalidArgument) << bad;
    EXPECT_THAT(std::string(read.status().message()), HasSubstr(" ")) << bad;
  }
}

}  // namespace
}  // namespace sightline::bench
