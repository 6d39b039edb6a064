// SPDX-License-Identifier: Apache-2.0
//
// What commands print for machines: small runs, whose every line is JSON with all common keys.
#include "tests/bench/command.h"

#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "client/cli/exit_code.h"
#include "gmock/gmock.h"
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

// What lines over all scenes have no value of, or none where their scenes differ.
const std::set<std::string> kNullOverScenes = {"triangles", "strategy",        "rate_per_s",
                                               "peer_mode", "peer_rate_per_s", "ratio",
                                               "ratio_min", "ratio_max"};

bool IsSummary(const Row& row) { return row.at("scene") == "all"; }

const std::vector<std::string> kSmall = {
    "--scene", "builtin:sphere:2000", "--json", "--repeats", "1", "--quick"};

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
      ExpectKeys(row, kNullOverScenes);
      EXPECT_EQ(row.at("disagreements_beyond_rounding"), 0);
      continue;
    }
    ++of_scenes;
    workloads.insert(row.at("workload"));
    ExpectKeys(row, {});
    EXPECT_GT(row.at("ratio"), 0);
    EXPECT_GT(row.at("ratio_total"), 0);
    EXPECT_GE(row.at("units_per_repetition"), 1);
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

// Of points, one thread and several would cut their work otherwise if they were let.
TEST(CommandTest, ThreadsAnswerAsOneDoes) {
  const std::vector<Row> rows =
      Lines(ScalingCommand, {"--scene", "builtin:box:1000", "--workload", "points", "--lights",
                             "lights", "--points", "2000", "--repeats", "1", "--quick", "--json"});
  ASSERT_EQ(rows.size(), 1u);
  ExpectKeys(rows[0], {"peer_rate_per_s"});
  EXPECT_EQ(rows[0].at("threads"), 2);
  EXPECT_EQ(rows[0].at("disagreements"), 0);
  EXPECT_GT(rows[0].at("share"), 0);
}

TEST(CommandTest, EveryChoiceAnswersAsAutoDoes) {
  const std::vector<Row> rows =
      Lines(AutoCommand, With(kSmall, {"--workload", "segments", "--points", "500", "--choice",
                                       "PACKET KD_TREE", "--choice", "SHAFT BVH", "--choices"}));
  ASSERT_EQ(rows.size(), 3u);
  for (const Row& row : rows) {
    ExpectKeys(row, {});
    EXPECT_EQ(row.at("wrong_units"), 0) << row.dump();
  }
}

TEST(CommandTest, BuildingTimesEveryPresetAndCountsBytes) {
  const std::vector<Row> rows =
      Lines(BuildCommand, With(kSmall, {"--width", "64", "--height", "64", "--no-high"}));
  std::set<std::string> workloads;
  for (const Row& row : rows) {
    const std::string workload = row.at("workload");
    workloads.insert(workload);
    std::set<std::string> null = {"disagreements", "disagreements_beyond_rounding"};
    if (workload == "bytes-per-triangle") null.insert({"rate_per_s", "peer_rate_per_s"});
    ExpectKeys(row, null);
    EXPECT_GT(row.at("ratio"), 0) << row.dump();
  }
  EXPECT_EQ(workloads.count("bytes-per-triangle"), 1u);
  EXPECT_GE(workloads.size(), 4u);
}

// Through both kinds of sockets all answers are those of the engine, each in its place.
TEST(CommandTest, TheServiceAnswersAsTheEngineDoes) {
  const std::vector<Row> rows =
      Lines(ServiceCommand, With(kSmall, {"--width", "160", "--height", "96", "--segments", "70000",
                                          "--calls", "10", "--threads", "2"}));
  std::set<std::string> workloads;
  for (const Row& row : rows) {
    ExpectKeys(row, {});
    workloads.insert(row.at("workload"));
    EXPECT_EQ(row.at("disagreements"), 0) << row.dump();
  }
  EXPECT_EQ(rows.size(), 2u * 7);
  EXPECT_EQ(workloads.size(), 7u);
}

TEST(CommandTest, WorkloadsOfTheServiceAreKnown) {
  std::ostringstream out, err;
  Context context{out, err};
  const std::vector<std::string> args = With(kSmall, {"--workload", "tile-bits"});
  const absl::Status status = ServiceCommand(args, context).status();
  EXPECT_EQ(cli::ToExitCode(status), cli::kExitUsage) << status;
  for (const char* name : {"'tile-bits'", "tiles-bits", "segments-f32-bits", "latency"}) {
    EXPECT_THAT(std::string(status.message()), testing::HasSubstr(name));
  }
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
