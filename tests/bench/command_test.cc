// SPDX-License-Identifier: Apache-2.0
//
// What commands print for machines: small runs, whose every line is JSON with all common keys.
#include "tests/bench/command.h"

#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/bench/report.h"

namespace sightline::bench {
namespace {

// The lines of a run that ends well.
std::vector<Row> Lines(Command command, const std::vector<std::string>& args) {
  std::ostringstream out, err;
  Context context{out, err};
  const absl::StatusOr<bool> good = command(args, context);
  EXPECT_TRUE(good.ok()) << good.status() << err.str();
  EXPECT_TRUE(good.ok() && *good) << err.str();
  std::vector<Row> rows;
  std::istringstream lines(out.str());
  for (std::string line; std::getline(lines, line);) {
    rows.push_back(Row::parse(line, nullptr, /*allow_exceptions=*/false));
    EXPECT_FALSE(rows.back().is_discarded()) << line;
  }
  return rows;
}

// All keys, and of these all that are not named with a value.
void ExpectKeys(const Row& row, const std::set<std::string>& may_be_null) {
  for (const std::string& key : kCommonKeys) {
    ASSERT_TRUE(row.contains(key)) << key << " of " << row.dump();
    EXPECT_TRUE(!row.at(key).is_null() || may_be_null.count(key) > 0)
        << key << " of " << row.dump();
  }
}

bool IsSummary(const Row& row) { return row.at("scene") == "all"; }

const std::vector<std::string> kSmall = {"--scene", "builtin:sphere:2000", "--json", "--repeats",
                                         "1"};

std::vector<std::string> With(std::vector<std::string> args, const std::vector<std::string>& more) {
  args.insert(args.end(), more.begin(), more.end());
  return args;
}

// One command, every workload, several scenes; one that cannot be read stands in nobody's way.
TEST(CommandTest, EmbreeRunsAllWorkloadsOfAllScenes) {
  const std::vector<std::string> args =
      With(kSmall, {"--scene", "builtin:hall:30000", "--workload", "all", "--sweep", "64x32,32x32",
                    "--points", "500", "--no-fast-peer"});
  const std::vector<Row> rows = Lines(EmbreeCommand, args);
  size_t of_scenes = 0, summaries = 0;
  std::set<std::string> workloads;
  for (const Row& row : rows) {
    if (IsSummary(row)) {
      ++summaries;
      EXPECT_EQ(row.at("scenes"), 2);
      continue;
    }
    ++of_scenes;
    workloads.insert(row.at("workload"));
    ExpectKeys(row, {});
    EXPECT_GT(row.at("ratio"), 0);
    EXPECT_EQ(row.at("disagreements_beyond_rounding"), 0);
  }
  EXPECT_EQ(of_scenes, 2u * (4 * 2 + 5));
  EXPECT_EQ(summaries, 4u * 2 + 5);
  EXPECT_EQ(workloads.size(), 9u);
}

TEST(CommandTest, ASceneThatCannotBeReadIsToldAfterTheOthers) {
  std::ostringstream out, err;
  Context context{out, err};
  const std::vector<std::string> args = {
      "--scene",  "builtin:nowhere", "--scene", "builtin:sphere:2000", "--workload",
      "segments", "--points",        "500",     "--repeats",           "1",
      "--json"};
  const absl::StatusOr<bool> good = EmbreeCommand(args, context);
  EXPECT_FALSE(good.ok());
  EXPECT_NE(err.str().find("builtin:nowhere: "), std::string::npos);
  EXPECT_NE(out.str().find("\"scene\":\"builtin:sphere:2000\""), std::string::npos);
}

TEST(CommandTest, RowsOfVerifyHaveAllKeys) {
  const std::vector<Row> rows =
      Lines(VerifyCommand,
            {"--batches", "1", "--scene", "builtin:sphere:2000", "--threads", "1", "--json"});
  ASSERT_FALSE(rows.empty());
  // The soak compares answers, not speeds.
  const std::set<std::string> null = {"triangles", "peer_mode", "peer_rate_per_s",
                                      "ratio",     "ratio_min", "ratio_max"};
  bool structures = false;
  for (const Row& row : rows) {
    const std::string workload = row.at("workload");
    std::set<std::string> also = null;
    if (workload == "verify-places") {
      also.insert({"peer", "disagreements", "disagreements_beyond_rounding"});
    }
    ExpectKeys(row, also);
    if (workload != "verify") continue;
    EXPECT_EQ(row.at("disagreements"), 0) << row.dump();
    structures =
        structures || row.at("way").get<std::string>().find("KD_TREE") != std::string::npos;
  }
  EXPECT_TRUE(structures);
}

}  // namespace
}  // namespace sightline::bench
