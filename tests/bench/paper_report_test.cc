// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/paper_report.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/bench/markup.h"
#include "tests/support/temp_dir.h"

namespace sightline::bench {
namespace {

std::string ReadAll(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

using testing::ElementsAre;

// The picture's elements of that name. Whatever its elements are, they lie within it.
std::vector<XmlElement> Elements(const std::string& svg, absl::string_view name) {
  const absl::StatusOr<std::vector<XmlElement>> all = ParseXml(svg);
  EXPECT_TRUE(all.ok()) << all.status() << " of " << svg;
  std::vector<XmlElement> found;
  if (!all.ok()) return found;
  EXPECT_EQ(all->front().name, "svg");
  const double width = all->front().Number("width"), height = all->front().Number("height");
  const auto expect_within = [&](const std::string& number, double size) {
    double at = std::numeric_limits<double>::quiet_NaN();
    EXPECT_TRUE(absl::SimpleAtod(number, &at)) << number;
    EXPECT_TRUE(at >= 0 && at <= size) << number << " of " << svg;
  };
  for (const XmlElement& element : *all) {
    for (const auto& [key, value] : element.attributes) {
      if (key == "x" || key == "x1" || key == "x2") expect_within(value, width);
      if (key == "y" || key == "y1" || key == "y2") expect_within(value, height);
      if (key != "points") continue;
      for (const absl::string_view point : absl::StrSplit(value, ' ', absl::SkipEmpty())) {
        const std::pair<std::string, std::string> at = absl::StrSplit(point, ',');
        expect_within(at.first, width);
        expect_within(at.second, height);
      }
    }
    if (element.name == name) found.push_back(element);
  }
  return found;
}

std::vector<std::string> Texts(const std::string& svg) {
  std::vector<std::string> texts;
  for (const XmlElement& text : Elements(svg, "text")) texts.push_back(text.text);
  return texts;
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
  EXPECT_EQ(Elements(svg, "polyline").size(), 1u);
  EXPECT_EQ(svg.find("<4>"), std::string::npos) << "a name must not become a tag";
}

// All tables' columns are their rows' keys, whatever their cells hold, with figures of a paper's
// own beside ours where it has them.
TEST(PaperReportTest, MarkdownIsWellFormed) {
  const testing_support::TempDir folder;
  std::stringstream out;
  PaperReport report(/*json=*/false, out, folder.path() + "/r.md");
  report.Begin("000", "Figure 3", "cycles a test");
  report.Add({{"culling", "base"}, {"cycles", 8.5}, {"paper_cycles", 8}});
  report.Add({{"culling", "6 planes | aperture"}, {"cycles", 4.0}, {"paper_cycles", nullptr}});
  report.Conclude("A gain of two.");
  report.Claim({"gain", "2.7", "1 | 2", Verdict::kInPart, "wide & <deep>"});
  report.End();
  report.Begin("000", "Figure 4", "nothing was measured");
  report.End();
  report.EndClaims();
  ASSERT_TRUE(report.Finish().ok());
  const auto tables = ParseMarkdownTables(ReadAll(folder.path() + "/r.md"));
  ASSERT_TRUE(tables.ok()) << tables.status();
  ASSERT_EQ(tables->size(), 2u);
  EXPECT_THAT((*tables)[0], ElementsAre(ElementsAre("culling", "cycles", "paper_cycles"),
                                        ElementsAre("base", "8.50", "8"),
                                        ElementsAre("6 planes | aperture", "4.00", "-")));
  EXPECT_THAT((*tables)[1], ElementsAre(ElementsAre("paper", "table", "claim", "the paper's",
                                                    "measured", "carries over", "our explanation"),
                                        ElementsAre("000", "Figure 3", "gain", "2.7", "1 | 2",
                                                    "in part", "wide & <deep>")));
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
  EXPECT_TRUE(Elements(svg, "polyline").empty());
  EXPECT_THAT(Texts(svg), testing::IsSupersetOf({"none", "TE", "8 x 8", "16 x 16"}));
  std::vector<double> lefts, heights;
  for (const XmlElement& bar : Elements(svg, "rect")) {
    if (bar.attributes.contains("x")) {  // The ground has none.
      lefts.push_back(bar.Number("x"));
      heights.push_back(bar.Number("height"));
    }
  }
  ASSERT_EQ(lefts.size(), 4u);  // 8 x 8 over none and TE, then 16 x 16.
  EXPECT_LT(lefts[0], lefts[2]);
  EXPECT_LT(lefts[2], lefts[1]);
  EXPECT_LT(lefts[1], lefts[3]);
  EXPECT_NEAR(2 * heights[0], heights[1], 0.2);
  EXPECT_EQ(heights[1], heights[3]);
}

// Paper 003's Table I has nine tests.
TEST(PaperReportTest, BarsOfNineSeriesHaveColoursOfTheirOwn) {
  std::vector<Row> rows;
  for (int test = 0; test < 9; ++test) {
    rows.push_back({{"form", "single"}, {"test", absl::StrCat("test ", test)}, {"rate", 1.5}});
  }
  const std::string svg =
      PlotSvg(rows, {.x = "form", .y = "rate", .series = "test", .bars = true}, "rates");
  std::set<std::string> colours;
  for (const XmlElement& bar : Elements(svg, "rect")) {
    if (bar.attributes.contains("x")) colours.insert(bar.attributes.at("fill"));
  }
  EXPECT_EQ(colours.size(), 9u);
}

// Names of two neighbours may be wider than a place: each has its row to itself there.
TEST(PaperReportTest, NamesOfBarsTakeTurnsInTwoRows) {
  std::vector<Row> rows;
  for (const char* form : {"single", "single, 16 triangles", "packets of 4", "packets of 16"}) {
    rows.push_back({{"form", form}, {"test", "WALD"}, {"rate", 1.5}});
  }
  const std::string svg =
      PlotSvg(rows, {.x = "form", .y = "rate", .series = "test", .bars = true}, "rates");
  std::map<std::string, double> heights;
  for (const XmlElement& text : Elements(svg, "text")) heights[text.text] = text.Number("y");
  EXPECT_EQ(heights.at("single"), heights.at("packets of 4"));
  EXPECT_EQ(heights.at("single, 16 triangles"), heights.at("packets of 16"));
  EXPECT_GT(heights.at("packets of 16"), heights.at("single") + 11) << "the letters' height";
  EXPECT_GT(heights.at("rate, over form"), heights.at("packets of 16") + 11);
}

// Figures that have no place in a picture, and pictures without any.
TEST(PaperReportTest, WhatHasNoPlaceIsLeftOutOfPlots) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const std::vector<Row> rows = {{{"way", "a"}, {"x", 1.0}, {"y", 1.0}},
                                 {{"way", "a"}, {"x", 10.0}, {"y", 2.0}},
                                 {{"way", "a"}, {"x", 0.0}, {"y", 2.0}},
                                 {{"way", "a"}, {"x", 100.0}, {"y", kInfinity}},
                                 {{"way", "a"}, {"x", kInfinity}, {"y", 2.0}},
                                 {{"way", "a"}, {"x", "none"}, {"y", 2.0}},
                                 {{"way", "a"}, {"x", 100.0}, {"y", std::nan("")}},
                                 {{"way", "b"}, {"x", 1.0}, {"y", nullptr}}};
  const PlotSpec spec = {.x = "x", .y = "y", .series = "way", .log_x = true};
  const std::vector<XmlElement> lines = Elements(PlotSvg(rows, spec, "lines"), "polyline");
  ASSERT_EQ(lines.size(), 1u);
  EXPECT_EQ(std::count(lines[0].attributes.at("points").begin(),
                       lines[0].attributes.at("points").end(), ','),
            2);
  for (const bool bars : {false, true}) {
    PlotSpec none = spec;
    none.bars = bars;
    const std::string svg = PlotSvg({rows.back()}, none, "nothing");
    EXPECT_TRUE(Elements(svg, "polyline").empty());
    for (const XmlElement& rect : Elements(svg, "rect"))
      EXPECT_FALSE(rect.attributes.contains("x"));
  }
}

// Several series of one tree say the same of it: its line goes through its own figures alone.
TEST(PaperReportTest, ALineGoesThroughItsRowsInTheirOrder) {
  std::vector<Row> rows;
  for (const double ratio : {0.1, 1.0, 10.0}) {
    for (const char* culling : {"kd, base", "kd, masked"}) {
      rows.push_back({{"way", culling}, {"tree", "kd"}, {"ratio", ratio}, {"leaf", 10 * ratio}});
    }
  }
  const std::string svg =
      PlotSvg(rows, {.x = "ratio", .y = "leaf", .series = "tree", .log_x = true}, "sizes");
  const std::vector<XmlElement> lines = Elements(svg, "polyline");
  ASSERT_EQ(lines.size(), 1u);
  const std::vector<std::string> points =
      absl::StrSplit(lines[0].attributes.at("points"), ' ', absl::SkipEmpty());
  ASSERT_EQ(points.size(), 6u);
  for (size_t i = 0; i < points.size(); i += 2) EXPECT_EQ(points[i], points[i + 1]);
  // Ratios a tenth and ten times of one another are equally far apart.
  const auto x = [&](size_t i) {
    double value = 0;
    EXPECT_TRUE(absl::SimpleAtod(points[i].substr(0, points[i].find(',')), &value));
    return value;
  };
  EXPECT_NEAR(x(2) - x(0), x(4) - x(2), 0.11);
  EXPECT_THAT(Texts(svg), testing::IsSupersetOf({"0.100", "1.00", "10.0", "100", "kd"}));
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
  for (const XmlElement& line : Elements(svg, "polyline")) {
    looks.insert(
        absl::StrCat(line.attributes.at("stroke"), " ", line.attributes.at("stroke-dasharray")));
  }
  EXPECT_EQ(looks.size(), 20u);
  EXPECT_GT(Elements(svg, "svg")[0].Number("width"), 700);  // 640 for names that fit.
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
