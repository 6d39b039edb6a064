// SPDX-License-Identifier: Apache-2.0
//
// sightline-load interrupted at each of its steps, in the test's own process: what is given up,
// what is reported, and what is left on the server.
#include <atomic>
#include <cmath>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "client/cli/exit_code.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/load/load_fixture.h"
#include "tests/support/watched_stream.h"

namespace sightline::load {
namespace {

using testing::HasSubstr;
using testing::Not;

// Interrupts whatever goes on once a live line begins with a title, or a whole line says, what the
// test waits for: in the thread that writes it, so that nothing comes between.
class InterruptingTerminal : public testing_support::WatchedStream {
 public:
  using Wanted = std::function<bool(const std::string& line)>;
  explicit InterruptingTerminal(Wanted wanted) : wanted_(std::move(wanted)) {}
  // All of it. Not before the run is over.
  const std::string& text() const { return text_; }

  std::atomic<bool> interrupted = false;

 private:
  // By the monitor's thread while a run lasts, by the test's before and between runs.
  void OnWrite(std::string_view bytes) override {
    text_.append(bytes);
    if (text_.back() == '\n') {
      const size_t before = text_.rfind('\n', text_.size() - 2);
      if (wanted_(text_.substr(before == std::string::npos ? 0 : before + 1))) interrupted = true;
    }
    const size_t line = text_.rfind('\r');
    const size_t title = line == std::string::npos ? line : text_.find("/s  ", line);
    if (title != std::string::npos && wanted_(text_.substr(line + 1, title - line - 1))) {
      interrupted = true;
    }
  }
  const Wanted wanted_;
  std::string text_;
};

TEST_F(LoadRunTest, AnInterruptedSearchReportsItsTrials) {
  // No rate meets the objective: each is tried twice, then half of it, so that trials, of two
  // requests each, soon take seconds.
  constexpr double kSlow = 7;
  InterruptingTerminal terminal([](const std::string& title) {
    double rate = 0;
    return absl::StartsWith(title, "trying ") && absl::SimpleAtod(title.substr(7), &rate) &&
           rate < kSlow;
  });
  const RunResult result = RunWith(
      {ServerFlag(), "--scene=box", "--find-knee", "--rate=200", "--slo=p50=1ns", "--requests=2",
       "--trial=10m", "--workload=segments", "--arrivals=constant", "--output=json"},
      {&terminal.interrupted, &terminal.stream});
  EXPECT_EQ(result.code, cli::kExitTemporary) << terminal.text();
  EXPECT_THAT(terminal.text(), HasSubstr("sightline-load: interrupted while the knee was searched: "
                                         "the report has the trials made by then\n"));
  const nlohmann::json json = result.json();
  EXPECT_EQ(json["interrupted"], true);
  EXPECT_EQ(json["knee"]["rate_per_s"], 0);
  // 200 to 12.5, twice each, and then as many as passed unseen; none that was cut short.
  const nlohmann::json trials = json["knee"]["trials"];
  ASSERT_GE(trials.size(), 10u);
  for (size_t i = 0; i < trials.size(); ++i) {
    EXPECT_EQ(trials[i]["rate_per_s"], 200 / std::pow(2, i / 2)) << i;
    EXPECT_EQ(trials[i]["held"], false);
  }
  EXPECT_LT(trials.back()["rate_per_s"], 2 * kSlow);
  EXPECT_EQ(json["all"]["requests"], 0) << "a trial is no run";
}

TEST_F(LoadRunTest, ATrialThatWasCutShortSaysNothingOfItsRate) {
  InterruptingTerminal terminal(
      [](const std::string& line) { return absl::StartsWith(line, "trying "); });
  const RunResult result =
      RunWith({ServerFlag(), "--scene=box", "--find-knee", "--rate=200", "--slo=p50=10m",
               "--trial=10m", "--workload=segments", "--output=json"},
              {&terminal.interrupted, &terminal.stream});
  EXPECT_EQ(result.code, cli::kExitTemporary) << terminal.text();
  EXPECT_TRUE(result.json()["knee"]["trials"].empty());
}

TEST_F(LoadRunTest, AnInterruptedRunAtTheKneeIsNoKnee) {
  InterruptingTerminal terminal(
      [](const std::string& line) { return !line.empty() && absl::ascii_isdigit(line[0]); });
  // The run in full would take ten minutes.
  const RunResult result = RunWith({ServerFlag(), "--scene=box", "--find-knee", "--rate=200",
                                    "--slo=p50=10m", "--trial=100ms", "--workload=tiles"},
                                   {&terminal.interrupted, &terminal.stream});
  EXPECT_EQ(result.code, cli::kExitTemporary) << terminal.text();
  EXPECT_THAT(terminal.text(), HasSubstr("interrupted while the knee was measured"));
  EXPECT_THAT(result.out, HasSubstr(" s after 0.00 s of warm-up: interrupted\n"));
  EXPECT_THAT(result.out, HasSubstr("interrupted before the knee was known; by then trials of "));
}

// Each step of the preparation is heard to begin, and the next one is not: it was given up before
// it was done.
TEST_F(LoadRunTest, APreparationIsGivenUpInWhicheverStep) {
  const std::vector<std::string> steps = {"connecting to ",
                                          "opening builtin:", "finding what is due",
                                          "keeping points", "opening streams"};
  for (size_t i = 0; i < steps.size(); ++i) {
    InterruptingTerminal terminal(
        [&](const std::string& line) { return absl::StartsWith(line, steps[i]); });
    const RunResult result = RunWith({ServerFlag(), "--scene=builtin:box", "--workload=points"},
                                     {&terminal.interrupted, &terminal.stream});
    EXPECT_EQ(result.code, cli::kExitTemporary) << terminal.text();
    EXPECT_EQ(result.out, "");
    EXPECT_THAT(terminal.text(), HasSubstr("sightline-load: interrupted before the first request: "
                                           "there is nothing to report\n"));
    if (i + 1 < steps.size()) {
      EXPECT_THAT(terminal.text(), Not(HasSubstr(steps[i + 1])));
    }
    EXPECT_EQ(Scenes().size(), 1u) << "of the test's own: " << terminal.text();
  }
}

// The same of what the server is asked where nobody here has the triangles, and of an embedded one.
TEST_F(LoadRunTest, OtherWaysToPrepareAreGivenUp) {
  const std::vector<double> corners = {-4, -4, 0, 4, -4, 0, 4, 4, 0, -4, 4, 0};
  const std::vector<uint32_t> wall = {0, 1, 2, 0, 2, 3};
  client::SceneSource source{.scene_id = "uploaded"};
  source.objects.push_back({.name = "wall", .vertices = corners, .indices = wall});
  ASSERT_TRUE(Client().CreateScene(source).ok());
  const std::pair<std::vector<std::string>, std::string> ways[] = {
      {{ServerFlag(), "--scene=uploaded"}, "asking the server what is due"},
      {{"--scene=builtin:box"}, "starting a server"},
      {{"--scene=builtin:box"}, "opening builtin:"},
      {{"--scene=builtin:box"}, "finding what is due"},
      {{"--scene=builtin:box", "--reload-every=5"}, "finding what is due"}};
  for (const auto& [args, step] : ways) {
    InterruptingTerminal terminal(
        [&step = step](const std::string& line) { return absl::StartsWith(line, step); });
    const RunResult result = RunWith(args, {&terminal.interrupted, &terminal.stream});
    EXPECT_EQ(result.code, cli::kExitTemporary) << terminal.text();
    EXPECT_THAT(terminal.text(), HasSubstr("interrupted before the first request"));
    EXPECT_THAT(terminal.text(), Not(HasSubstr("keeping points")));
  }
}

TEST(LoadEmbeddedTest, AnInterruptedRunIsReported) {
  InterruptingTerminal terminal([](const std::string& line) { return line == "200"; });
  const RunResult result =
      RunWith({"--scene=builtin:box", "--workload=segments", "--rate=200", "--output=json"},
              {&terminal.interrupted, &terminal.stream});
  ASSERT_EQ(result.code, 0) << terminal.text();
  EXPECT_EQ(result.json()["interrupted"], true);
  const nlohmann::json all = result.json()["all"];
  EXPECT_EQ(all["answered"], all["requests"]);
  EXPECT_LT(result.json()["measured_s"], 600);
}

}  // namespace
}  // namespace sightline::load
