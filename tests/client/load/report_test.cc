// SPDX-License-Identifier: Apache-2.0
#include "client/load/report.h"

#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::load {
namespace {

using testing::HasSubstr;
using testing::Not;

class ReportTest : public testing::Test {
 protected:
  ReportTest() {
    options_.scene = "builtin:box";
    options_.workload = "mixed";
    options_.mix = {5, 0, 2};
    options_.plan.mode = Mode::kOpen;
    options_.slo = *ParseSlo("p99=20ms,rate=100");
    report_.options = &options_;
    report_.rate = 200;
    report_.server.version = "1.2";
    report_.server.instruction_set = "AVX2";
    report_.server.threads = 4;
    report_.check = {CheckSource::By::kEngine, "builtin:box"};
    Measurement& m = report_.measured;
    m.elapsed = absl::Seconds(10);
    m.window = absl::Seconds(5);
    m.all.requests = 1010;
    m.all.answered = m.all.answered_in_time = 1000;
    m.all.failed = 10;
    m.all.rays_in_time = 5'000'000;
    m.all.planned.Record(absl::Milliseconds(10), 1000);
    m.all.sent.Record(absl::Milliseconds(8), 1000);
    m.by_kind[0] = m.all;
    m.by_kind[2].requests = 5;
    m.errors["RESOURCE_EXHAUSTED QUEUE_FULL"] = 10;
    m.windows.resize(2);
    m.windows[1].answered = 500;
    m.windows[1].planned.Record(absl::Milliseconds(10), 500);
    m.checked = 120;
    report_.stability = JudgeStability(m.windows, 0.1);
    report_.slo = options_.slo.Judge(m);
  }
  std::string Print(const std::string& output) const {
    std::ostringstream out;
    PrintReport(report_, output, out);
    return out.str();
  }
  LoadOptions options_;
  LoadReport report_;
};

TEST_F(ReportTest, JsonHasTheNumbers) {
  report_.knee = Knee{.rate = 150, .missed = 160, .trials = {{.rate = 150, .held = true}}};
  report_.server_metrics["sightline_x"] = {1, 4};
  report_.reloads = ReloadReport{.changes = 3};
  const nlohmann::json json = nlohmann::json::parse(Print("json"));
  EXPECT_TRUE(json["server"]["address"].is_null());
  EXPECT_EQ(json["server"]["version"], "1.2");
  EXPECT_EQ(json["server"]["threads"], 4);
  EXPECT_EQ(json["mode"], "open");
  EXPECT_EQ(json["rate_per_s"], 200);
  EXPECT_EQ(json["all"]["requests"], 1010);
  EXPECT_EQ(json["all"]["answers_per_s"], 100);
  EXPECT_EQ(json["all"]["rays_per_s"], 500'000);
  EXPECT_EQ(json["all"]["latency_planned_ms"]["p99.99"], 10);
  EXPECT_EQ(json["all"]["latency_sent_ms"]["p50"], 8);
  EXPECT_EQ(json["errors"]["RESOURCE_EXHAUSTED QUEUE_FULL"], 10);
  EXPECT_TRUE(json["by_kind"].contains("segments"));
  EXPECT_FALSE(json["by_kind"].contains("points"));
  EXPECT_EQ(json["stable"], false);
  EXPECT_TRUE(json["rate_spread"].is_null());  // Two windows are not enough to say.
  EXPECT_EQ(json["slo_held"], false);          // Ten errors, and none was allowed.
  EXPECT_EQ(json["slo"][0]["clause"], "p99");
  EXPECT_EQ(json["slo"][0]["unit"], "ms");
  EXPECT_EQ(json["slo"][0]["limit"], 20);
  EXPECT_EQ(json["slo"][0]["held"], true);
  EXPECT_EQ(json["knee"]["rate_per_s"], 150);
  EXPECT_EQ(json["server_metrics"]["sightline_x"]["after"], 4);
  EXPECT_EQ(json["edits"], 3);
}

TEST_F(ReportTest, JsonHoldsWhateverBytesThereAre) {
  options_.scene =
      "stra\xdf"
      "e.obj";
  report_.server_metrics["x{name=\"\xff\"}"] = {1, 4};
  const nlohmann::json json = nlohmann::json::parse(Print("json"));
  EXPECT_EQ(json["scene"],
            "stra\xef\xbf\xbd"
            "e.obj");
  EXPECT_EQ(json["all"]["requests"], 1010);
}

TEST_F(ReportTest, CsvHasALinePerWindowAndOneForAll) {
  Measurement& m = report_.measured;
  m.windows[1].sent.Record(absl::Milliseconds(8), 500);
  m.windows[1].bytes_received = 700;
  m.windows[1].bytes_sent = 30;
  m.windows[0].failed = 10;
  m.windows[0].failed_by_code[8] = 7;
  m.windows[0].failed_by_code[16] = 3;
  m.all.bytes_received_in_time = 1400;
  m.all.bytes_sent_in_time = 60;
  m.failed_by_code[1] = 2;
  m.failed_by_code[8] = 8;
  const std::vector<std::string> lines = absl::StrSplit(Print("csv"), '\n', absl::SkipEmpty());
  ASSERT_EQ(lines.size(), 4u);
  // Scripts read it: columns may be added behind the last, and nothing else.
  EXPECT_EQ(lines[0],
            "window,seconds,answered,failed,rays,"
            "p50_ms,p90_ms,p95_ms,p99_ms,p99.9_ms,p99.99_ms,max_ms,mean_ms,"
            "sent_p50_ms,sent_p90_ms,sent_p95_ms,sent_p99_ms,sent_p99.9_ms,sent_p99.99_ms,"
            "sent_max_ms,sent_mean_ms,bytes_received,bytes_sent,"
            "failed_cancelled,failed_unknown,failed_invalid_argument,failed_deadline_exceeded,"
            "failed_not_found,failed_already_exists,failed_permission_denied,"
            "failed_resource_exhausted,failed_failed_precondition,failed_aborted,"
            "failed_out_of_range,failed_unimplemented,failed_internal,failed_unavailable,"
            "failed_data_loss,failed_unauthenticated");
  EXPECT_EQ(lines[1],
            "0,5,0,10,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,7,0,0,0,0,0,0,0,3");
  EXPECT_EQ(lines[2],
            "1,5,500,0,0,10,10,10,10,10,10,10,10,8,8,8,8,8,8,8,8,700,30,"
            "0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0");
  EXPECT_EQ(lines[3],
            "all,10,1000,10,5000000,10,10,10,10,10,10,10,10,8,8,8,8,8,8,8,8,1400,60,"
            "2,0,0,0,0,0,0,8,0,0,0,0,0,0,0,0");
}

TEST_F(ReportTest, TextSaysWhatWentWrong) {
  report_.measured.wrong = 2;
  report_.measured.first_wrong = "request 7: flags[3] is 1 where 0 is due";
  report_.server_metrics_error = "HTTP status 500";
  const std::string text = Print("text");
  for (const char* words :
       {"in this process, version 1.2, AVX2, 4 threads", "open loop, constant, 200/s",
        "mixed: tiles 5, segments 2", "10 RESOURCE_EXHAUSTED",
        "120 answers, 2 wrong; by the engine in this process on builtin:box", "flags[3]",
        "p99 10 ms of 20 ms: held", "errors 0.99 % of 0 %: MISSED", "from the plan",
        "from the send", "HTTP status 500"}) {
    EXPECT_THAT(text, HasSubstr(words));
  }
  EXPECT_THAT(text, Not(HasSubstr("points, plan")));
  EXPECT_THAT(text, Not(HasSubstr("given up")));
  EXPECT_THAT(text, Not(HasSubstr("never sent")));
  report_.measured.all.unsent = 4;
  report_.measured.all.planned.Record(absl::Seconds(3), 7);
  EXPECT_THAT(Print("text"), HasSubstr("10 failed, of them 4 never sent\n"));
  EXPECT_THAT(Print("text"), testing::ContainsRegex("given up +7 of them"));
  EXPECT_EQ(nlohmann::json::parse(Print("json"))["all"]["given_up"], 7);
  options_.plan.warm_up = absl::Seconds(1);
  EXPECT_THAT(Print("text"), HasSubstr("120 answers, the warm-up's too, 2 wrong; "));
  options_.plan.warm_up = absl::ZeroDuration();
  report_.check = {CheckSource::By::kServer, "SINGLE"};
  EXPECT_THAT(Print("text"), HasSubstr("2 wrong; by the server itself with SINGLE\n"));
  report_.check = {};
  EXPECT_THAT(Print("text"), HasSubstr("nothing (--check none)\n"));
}

TEST_F(ReportTest, AClosedLoopSaysHowLongRefusalsHeldItBack) {
  EXPECT_FALSE(nlohmann::json::parse(Print("json")).contains("refusal_waits"));
  options_.plan.mode = Mode::kClosed;
  options_.plan.concurrency = 64;
  EXPECT_THAT(Print("text"), Not(HasSubstr("held back")));
  EXPECT_EQ(nlohmann::json::parse(Print("json"))["refusal_waits"]["count"], 0);
  report_.measured.refusal_waits = 1200;
  report_.measured.refusal_wait = absl::Seconds(160);
  EXPECT_THAT(Print("text"),
              testing::ContainsRegex("held back +1,200 times after a refusal, 160.00 s together, "
                                     "25.0 % of the loop's time\n"));
  const nlohmann::json waits = nlohmann::json::parse(Print("json"))["refusal_waits"];
  EXPECT_EQ(waits["count"], 1200);
  EXPECT_EQ(waits["total_s"], 160);
}

TEST_F(ReportTest, AKneeSaysWhichRunsWereWhole) {
  report_.knee = Knee{.rate = 90,
                      .missed = 100,
                      .trials = {{.rate = 100, .held = true},
                                 {.rate = 100, .whole = true},
                                 {.rate = 90, .held = true, .whole = true}}};
  const std::string found = Print("text");
  EXPECT_THAT(found, testing::ContainsRegex("\n100 .*  held\n100 .*  missed, in full\n"
                                            "90 .*  held, in full\n"));
  EXPECT_THAT(found, HasSubstr("knee: 90 requests/s meet the objective, 100 do not\n"));
  report_.knee->rate = 0;
  EXPECT_THAT(Print("text"), HasSubstr("no rate met the objective in full\n"));
  report_.knee->trials.resize(1);
  EXPECT_THAT(Print("text"), HasSubstr("no rate met the objective\n"));
  // The run in full was broken off.
  report_.knee->rate = 100;
  EXPECT_THAT(Print("text"), HasSubstr("knee, by trials alone: 100 requests/s meet"));
}

TEST_F(ReportTest, RatesAreWrittenOutInFull) {
  report_.rate = 20'000;
  report_.knee = Knee{.rate = 12'345.6, .trials = {{.rate = 12'345.6, .answered = 23'456.7}}};
  report_.measured.elapsed = absl::Milliseconds(10);
  const std::string text = Print("text");
  EXPECT_THAT(text, HasSubstr("open loop, constant, 20000/s"));
  EXPECT_THAT(text, testing::ContainsRegex("answers/s +100000\n"));
  EXPECT_THAT(text, testing::ContainsRegex("\n12346 +23457 .*missed\n"));
  EXPECT_THAT(text, HasSubstr("12346 requests/s meet"));
}

TEST_F(ReportTest, SumsAndCountsOfMetricsBecomeMeans) {
  report_.server_metrics["x_seconds_count{method=\"A\"}"] = {10, 30};
  report_.server_metrics["x_seconds_sum{method=\"A\"}"] = {1, 6};
  report_.server_metrics["y_total"] = {1, 4};
  const std::string text = Print("text");
  EXPECT_THAT(text, testing::ContainsRegex("x_seconds.method=.A.. +.20, mean 250 ms\n"));
  EXPECT_THAT(text, testing::ContainsRegex("y_total +.3, now 4\n"));
  report_.server_metrics = {{"many", {5, 1'047'065}},
                            {"less", {2e7 + 0.5, 5e6}},
                            {"share", {0, 0.0000125}},
                            {"rays_count", {1, 3}},
                            {"rays_sum", {0, 5}}};
  EXPECT_THAT(Print("text"), testing::ContainsRegex("many +.1,047,060, now 1,047,065\n"));
  EXPECT_THAT(Print("text"), testing::ContainsRegex("less +-15.0 M, now 5,000,000\n"));
  EXPECT_THAT(Print("text"), testing::ContainsRegex("share +.0.0000125, now 0.0000125\n"));
  EXPECT_THAT(Print("text"), testing::ContainsRegex("rays +.2, mean 2.5\n"));
  EXPECT_THAT(text, Not(HasSubstr("_sum")));
}

TEST_F(ReportTest, ManyMetricsAreCutShortForPeople) {
  for (int i = 0; i < 100; ++i) report_.server_metrics["m" + std::to_string(i)] = {0, 1};
  EXPECT_THAT(Print("text"), HasSubstr("more: --output json has all"));
  EXPECT_EQ(nlohmann::json::parse(Print("json"))["server_metrics"].size(), 100u);
}

}  // namespace
}  // namespace sightline::load
