// SPDX-License-Identifier: Apache-2.0
#include "client/load/options.h"

#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::load {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

absl::StatusOr<std::unique_ptr<LoadOptions>> Parse(const std::vector<std::string>& args) {
  std::ostringstream out;
  return ParseOptions(args, out);
}

TEST(OptionsTest, TheDefaultsAreAClosedLoopOfTiles) {
  const auto options = Parse({"--scene", "builtin:box"});
  ASSERT_TRUE(options.ok()) << options.status();
  EXPECT_EQ((*options)->plan.mode, Mode::kClosed);
  EXPECT_EQ((*options)->plan.duration, absl::Seconds(30));
  EXPECT_EQ((*options)->check, Check::kSample);
  EXPECT_THAT((*options)->mix, ElementsAre(1, 0, 0));
  EXPECT_TRUE((*options)->slo.empty());
}

TEST(OptionsTest, FlagsAreTakenOver) {
  const auto options = Parse({"--scene=hall", "--server=localhost:1", "--check-scene=builtin:hall",
                              "--mode=open", "--rate=250", "--arrivals=constant", "--duration=1m",
                              "--workload=mixed", "--mix=points=1,segments=3", "--slo=p99=20ms",
                              "--check=all", "--connections=5", "--size=320x200", "--tile=16"});
  ASSERT_TRUE(options.ok()) << options.status();
  const LoadOptions& o = **options;
  EXPECT_EQ(o.scene, "scenes/hall");  // A plain word is a scene of the server.
  EXPECT_EQ(o.plan.mode, Mode::kOpen);
  EXPECT_EQ(o.plan.rate, 250);
  EXPECT_EQ(o.plan.arrivals, Arrivals::kConstant);
  EXPECT_EQ(o.plan.duration, absl::Minutes(1));
  EXPECT_THAT(o.mix, ElementsAre(0, 1, 3));
  EXPECT_EQ(o.slo.clauses().size(), 2u);  // And no errors.
  EXPECT_EQ(o.check, Check::kAll);
  EXPECT_EQ(o.session.connections, 5u);
  EXPECT_EQ(o.width, 320u);
  EXPECT_EQ(o.tile, 16u);
}

TEST(OptionsTest, AScenesOfTheServersIsCheckedAsIsSaid) {
  const std::pair<const char*, Check> cases[] = {
      {"sample", Check::kSample}, {"all", Check::kAll}, {"none", Check::kNone}};
  for (const auto& [word, check] : cases) {
    const auto options =
        Parse({"--scene=hall", "--server=localhost:1", absl::StrCat("--check=", word)});
    ASSERT_TRUE(options.ok()) << options.status();
    EXPECT_EQ((*options)->check, check);
  }
  EXPECT_EQ((*Parse({"--scene=hall", "--server=localhost:1"}))->check, Check::kSample);
}

TEST(OptionsTest, ARateAloneMeansAnOpenLoop) {
  const auto options = Parse({"--scene=builtin:box", "--rate=20"});
  ASSERT_TRUE(options.ok()) << options.status();
  EXPECT_EQ((*options)->plan.mode, Mode::kOpen);
  EXPECT_EQ((*options)->plan.rate, 20);
}

TEST(OptionsTest, TheKneeIsSearchedInAnOpenLoop) {
  const auto options = Parse({"--scene=builtin:box", "--find-knee", "--slo=p99=1s"});
  ASSERT_TRUE(options.ok()) << options.status();
  EXPECT_EQ((*options)->plan.mode, Mode::kOpen);
  EXPECT_GT((*options)->plan.rate, 0);
}

// The last windows say whether a run is stable: none is beyond those that are kept.
TEST(OptionsTest, WindowsGrowWithALongRun) {
  const auto window = [](const std::vector<std::string>& flags) {
    std::vector<std::string> args = {"--scene=builtin:box"};
    args.insert(args.end(), flags.begin(), flags.end());
    const auto options = Parse(args);
    EXPECT_TRUE(options.ok()) << options.status();
    return (*options)->window;
  };
  EXPECT_EQ(window({"--duration=4000s"}), absl::Seconds(1));
  EXPECT_EQ(window({"--duration=4001s"}), absl::Seconds(2));
  EXPECT_EQ(window({"--duration=24h"}), absl::Seconds(22));
  EXPECT_EQ(window({"--duration=24h", "--window=1m"}), absl::Minutes(1));
  EXPECT_EQ(window({"--duration=40s", "--window=10ms"}), absl::Milliseconds(10));
  EXPECT_EQ(window({"--find-knee", "--slo=p50=1s", "--trial=3h"}), absl::Seconds(3));
}

TEST(OptionsTest, WhatIsNotAskedTakesNoMemoryAndAllOfOneFlagGoesWithTheOthersDefault) {
  for (const std::vector<std::string>& args : std::vector<std::vector<std::string>>{
           {"--points=1048576", "--segments=1048576"},
           {"--workload=points", "--distinct=65536"},
           {"--workload=points", "--points=1048576", "--distinct=85"},
           {"--workload=segments", "--segments=1048576", "--distinct=42", "--points=1048576"},
           {"--workload=mixed", "--mix=tiles=1,points=0", "--points=1048576"}}) {
    std::vector<std::string> all = {"--scene=builtin:box"};
    all.insert(all.end(), args.begin(), args.end());
    EXPECT_TRUE(Parse(all).ok()) << args.back();
  }
}

