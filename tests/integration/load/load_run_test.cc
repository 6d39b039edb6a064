// SPDX-License-Identifier: Apache-2.0
//
// sightline-load as a whole, against servers in this process. Runs end by the number of requests.
#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "client/cli/formats/file.h"
#include "client/load/knee.h"
#include "client/load/run.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/server.h"
#include "tests/integration/load/load_fixture.h"
#include "tests/support/temp_dir.h"

namespace sightline::load {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

TEST_F(LoadRunTest, AClosedLoopAnswersEverythingRight) {
  const RunResult result =
      RunWith({ServerFlag(), "--scene=builtin:box", "--workload=mixed", "--requests=600",
               "--concurrency=6", "--connections=3", "--check=all", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  const nlohmann::json json = result.json();
  EXPECT_EQ(json["mode"], "closed");
  EXPECT_EQ(json["all"]["requests"], 600);
  EXPECT_EQ(json["all"]["answered"], 600);
  EXPECT_EQ(json["checked"], 600);
  EXPECT_EQ(json["wrong"], 0);
  EXPECT_EQ(json["streams"], 3 * (2 + 1 + 1));
  EXPECT_GT(json["server_compute_ms"]["count"], 0);
  EXPECT_GT(json["all"]["rays_per_s"], 0);
  for (const char* kind : {"tiles", "points", "segments"}) {
    EXPECT_GT(json["by_kind"][kind]["answered"], 0) << kind;
  }
  EXPECT_EQ(Scenes().size(), 1u) << "the scene of the test is still there";
}

// The server's queue holds one item; whoever comes beside it is refused.
TEST_F(LoadRunTest, AClosedLoopWaitsAfterRefusals) {
  ServerOptions options{.scenes = {"box=builtin:box"}};
  options.limits.max_queued_rays = 1;
  StartServer(options);
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--workload=points", "--requests=200",
               "--concurrency=8", "--connections=4", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  const nlohmann::json json = result.json();
  const int64_t failed = json["all"]["failed"], waits = json["refusal_waits"]["count"];
  EXPECT_EQ(json["all"]["requests"], 200);
  if (failed > 0) {
    EXPECT_EQ(json["errors"]["RESOURCE_EXHAUSTED QUEUE_FULL"], failed);
  }
  // One each, but for those whose refusal was the end of the run.
  EXPECT_LE(waits, failed);
  EXPECT_GE(waits, failed - 8);
  EXPECT_EQ(json["refusal_waits"]["total_s"] > 0, waits > 0);
}

TEST_F(LoadRunTest, AnOpenLoopCountsFromThePlanToo) {
  const RunResult result =
      RunWith({ServerFlag(), "--scene=builtin:box", "--mode=open", "--rate=2000", "--requests=300",
               "--workload=segments", "--check=all", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  const nlohmann::json json = result.json();
  EXPECT_EQ(json["mode"], "open");
  EXPECT_EQ(json["all"]["answered"], 300);
  EXPECT_EQ(json["wrong"], 0);
  for (const char* percentile : {"p50", "p99", "max"}) {
    EXPECT_GE(json["all"]["latency_planned_ms"][percentile],
              json["all"]["latency_sent_ms"][percentile]);
  }
}

TEST_F(LoadRunTest, EditsUnderLoadAreSeenWholeOrNotAtAll) {
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--check-scene=builtin:box", "--workload=mixed",
               "--requests=1500", "--reload-every=100", "--check=all", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.json()["checked"], 1500);
  EXPECT_GT(result.json()["edits"], 0);
  // An edit for each that took place, and perhaps one that takes the object away at the end.
  const int64_t edits = result.json()["edits"];
  ASSERT_EQ(Scenes().size(), 1u);
  const int64_t revision = Scenes()[0].revision;
  EXPECT_EQ(revision, 1 + edits + edits % 2) << "the test's object is still there";
}

TEST_F(LoadRunTest, FailuresAreNoAnswersThatAnEditWaitsFor) {
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--check-scene=builtin:box", "--workload=segments",
               "--requests=100", "--reload-every=10", "--item-timeout=1ns", "--output=json"});
  EXPECT_EQ(result.json()["all"]["failed"], 100) << result.err;
  EXPECT_EQ(result.json()["edits"], 0);
}

// Availability through reloads: a scene of the repository is read again under load.
TEST_F(LoadRunTest, ReloadsUnderLoadLoseNothing) {
  const testing_support::TempDir folder;
  StartServer({.repository = folder.path()});
  const auto stored = Client().CreateScene({.scene_id = "box", .builtin = "builtin:box"});
  ASSERT_TRUE(stored.ok()) << stored.status();
  ASSERT_TRUE(stored->stored);
  const RunResult result = RunWith({ServerFlag(), "--scene=box", "--check-scene=builtin:box",
                                    "--workload=mixed", "--requests=1000", "--reload-every=50",
                                    "--reload-by=file", "--check=all", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.json()["all"]["answered"], 1000);
  EXPECT_EQ(result.json()["checked"], 1000);
  EXPECT_EQ(result.json()["wrong"], 0);
  const int64_t reloads = result.json()["reloads"];
  EXPECT_GT(reloads, 0);
  EXPECT_EQ(Scenes()[0].revision, 1 + reloads);
}

TEST_F(LoadRunTest, AnObjectiveThatIsMissedHasItsExitCode) {
  const std::vector<std::string> args = {ServerFlag(), "--scene=box", "--requests=20"};
  std::vector<std::string> strict = args, lax = args;
  strict.emplace_back("--slo=p50=1ns");
  lax.emplace_back("--slo=p99=10m");
  const RunResult missed = RunWith(strict);
  EXPECT_EQ(missed.code, kExitMissed);
  EXPECT_THAT(missed.err, HasSubstr("the objective was missed: p50 "));
  EXPECT_THAT(missed.out, HasSubstr("MISSED"));
  EXPECT_EQ(RunWith(lax).code, 0);
}

// Whatever the first error is, and whether trying again may help with it.
TEST_F(LoadRunTest, AnObjectiveIsMissedWhereNothingIsAnswered) {
  const std::vector<std::string> args = {ServerFlag(), "--scene=box", "--requests=20",
                                         "--item-timeout=1ns"};
  std::vector<std::string> with_objective = args;
  with_objective.emplace_back("--slo=p99=10m");
  const RunResult missed = RunWith(with_objective);
  EXPECT_EQ(missed.code, kExitMissed) << missed.err;
  EXPECT_THAT(missed.err, HasSubstr("the objective was missed: p99: no answer, errors 100 % of 0 "
                                    "%; no request was answered; the first failed with: "));
  const RunResult expired = RunWith(args);
  EXPECT_EQ(expired.code, cli::kExitTemporary) << expired.err;
  EXPECT_THAT(expired.err, HasSubstr("no request was answered; the first failed with: "));
}

TEST_F(LoadRunTest, AKneeThatIsNotThereIsAMiss) {
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--find-knee", "--rate=200", "--slo=p50=1ns",
               "--requests=3", "--trial=100ms", "--workload=segments", "--output=json"});
  EXPECT_EQ(result.code, kExitMissed) << result.err;
  EXPECT_EQ(result.json()["knee"]["rate_per_s"], 0);
  EXPECT_GT(result.json()["knee"]["trials"].size(), 2u);
}

// How fast this machine is decides what rate is found, if any, and none of the below: the tool's
// own records must bear out what it says of them. (knee_test.cc has a server whose knee is known.)
TEST_F(LoadRunTest, TheKneeIsWhatTheTrialsSay) {
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--workload=points", "--points=4096", "--find-knee",
               "--rate=50", "--slo=p90=250ms", "--trial=200ms", "--duration=400ms",
               "--arrivals=constant", "--output=json"});
  const nlohmann::json json = result.json(), knee = json["knee"], trials = knee["trials"];
  ASSERT_FALSE(trials.empty());
  ASSERT_FALSE(knee["missed_per_s"].is_null()) << "no server keeps up with every rate";
  const double rate = knee["rate_per_s"], missed = knee["missed_per_s"];
  const nlohmann::json& last = trials.back();
  if (rate == 0) {
    EXPECT_EQ(result.code, kExitMissed) << result.err;
    EXPECT_EQ(last["held"], false);
    EXPECT_EQ(last["rate_per_s"], missed);
    return;
  }
  ASSERT_EQ(result.code, 0) << result.err << result.out;
  ASSERT_GT(missed, rate);
  // The report is of a whole run at that rate, which kept up and met the objective.
  EXPECT_EQ(json["rate_per_s"], rate);
  EXPECT_EQ(json["slo_held"], true);
  EXPECT_LE(json["all"]["latency_planned_ms"]["p90"], 250);
  EXPECT_EQ(json["all"]["failed"], 0);
  EXPECT_GE(json["all"]["answers_per_s"].get<double>() * json["measured_s"].get<double>(),
            kKeepsUp * json["all"]["requests"].get<double>() - 1e-6);
  EXPECT_EQ(last["rate_per_s"], rate);
  EXPECT_EQ(last["held"], true);
  EXPECT_EQ(last["in_full"], true);
  // The next step up: twice missed by trials, or once in full, and never held in full.
  int short_misses = 0, whole_misses = 0;
  for (const nlohmann::json& trial : trials) {
    if (trial["rate_per_s"] != missed) continue;
    if (trial["in_full"]) {
      EXPECT_FALSE(trial["held"]);
      ++whole_misses;
    } else if (!trial["held"]) {
      ++short_misses;
    }
  }
  EXPECT_TRUE(whole_misses == 1 || short_misses == 2) << knee.dump(2);
  EXPECT_LE(missed, rate * std::max(1 + kKneePrecision, 1 / kStepBack) + 1e-6);
}

