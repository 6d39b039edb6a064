// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/paper_report.h"

#include <fstream>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline::bench {
namespace {

std::string ReadAll(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(PaperReportTest, CellsShowThreeDigitsAndWholeCounts) {
  EXPECT_EQ(PaperCell(Row(3.14159)), "3.14");
  EXPECT_EQ(PaperCell(Row(31.4159)), "31.4");
  EXPECT_EQ(PaperCell(Row(314.159)), "314");
  EXPECT_EQ(PaperCell(Row(0.0314159)), "0.031");
  EXPECT_EQ(PaperCell(Row(2.5e-13)), "2.50e-13");
  EXPECT_EQ(PaperCell(Row(42)), "42");
  EXPECT_EQ(PaperCell(Row(nullptr)), "-");
  EXPECT_EQ(PaperCell(Row("Wald")), "Wald");
}

TEST(PaperReportTest, JsonIsOneObjectPerLineNamingPaperAndTable) {
  std::stringstream out;
  PaperReport report(/*json=*/true, out, "");
  report.Begin("003", "Table I", "speed");
  report.Add({{"test", "Wald"}, {"single", 1.5}});
  report.Conclude("it holds");
  report.End();
  EXPECT_EQ(out.str(),
            "{\"paper\":\"003\",\"table\":\"Table I\",\"remark\":\"speed\",\"test\":\"Wald\","
            "\"single\":1.5}\n"
            "{\"paper\":\"003\",\"table\":\"Table I\",\"conclusion\":\"it holds\"}\n");
  EXPECT_TRUE(report.Finish().ok());
}

TEST(PaperReportTest, MarkdownHasTheTableAndItsPlot) {
  const testing_support::TempDir folder;
  std::stringstream out;
  PaperReport report(/*json=*/false, out, folder.path() + "/r.md");
  report.Begin("000", "Figure 3", "cycles");
  report.Add({{"culling", "base"}, {"ratio", 1}, {"cycles", 8.5}});
  report.Add({{"culling", "base"}, {"ratio", 2}, {"cycles", 4.0}});
  report.Add({{"culling", "planes <4>"}, {"ratio", 2}, {"cycles", nullptr}});
  report.Plot({.x = "ratio", .y = "cycles", .series = "culling"});
  report.End();
  ASSERT_TRUE(report.Finish().ok());
  EXPECT_NE(out.str().find("Paper 000, Figure 3: cycles"), std::string::npos);
  const std::string text = ReadAll(folder.path() + "/r.md");
  EXPECT_NE(text.find("| culling | ratio | cycles |\n|---|--:|--:|\n| base | 1 | 8.50 |"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("](r-000-figure-3-cycles.svg)"), std::string::npos);
  const std::string svg = ReadAll(folder.path() + "/r-000-figure-3-cycles.svg");
  EXPECT_NE(svg.find("<polyline"), std::string::npos);
  EXPECT_EQ(svg.find("<4>"), std::string::npos) << "a name must not become a tag";
}

// What a run could not measure is said wherever its figures are.
TEST(PaperReportTest, WhatIsNotMeasuredIsNamedInAllForms) {
  const testing_support::TempDir folder;
  for (const bool json : {false, true}) {
    std::stringstream out;
    PaperReport report(json, out, folder.path() + "/r.md");
    report.NotMeasured("001", "bunny.ply.xz", "there is no such file");
    ASSERT_TRUE(report.Finish().ok());
    EXPECT_EQ(out.str(), json
                             ? "{\"paper\":\"001\",\"not measured\":\"bunny.ply.xz\","
                               "\"why\":\"there is no such file\"}\n"
                             : "\nPaper 001, not measured: bunny.ply.xz (there is no such file)\n");
    EXPECT_NE(ReadAll(folder.path() + "/r.md")
                  .find("Paper 001, not measured: bunny.ply.xz (there is no such file)\n"),
              std::string::npos);
  }
}

// A bar for each name and series, as high as its figure.
TEST(PaperReportTest, BarsStandSideBySideOverTheirNames) {
  std::vector<Row> rows;
  for (const char* packets : {"8 x 8", "16 x 16"}) {
    for (const char* test : {"none", "TE"}) {
      rows.push_back({{"packets", packets}, {"tests", test}, {"percent", rows.empty() ? 50 : 100}});
    }
  }
  const std::string svg =
      PlotSvg(rows, {.x = "tests", .y = "percent", .series = "packets", .bars = true}, "speed");
  EXPECT_EQ(svg.find("<polyline"), std::string::npos);
  EXPECT_NE(svg.find(">none</text>"), std::string::npos);
  EXPECT_NE(svg.find(">TE</text>"), std::string::npos);
  std::vector<double> lefts, heights;
  for (size_t at = svg.find("<rect x="); at != std::string::npos;
       at = svg.find("<rect x=", at + 1)) {
    const auto number = [&](const char* key) {
      const size_t from = svg.find(key, at) + std::string(key).size();
      double value = 0;
      EXPECT_TRUE(absl::SimpleAtod(svg.substr(from, svg.find('"', from) - from), &value));
      return value;
    };
    lefts.push_back(number("x=\""));
    heights.push_back(number("height=\""));
  }
  ASSERT_EQ(lefts.size(), 4u);  // 8 x 8 over none and TE, then 16 x 16.
  EXPECT_LT(lefts[0], lefts[2]);
  EXPECT_LT(lefts[2], lefts[1]);
  EXPECT_LT(lefts[1], lefts[3]);
  EXPECT_NEAR(2 * heights[0], heights[1], 0.2);
  EXPECT_EQ(heights[1], heights[3]);
}

// However many lines there are, each is told from the others, and their names are not cut off.
TEST(PaperReportTest, LinesOfPlotsAreAllDifferent) {
  std::vector<Row> rows;
  for (int line = 0; line < 20; ++line) {
    const std::string name = absl::StrCat("a name that is longer than the margin: ", line);
    for (const int x : {1, 2}) rows.push_back({{"way", name}, {"x", x}, {"y", line + x}});
  }
  const std::string svg = PlotSvg(rows, {.x = "x", .y = "y", .series = "way"}, "lines");
  std::set<std::string> looks;
  for (size_t at = svg.find("<polyline"); at != std::string::npos;
       at = svg.find("<polyline", at + 1)) {
    const size_t look = svg.find("stroke=", at);
    looks.insert(svg.substr(look, svg.find("/>", at) - look));
  }
  EXPECT_EQ(looks.size(), 20u);
  double width = 0;
  ASSERT_TRUE(absl::SimpleAtod(svg.substr(svg.find("width=\"") + 7, 3), &width));
  EXPECT_GT(width, 700);  // 640 for names that fit.
}

TEST(PaperReportTest, ClaimsAreATableOfTheirOwn) {
  std::stringstream out;
  PaperReport report(/*json=*/true, out, "");
  report.EndClaims();
  EXPECT_EQ(out.str(), "") << "none made";
  report.Begin("003", "Table I", "speed");
  report.Claim({"gain", "1.37", "1.10", Verdict::kInPart, "latency"});
  report.Claim({"packets", "1.09", "1.20", Verdict::kHolds, "not said"});
  report.Claim({"loss", "1.09", "0.90", Verdict::kDoesNotHold, "width"});
  report.End();
  report.EndClaims();
  EXPECT_EQ(
      out.str(),
      "{\"paper\":\"003\",\"table\":\"Table I\",\"claim\":\"gain\",\"the paper's\":\"1.37\","
      "\"measured\":\"1.10\",\"carries over\":\"in part\",\"our explanation\":\"latency\"}\n"
      "{\"paper\":\"003\",\"table\":\"Table I\",\"claim\":\"packets\",\"the paper's\":\"1.09\","
      "\"measured\":\"1.20\",\"carries over\":\"yes\",\"our explanation\":\"\"}\n"
      "{\"paper\":\"003\",\"table\":\"Table I\",\"claim\":\"loss\",\"the paper's\":\"1.09\","
      "\"measured\":\"0.90\",\"carries over\":\"no\",\"our explanation\":\"width\"}\n");
}

TEST(PaperReportTest, VerdictsHaveTheirBands) {
  EXPECT_EQ(VerdictOfGain(1.5, 1.3), Verdict::kHolds);
  EXPECT_EQ(VerdictOfGain(1.171, 1.3), Verdict::kHolds);
  EXPECT_EQ(VerdictOfGain(1.169, 1.3), Verdict::kInPart);
  EXPECT_EQ(VerdictOfGain(1.0, 1.3), Verdict::kDoesNotHold);
  EXPECT_EQ(VerdictOfGain(0.99, 1.1), Verdict::kDoesNotHold) << "a loss within the band";
  EXPECT_EQ(VerdictOfGain(1.0, 1.06), Verdict::kDoesNotHold);
  EXPECT_EQ(VerdictOfGain(1.01, 1.06), Verdict::kHolds);
  EXPECT_EQ(VerdictOfGain(0.9, 0.95), Verdict::kHolds) << "a loss as small as the paper's";
  EXPECT_EQ(VerdictOfShare(0.901, 0.92), Verdict::kHolds);
  EXPECT_EQ(VerdictOfShare(0.89, 0.92), Verdict::kInPart);
  EXPECT_EQ(VerdictOfShare(0, 0.92), Verdict::kDoesNotHold);
  EXPECT_EQ(VerdictOfShare(-0.1, 0.92), Verdict::kDoesNotHold);
}

TEST(PaperReportTest, AFileThatCannotBeWrittenIsNamed) {
  std::stringstream out;
  PaperReport report(false, out, "no-such-folder/report.md");
  EXPECT_EQ(report.CheckWritable().code(), absl::StatusCode::kUnavailable);
  const absl::Status status = report.Finish();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_NE(status.message().find("no-such-folder/report.md"), absl::string_view::npos);
}

}  // namespace
}  // namespace sightline::bench