TEST(OptionsTest, MistakesAreUsageErrorsThatNameTheFlag) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{}, "--scene"},
      {{"--mode=open"}, "--mode open wants --rate: "},
      {{"--mode=open", "--rate=0"}, "--rate wants requests per second, above 0"},
      {{"--rate=-1"}, "--rate wants requests per second, above 0"},
      {{"--rate=1e9"}, "at most 1000000; got 1000000000"},
      {{"--find-knee", "--slo=p50=1s", "--rate=0"}, "--rate wants requests per second"},
      {{"--mode=closed", "--rate=5"}, "--rate goes with"},
      {{"--arrivals=constant"}, "--arrivals goes with"},
      {{"--rate=5", "--concurrency=2"}, "--concurrency goes with"},
      {{"--trial=1s"}, "--trial goes with"},
      {{"--mode=closed", "--find-knee", "--slo=p50=1s"}, "--find-knee goes with"},
      {{"--reload-by=file"}, "--reload-every"},
      {{"--find-knee"}, "--slo"},
      {{"--slo=p99"}, "--slo"},
      {{"--mix=tiles=1"}, "--mix goes with"},
      {{"--metrics-token-file=t"}, "--metrics-token-file goes with --server-metrics"},
      {{"--workload=mixed", "--mix=cats=1"}, "cats"},
      {{"--duration=0s"}, "--duration"},
      {{"--duration=forever"}, "--duration"},
      {{"--duration=10m", "--window=10ms"},
       "--window 10ms would make more than 4000 windows of 10m: give 150ms or more"},
      {{"--workload=points", "--points=1048576"},
       "--points 1048576 and --distinct 256 would take 6 GiB of memory, 2 GiB is the most: give "
       "--distinct 85 or less, or --points 349525 or less"},
      {{"--workload=mixed", "--segments=1000000", "--distinct=65536"},
       "--segments 1000000 and --distinct 65536 would take 2930 GiB of memory, 2 GiB is the most: "
       "give --distinct 44 or less, or --segments 682 or less"},
      {{"--plot=x.gif"}, "--plot"},
      {{"--concurrency=0"}, "--concurrency"},
      {{"--connections=65"}, "--connections"},
      {{"--size=0x4"}, "--size"},
      {{"--check-scene=scenes/x"}, "--check-scene"},
      {{"--check-scene=builtin:box", "--check=none"}, "--check-scene goes with"},
      {{"--path=p.csv", "--eye=1,2,3"}, "--eye goes without --path"},
      {{"--path=p.csv", "--at=1,2,3"}, "--at goes without --path"},
      {{"--path=p.csv", "--cameras=3"}, "--cameras goes without --path"},
      {{"--output=xml"}, "--output"},
      {{"--sceen=x"}, "did you mean --scene"},
      {{"word"}, "unexpected 'word'"},
  };
  for (auto [args, words] : cases) {
    if (!args.empty()) args.emplace_back("--scene=builtin:box");
    const auto options = Parse(args);
    ASSERT_FALSE(options.ok()) << words;
    EXPECT_EQ(cli::ToExitCode(options.status()), cli::kExitUsage) << options.status();
    EXPECT_THAT(std::string(options.status().message()), HasSubstr(words));
  }
}

TEST(OptionsTest, RequestsThatNoMessageHoldsAreRefused) {
  const client::Limits limits{.max_message_bytes = 4 << 20};
  const auto check = [&](std::vector<std::string> args) {
    args.emplace_back("--scene=builtin:box");
    const auto options = Parse(args);
    EXPECT_TRUE(options.ok()) << options.status();
    return options.ok() ? CheckMessages(**options, limits) : options.status();
  };
  const std::string segments = "--workload=segments", points = "--workload=points";
  EXPECT_TRUE(check({segments, "--distinct=1", "--segments=87296"}).ok());
  const absl::Status many = check({segments, "--distinct=1", "--segments=87297"});
  EXPECT_EQ(cli::ToExitCode(many), cli::kExitUsage) << many;
  EXPECT_THAT(std::string(many.message()),
              HasSubstr("--segments 87297 of 48 bytes each do not fit into a message of the "
                        "server, of which max_message_bytes is 4194304: give --segments 87296 or "
                        "less"));
  // Points are kept by the server, unless the scene changes.
  EXPECT_TRUE(check({points, "--distinct=1", "--points=1048576"}).ok());
  EXPECT_THAT(
      std::string(
          check({points, "--distinct=1", "--points=1048576", "--reload-every=9"}).message()),
      HasSubstr("give --points 174592 or less"));
  // What is not asked is not sent.
  EXPECT_TRUE(check({"--segments=1048576", "--points=1048576", "--reload-every=9"}).ok());
}

TEST(OptionsTest, HelpListsFlagsScenesAndExitCodes) {
  std::ostringstream out;
  const std::vector<std::string> args = {"--help"};
  const auto options = ParseOptions(args, out);
  ASSERT_TRUE(options.ok());
  EXPECT_EQ(*options, nullptr);
  for (const char* words : {"--find-knee", "--slo", "builtin:NAME", "asked for once by BRUTE_FORCE",
                            "answers were wrong"}) {
    EXPECT_THAT(out.str(), HasSubstr(words));
  }
}

}  // namespace
}  // namespace sightline::load