TEST_F(LoadRunTest, ARunEndsOnceItIsStable) {
  // Windows of a second; in two minutes three of them agree on any machine.
  const RunResult result = RunWith({ServerFlag(), "--scene=box", "--until-stable", "--window=1s",
                                    "--duration=2m", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.json()["stable"], true);
  EXPECT_LE(result.json()["rate_spread"], 0.10);
  EXPECT_LE(result.json()["latency_spread"], 0.10);
  EXPECT_GE(result.json()["measured_s"], 3);
  EXPECT_LT(result.json()["measured_s"], 120);
}

// What the server counted while the knee was searched is none of the run's.
TEST_F(LoadRunTest, TheServersMetricsAreThoseOfTheReportedRun) {
  StartServer({.scenes = {"box=builtin:box"}, .metrics_listen = "127.0.0.1:0"});
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--find-knee", "--rate=200", "--slo=p50=10m",
               "--requests=40", "--trial=100ms", "--workload=segments", "--output=json",
               absl::StrCat("--server-metrics=127.0.0.1:", server_->metrics_port())});
  ASSERT_TRUE(result.json().contains("server_metrics")) << result.out << result.err;
  EXPECT_GE(result.json()["knee"]["trials"].size(), 1u);
  const nlohmann::json answered = result.json()["server_metrics"].at(
      "sightline_requests_total{method=\"TestSegments\",result=\"ok\"}");
  EXPECT_EQ(answered["after"].get<double>() - answered["before"].get<double>(),
            result.json()["all"]["answered"].get<double>());
  EXPECT_GT(answered["before"], 0);
}

