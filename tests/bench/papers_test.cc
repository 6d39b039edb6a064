// SPDX-License-Identifier: Apache-2.0
//
// Every paper's tables, once, at the least sizes there are: that each has its rows and figures, in
// JSON and in the report with its plots; and what does not hang on time lies where it must.
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "tests/bench/command.h"
#include "tests/bench/markup.h"
#include "tests/bench/report.h"
#include "tests/support/temp_dir.h"

namespace sightline::bench {
namespace {

using Table = std::pair<std::string, std::string>;  // Paper and title.

// What one run of all papers prints, and writes.
struct Run {
  testing_support::TempDir folder;
  std::map<Table, std::vector<Row>> tables;
  std::vector<Row> conclusions, claims;
};

const Run& TheRun() {
  static const Run* const run = [] {
    auto* made = new Run;
    std::ostringstream out, err;
    Context context{out, err};
    const absl::StatusOr<bool> good = PapersCommand(
        std::vector<std::string>{"--quick", "--json", "--report", made->folder.path() + "/r.md"},
        context);
    EXPECT_TRUE(good.ok() && *good) << good.status() << err.str();
    std::istringstream lines(out.str());
    for (std::string line; std::getline(lines, line);) {
      Row row = Row::parse(line, nullptr, /*allow_exceptions=*/false);
      EXPECT_FALSE(row.is_discarded()) << line;
      if (row.is_discarded()) continue;
      EXPECT_FALSE(row.contains("not measured")) << line << ": all scenes are built-in";
      if (row.contains("conclusion")) {
        made->conclusions.push_back(std::move(row));
      } else if (row.contains("carries over")) {
        made->claims.push_back(std::move(row));
      } else {
        const Table table = {row.at("paper").get<std::string>(),
                             row.at("table").get<std::string>()};
        made->tables[table].push_back(std::move(row));
      }
    }
    return made;
  }();
  return *run;
}

std::string ReadAll(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

TEST(PapersTest, EveryTableHasItsRows) {
  // By paper and how the title begins.
  const std::pair<Table, size_t> kRows[] = {
      {{"000", "Figure 3"}, 8 * 8},
      {{"000", "Figure 4a"}, 4 * 8},
      {{"000", "Figure 4b"}, 4 * 8},
      {{"000", "Figure 5"}, 6 * 8},
      {{"000", "Figures 7 to 9"}, 7 * (8 + 5)},
      {{"000", "the engine beside Figures 7 to 9"}, 1 + 4},
      {{"000", "section 4"}, 2},
      {{"001", "Table 2, "}, 5 * 2 * 7},
      {{"001", "Table 2 on a binary BVH"}, 5 * 2 * 5},
      {{"001", "the engine beside Table 2"}, 2 * 2 * 2},
      {{"001", "Table 3"}, 5},
      {{"002", "Table 1"}, 3 * 2},
      {{"002", "Figure 7"}, 3 * 6 * 2},
      {{"002", "Figure 8"}, 3 * 4 * 2},
      {{"002", "Figures 7 and 8"}, 3 * 2},
      {{"003", "precision"}, 7},
      {{"004", "Figures 5 to 9"}, 7 * 3},
      {{"004", "Figures 10 to 12"}, 10},
      {{"004", "Figures 14 and 15, "}, 2 * 8},
      {{"004", "Figures 14 and 15 on"}, 2 * 8},
      {{"004", "Figure 16"}, 2 * 2},
      {{"004", "the engine beside Figures 5 to 16"}, 2 * (1 + 4) + 2},
      {{"004", "relighting"}, 3 * 2}};
  for (const auto& [table, count] : kRows) {
    size_t found = 0;
    for (const auto& [at, its] : TheRun().tables) {
      if (at.first == table.first && absl::StartsWith(at.second, table.second)) {
        ++found;
        EXPECT_EQ(its.size(), count) << at.first << ", " << at.second;
      }
    }
    EXPECT_EQ(found, 1u) << table.first << ", " << table.second;
  }
  // As many more as registers are wide: with and without AVX-512.
  for (const char* title : {"Table I", "Table II"}) {
    EXPECT_EQ(TheRun().tables.count({"003", title}), 1u);
  }
  EXPECT_EQ(TheRun().tables.size(), std::size(kRows) + 2);
}

TEST(PapersTest, EveryFigureIsANumber) {
  for (const auto& [table, rows] : TheRun().tables) {
    for (const Row& row : rows) {
      for (const auto& [key, value] : row.items()) {
        if (absl::StartsWith(key, "paper_")) continue;                 // Not every figure has one.
        ASSERT_FALSE(value.is_null()) << key << " of " << row.dump();  // JSON's NaN and infinity.
        if (!value.is_number()) continue;
        EXPECT_TRUE(std::isfinite(value.get<double>())) << key << " of " << row.dump();
        EXPECT_GE(value.get<double>(), 0) << key << " of " << row.dump();
      }
    }
  }
}

// By what they are of: words, and the numbers that are chosen, not measured.
TEST(PapersTest, RowsOfATableAreToldApart) {
  const std::set<std::string> kChosen = {"ratio", "packet",       "cross_section", "leaf",
                                         "bins",  "antialiasing", "width",         "times_smaller"};
  for (const auto& [table, rows] : TheRun().tables) {
    std::set<std::string> seen;
    for (const Row& row : rows) {
      Row of;
      for (const auto& [key, value] : row.items()) {
        if (value.is_string() || kChosen.contains(key)) of[key] = value;
      }
      EXPECT_TRUE(seen.insert(of.dump()).second)
          << table.first << ", " << table.second << " has two rows of " << of.dump();
    }
  }
}

TEST(PapersTest, EveryPapersClaimsHaveTheirLine) {
  std::map<std::string, int> claims;
  for (const Row& claim : TheRun().claims) {
    ++claims[claim.at("paper")];
    const std::string verdict = claim.at("carries over");
    EXPECT_TRUE(verdict == "yes" || verdict == "in part" || verdict == "no") << claim.dump();
    EXPECT_EQ(claim.at("our explanation").get<std::string>().empty(), verdict == "yes")
        << claim.dump();
    EXPECT_FALSE(claim.at("the paper's").get<std::string>().empty());
    EXPECT_FALSE(claim.at("measured").get<std::string>().empty());
    const std::string why = claim.at("our explanation");
    if (!why.empty() && absl::StrContains(claim.at("claim").get<std::string>(), "cost ratio,")) {
      const double best = std::stod(claim.at("measured").get<std::string>());
      const double papers = std::stod(claim.at("the paper's").get<std::string>());
      EXPECT_EQ(absl::StrContains(why, "larger leaves"), best < papers) << claim.dump();
    }
  }
  const std::map<std::string, int> expected = {
      {"000", 2 + 3 + 2},               // Synthetic, real, smaller trees.
      {"001", 2 * 3 + 2},               // By rays, and memory.
      {"002", 6 * 4 + 3 * 2},           // By scene and rays; and at the highest resolution.
      {"003", 3 + 2 + 1},               // Tables I and II, precision.
      {"004", 2 + 1 + 2 + 2 + 2 + 1}};  // And the ray mask on a surface as fine as the paper's.
  EXPECT_EQ(claims, expected);
  EXPECT_GE(TheRun().conclusions.size(), 10u);
}

// What was expected to carry over, each with its line.
TEST(PapersTest, WhatIsExpectedToCarryOverHasItsClaim) {
  const std::pair<const char*, const char*> kExpected[] = {
      {"000", "share of the tests removed"},
      {"001", "tests removed"},
      {"002", "rays at 640×480: RTT over packets of four"},
      {"002", "2048×1560 with 6×6 rays a pixel: RTT over packets of four"},
      {"003", "gain of the dot-product form over Wald's test"},
      {"004", "frame rate with 8 bins"},
      {"004", "best cost ratio, tree rebuilt"}};
  for (const auto& [paper, what] : kExpected) {
    int found = 0;
    for (const Row& claim : TheRun().claims) {
      found += claim.at("paper") == paper &&
               absl::StrContains(claim.at("claim").get<std::string>(), what);
    }
    EXPECT_GT(found, 0) << paper << ": " << what;
  }
}

TEST(PapersTest, TheEngineStandsBesideEveryPapersFastest) {
  std::map<std::string, int> tables;
  for (const auto& [table, rows] : TheRun().tables) {
    if (!absl::StartsWith(table.second, "the engine beside")) continue;
    ++tables[table.first];
    std::string asked;
    for (const Row& row : rows) {
      SCOPED_TRACE(row.dump());
      const std::string way = row.at("way");
      // The paper's comes first of what is asked, and is what the others are held against.
      const bool first = row.at("asked") != asked;
      asked = row.at("asked");
      if (first) {
        EXPECT_EQ(row.at("times_paper"), 1);
      }
      EXPECT_EQ(absl::StrContains(way, "leaves of") || absl::StrContains(way, "cost ratio"), first);
      EXPECT_GT(row.at("times_paper"), 0);
      EXPECT_GT(row.at("Mrays_per_s"), 0);
    }
  }
  EXPECT_EQ(tables, (std::map<std::string, int>{{"000", 1}, {"001", 1}, {"004", 1}}));
  // In paper 002's table as columns; paper 003's is of single tests.
  for (const Row& row : TheRun().tables.at({"002", "Table 1"})) {
    EXPECT_TRUE(row.contains("shafts_gain_best") && row.contains("shafts_gain_rtt"));
  }
}

TEST(PapersTest, ThePredicateHasItsRatesBesideThePapersTests) {
  std::map<std::string, std::set<std::string>> forms;
  for (const Row& row : TheRun().tables.at({"003", "Table I"})) {
    const std::string test = row.at("test");
    if (!absl::StartsWith(test, "EXACT")) {
      EXPECT_LE(row.at("of_best"), 1) << row.dump();
    }
    EXPECT_GT(row.at("of_best"), 0) << row.dump();
    EXPECT_GT(row.at("of_best_worst"), 0) << row.dump();
    forms[test].insert(row.at("form"));
  }
  for (const char* form : {"single, 8 triangles", "packets of 8", "256 rays, 8 lanes"}) {
    EXPECT_TRUE(forms["EXACT"].contains(form)) << form;
    EXPECT_TRUE(forms["EXACT, hits alone"].contains(form)) << form;
  }
}

// Unless asked otherwise, paper 000's figures are of as many triangles as the paper's.
TEST(PapersTest, TheSphereIsThePapers) {
  std::ostringstream out, err;
  Context context{out, err};
  ASSERT_TRUE(PapersCommand(std::vector<std::string>{"--help"}, context).ok()) << err.str();
  EXPECT_TRUE(absl::StrContains(out.str(), "(default: 10M)")) << out.str();
}

TEST(PapersTest, CountsLieWhereTheyMust) {
  for (const auto& [table, rows] : TheRun().tables) {
    for (const Row& row : rows) {
      SCOPED_TRACE(row.dump());
      if (table == Table("000", "Figure 3") && row.at("ratio") == 8.0) {
        const std::string culling = row.at("culling");
        if (culling == "base: Kensler-Shirley" || culling == "the predicate, bare") {
          EXPECT_EQ(row.at("culled_percent"), 0);
        }
        if (absl::StrContains(culling, "6 planes + aperture")) {
          EXPECT_GT(row.at("culled_percent"), 90);
        }
      }
      if (row.contains("NPI")) {
        const std::string culling = row.at("rays and culling");
        const bool boxes = absl::StrContains(culling, "boxes");
        const bool updates = boxes && !absl::StrContains(culling, "never updated") &&
                             !absl::StrContains(culling, "predicate");
        if (!boxes || row.at("leaf") >= 8) {
          EXPECT_EQ(row.at("NAC") > 0, boxes);
        }
        if (!boxes || (updates && row.at("leaf") >= 8)) {
          EXPECT_EQ(row.at("NAU") > 0, updates);
        }
        const std::string rays = culling.substr(0, culling.find(':'));
        const std::string by = absl::StrContains(culling, "predicate") ? "the predicate" : "none";
        for (const Row& other : rows) {
          // Each leaves some of the tests out that its own test makes without it.
          if (other.at("leaf") != row.at("leaf") ||
              other.at("rays and culling") != absl::StrCat(rays, ": ", by)) {
            continue;
          }
          EXPECT_LE(row.at("NPI"), other.at("NPI"));
          EXPECT_EQ(row.at("TB"), other.at("TB"));
        }
        EXPECT_LE(row.at("TL"), row.at("TB"));
        EXPECT_TRUE(row.at("paper_NPI").is_null()) << "the room is like none of the paper's";
      }
      if (row.contains("paper_cycles")) {
        const std::string culling = row.at("culling");
        // Figure 3 begins, and Figure 5 passes, where the paper's own figures are of.
        const bool at = row.contains("ratio") ? row.at("ratio") == 1.0
                        : row.contains("packet")
                            ? table.second == "Figure 4a" && row.at("packet") == 64.0
                            : row.at("cross_section") == 4.0;
        EXPECT_EQ(row.at("paper_cycles"), !at                                  ? Row(nullptr)
                                          : culling == "base: Kensler-Shirley" ? Row(8)
                                          : culling == "6 planes + aperture"   ? Row(3)
                                                                               : Row(nullptr));
      }
      if (row.contains("tree and culling")) {
        for (const Row& other : rows) {  // What is plotted of the tree itself, however it is asked.
          if (other.at("tree") != row.at("tree") || other.at("ratio") < row.at("ratio")) continue;
          if (other.at("ratio") == row.at("ratio")) {
            EXPECT_EQ(row.at("leaf_triangles"), other.at("leaf_triangles"));
            EXPECT_EQ(row.at("nodes_per_triangle"), other.at("nodes_per_triangle"));
          } else {
            EXPECT_GE(row.at("leaf_triangles"), other.at("leaf_triangles")) << other.dump();
            EXPECT_LE(row.at("nodes_per_triangle"), other.at("nodes_per_triangle")) << other.dump();
          }
        }
        EXPECT_GE(row.at("leaf_triangles"), 1);
        if (row.at("tree and culling") == "kd, masked, leaf boxes computed") {
          for (const Row& other : rows) {  // The stored boxes again: the same tests are left out.
            if (other.at("tree and culling") != "kd, masked" ||
                other.at("ratio") != row.at("ratio")) {
              continue;
            }
            EXPECT_EQ(row.at("culled_percent"), other.at("culled_percent")) << other.dump();
          }
        }
      }
      if (row.contains("times_smaller")) {
        EXPECT_FALSE(row.at("paper_with").is_null());
        EXPECT_GT(row.at("times_smaller"), 1);
        EXPECT_GT(row.at("triangles_whole"), 16);
      }
      if (row.contains("timed_KB")) {
        EXPECT_LT(row.at("tree_KB"), row.at("timed_KB"));
        EXPECT_LT(row.at("timed_KB"), row.at("timed_boxes_KB"));
      }
      if (table.first == "002" && row.contains("answered")) {
        EXPECT_LT(row.at("answered"), 1);
      }
      if (table == Table("002", "Table 1")) {
        EXPECT_GT(row.at("answered"), 0);
        EXPECT_GT(row.at("relevant"), 0);
        EXPECT_LT(row.at("relevant"), 48) << "the longest list there is";
        EXPECT_GT(row.at("walked"), 0);
        for (const std::string of : {"", "paper_"}) {
          EXPECT_NEAR(row.at(of + "count").get<double>() / row.at(of + "walked").get<double>(),
                      row.at(of + "fewer_rays").get<double>(), 1e-9);
        }
        if (row.at("rays") == "primary") {
          EXPECT_EQ(row.at("count"), 64 * 48);
        }
      }
      if (table == Table("003", "precision")) {
        EXPECT_LT(row.at("weights"), 1e-8);
        EXPECT_GT(row.at("hits"), 1000);
      }
    }
  }
}

TEST(PapersTest, TheReportHasAllTablesAndPlots) {
  const std::string folder = TheRun().folder.path();
  const std::string text = ReadAll(folder + "/r.md");
  for (const auto& [table, rows] : TheRun().tables) {
    EXPECT_TRUE(absl::StrContains(text, "## Paper " + table.first + ", " + table.second + "\n"))
        << table.second;
  }
  EXPECT_TRUE(absl::StrContains(text, "what carries over"));
  const auto written = ParseMarkdownTables(text);
  ASSERT_TRUE(written.ok()) << written.status();
  ASSERT_EQ(written->size(), TheRun().tables.size() + 1) << "the claims' is one more";
  EXPECT_EQ(written->back().size(), TheRun().claims.size() + 1) << "and its heads";
  std::set<std::string> plots;
  for (size_t at = text.find("]("); at != std::string::npos; at = text.find("](", at + 1)) {
    const std::string name = text.substr(at + 2, text.find(')', at) - at - 2);
    EXPECT_TRUE(plots.insert(name).second) << name << " stands for two";
    const auto svg = ParseXml(ReadAll(folder + "/" + name));
    ASSERT_TRUE(svg.ok()) << svg.status() << " of " << name;
    size_t drawn = 0;
    for (const XmlElement& element : *svg) {
      const bool bar = element.name == "rect" && element.attributes.contains("x");
      EXPECT_EQ(bar, std::isfinite(element.Number("x")) && element.name == "rect") << name;
      drawn += bar || element.name == "polyline";
    }
    EXPECT_GT(drawn, 0u) << name;
  }
  // Of 000 four and four, of 001 two and one, of 002 two each, of 003 two and one, of 004 two, one,
  // one and one.
  EXPECT_EQ(plots.size(), 4u + 4 + 3 + 4 + 3 + 5);
}

}  // namespace
}  // namespace sightline::bench