TEST_F(LoadRunTest, ErrorsAreCountedByCode) {
  // No item can be answered within a nanosecond.
  const RunResult result = RunWith(
      {ServerFlag(), "--scene=box", "--requests=50", "--item-timeout=1ns", "--output=json"});
  EXPECT_GT(result.json()["all"]["failed"], 0) << result.err;
  EXPECT_EQ(result.json()["errors"]["DEADLINE_EXCEEDED"], result.json()["all"]["failed"]);
  EXPECT_EQ(result.json()["all"]["requests"], 50);
}

TEST_F(LoadRunTest, FilesAreWritten) {
  testing_support::TempDir dir;
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--requests=50", "--hgrm", dir.File("a.hgrm"), "--plot",
               dir.File("a.png"), "--output=csv"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, StartsWith("window,seconds,answered,"));
  EXPECT_THAT(*cli::ReadFile(dir.File("a.hgrm")), HasSubstr("Total count    =           50]"));
  EXPECT_THAT(*cli::ReadFile(dir.File("a.png")), StartsWith("\x89PNG"));
}

TEST_F(LoadRunTest, WhatCannotBeReachedOrFoundHasItsExitCode) {
  const RunResult nowhere = RunWith({ServerFlag(), "--scene=scenes/nowhere"});
  EXPECT_EQ(nowhere.code, cli::kExitNoInput);
  EXPECT_THAT(nowhere.err, HasSubstr("scenes/nowhere: sightline scene list"));
  EXPECT_EQ(RunWith({ServerFlag(), "--scene=builtin:nothing"}).code, cli::kExitUsage);
  EXPECT_EQ(RunWith({ServerFlag()}).code, cli::kExitUsage);
  const std::string gone = ServerFlag();
  server_->Shutdown();
  const RunResult unreachable = RunWith({gone, "--scene=box", "--retry=0"});
  EXPECT_EQ(unreachable.code, cli::kExitUnavailable) << unreachable.err;
  EXPECT_EQ(unreachable.out, "");
}

TEST_F(LoadRunTest, AFileThatCannotBeReadIsNoInputAndAFlagThatMakesNoSenseIsUsage) {
  testing_support::TempDir dir;
  const std::string none = dir.File("none"), metrics = "--server-metrics=127.0.0.1:1";
  const auto code = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> args = {ServerFlag(), "--scene=box", "--requests=1"};
    args.insert(args.end(), flags.begin(), flags.end());
    const RunResult result = RunWith(args);
    EXPECT_EQ(result.out, "");
    return result.code;
  };
  EXPECT_EQ(code({"--tls-ca", none}), cli::kExitNoInput);
  EXPECT_EQ(code({"--token-file", none}), cli::kExitNoInput);
  EXPECT_EQ(code({metrics, "--metrics-token-file", none}), cli::kExitNoInput);
  EXPECT_EQ(code({metrics, "--metrics-token-file", dir.path()}), cli::kExitData);
  EXPECT_EQ(code({"--tls-key", none}), cli::kExitUsage);
  EXPECT_EQ(code({"--server-metrics=far.org:9090", "--metrics-token-file", none}), cli::kExitUsage);
}

// The longest run takes ten minutes.
TEST_F(LoadRunTest, PointsAreLeasedForARunOrForAsLongAsTheServerGrants) {
  ServerOptions options{.scenes = {"box=builtin:box"}};
  options.limits.max_lease_seconds = 60;
  StartServer(options);
  const RunResult cut =
      RunWith({ServerFlag(), "--scene=box", "--workload=points", "--requests=20"});
  EXPECT_EQ(cut.code, 0) << cut.err;
  EXPECT_THAT(cut.err, HasSubstr("max_lease = 1m"));
  const RunResult whole = RunWith(
      {ServerFlag(), "--scene=box", "--workload=points", "--requests=20", "--duration=40s"});
  EXPECT_EQ(whole.code, 0) << whole.err;
  EXPECT_THAT(whole.err, Not(HasSubstr("max_lease")));
}

// --timeout is for what comes before the runs: neither their leases nor the end care for it.
TEST_F(LoadRunTest, RunsGoOnAfterTheTimeoutOfThePreparation) {
  // As long as this machine takes to prepare; and the first trial takes twice that.
  for (double timeout = 0.5;; timeout *= 2) {
    std::ostringstream terminal;
    const RunResult result =
        RunWith({ServerFlag(), "--scene=box", "--workload=points", "--find-knee", "--slo=p50=10m",
                 "--requests=2", "--trial=10m", "--arrivals=constant", "--output=json",
                 absl::StrCat("--timeout=", timeout), absl::StrCat("--rate=", 0.5 / timeout)},
                {.terminal = &terminal});
    if (!absl::StrContains(terminal.str(), "trying ") && timeout < 60) continue;
    EXPECT_EQ(result.code, 0) << terminal.str();
    const auto sets = Client().ListPointSets("scenes/box");
    ASSERT_TRUE(sets.ok()) << sets.status();
    EXPECT_TRUE(sets->empty()) << "the test's points are still there";
    return;
  }
}

TEST_F(LoadRunTest, MetricsThatAreNotThereDoNotEndTheRun) {
  // The port speaks gRPC and no HTTP/1.
  const RunResult result = RunWith({ServerFlag(), "--scene=box", "--requests=20", "--output=json",
                                    absl::StrCat("--server-metrics=127.0.0.1:", server_->port())});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_TRUE(result.json().contains("server_metrics_error"));
  EXPECT_THAT(result.err, StartsWith("warning: metrics of http://127.0.0.1:"));
  EXPECT_THAT(result.err, HasSubstr("the run goes on without"));
}

TEST(LoadEmbeddedTest, NoServerIsNeeded) {
  const RunResult result = RunWith({"--scene=builtin:box", "--workload=points", "--requests=100",
                                    "--check=all", "--output=json"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.json()["checked"], 100);
}

}  // namespace
}  // namespace sightline::load
