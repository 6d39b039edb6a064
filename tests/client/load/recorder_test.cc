// SPDX-License-Identifier: Apache-2.0
#include "client/load/recorder.h"

#include <gtest/gtest.h>

#include "absl/strings/cord.h"
#include "client/lib/status.h"
#include "sightline/v1/status.pb.h"

namespace sightline::load {
namespace {

const absl::Time kStart = absl::UnixEpoch() + absl::Hours(1);

absl::Time At(double seconds) { return kStart + absl::Seconds(seconds); }

Outcome Answer(double planned, double sent, double received) {
  return {.request = {.work = {.kind = Kind::kPoints}, .planned = At(planned)},
          .sent = At(sent),
          .received = At(received),
          .rays = 100,
          .bytes_sent = 7,
          .bytes_received = 50};
}

TEST(RecorderTest, BothLatenciesAreKept) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  recorder.Add(Answer(1, 3, 4));
  const Measurement m = recorder.Result(At(20));
  for (const LatencyHistogram* planned : {&m.all.planned, &m.windows[4].planned}) {
    EXPECT_EQ(planned->max(), absl::Seconds(3));
  }
  for (const LatencyHistogram* sent : {&m.all.sent, &m.windows[4].sent}) {
    EXPECT_EQ(sent->max(), absl::Seconds(1));
  }
  EXPECT_EQ(m.by_kind[static_cast<size_t>(Kind::kPoints)].answered, 1u);
  EXPECT_EQ(m.by_kind[static_cast<size_t>(Kind::kTiles)].requests, 0u);
  EXPECT_EQ(m.elapsed, absl::Seconds(10));
}

TEST(RecorderTest, RequestsCountByTheirPlanAndRatesByTheirAnswers) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  recorder.Add(Answer(-1, -1, 0.5));  // Of the warm-up, answered within the interval.
  recorder.Add(Answer(1, 1, 2));
  recorder.Add(Answer(9, 9, 11));    // Answered too late for the rate.
  recorder.Add(Answer(-3, -3, -2));  // Neither.
  const Measurement m = recorder.Result(At(20));
  EXPECT_EQ(m.all.requests, 2u);
  EXPECT_EQ(m.all.answered, 2u);
  EXPECT_EQ(m.all.planned.count(), 2u);
  EXPECT_EQ(m.all.answered_in_time, 2u);
  EXPECT_EQ(m.all.rays_in_time, 200u);
  EXPECT_EQ(m.all.bytes_received_in_time, 100u);
  EXPECT_EQ(m.Rate(), 0.2);
  ASSERT_EQ(m.windows.size(), 10u);
  EXPECT_EQ(m.windows[0].answered, 1u);
  EXPECT_EQ(m.windows[2].answered, 1u);
  EXPECT_EQ(m.windows[2].bytes_received, 50u);
  EXPECT_EQ(m.windows[2].bytes_sent, 7u);
  EXPECT_EQ(m.windows[9].answered, 0u);
}

TEST(RecorderTest, FailuresHaveACodeAndNoLatency) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  Outcome failed = Answer(1, 1, 2);
  failed.status = absl::ResourceExhaustedError("full");
  v1::ErrorInfo info;
  info.set_reason("QUEUE_FULL");
  failed.status.SetPayload(client::kErrorInfoUrl, absl::Cord(info.SerializeAsString()));
  recorder.Add(failed);
  failed.status = absl::CancelledError("");
  recorder.Add(failed);
  recorder.Add(Answer(1, 1, 1.5));
  const Measurement m = recorder.Result(At(20));
  EXPECT_EQ(m.all.failed, 2u);
  EXPECT_EQ(m.all.answered, 1u);
  EXPECT_EQ(m.all.planned.count(), 1u);
  EXPECT_EQ(m.errors.at("RESOURCE_EXHAUSTED QUEUE_FULL"), 1u);
  EXPECT_EQ(m.errors.at("CANCELLED"), 1u);
  EXPECT_DOUBLE_EQ(m.ErrorShare(), 2.0 / 3);
  EXPECT_EQ(m.windows[2].failed, 2u);
  for (const CodeCounts* codes : {&m.failed_by_code, &m.windows[2].failed_by_code}) {
    EXPECT_EQ((*codes)[static_cast<size_t>(absl::StatusCode::kResourceExhausted)], 1u);
    EXPECT_EQ((*codes)[static_cast<size_t>(absl::StatusCode::kCancelled)], 1u);
    EXPECT_EQ((*codes)[static_cast<size_t>(absl::StatusCode::kUnknown)], 0u);
  }
}

TEST(RecorderTest, WhatTheRunGaveUpOnHasWaitedAtLeastThatLong) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  Outcome outcome = Answer(4, 5, 12);
  outcome.status = absl::CancelledError("");
  recorder.Add(outcome);  // By the server: that says nothing about how long an answer takes.
  outcome.given_up = true;
  recorder.Add(outcome);
  outcome.sent = absl::InfiniteFuture();
  outcome.request.planned = At(3);
  recorder.Add(outcome);
  recorder.Add(Answer(1, 1, 1.5));
  const Measurement m = recorder.Result(At(20));
  EXPECT_EQ(m.all.failed, 3u);
  EXPECT_EQ(m.all.unsent, 1u);
  EXPECT_EQ(m.all.planned.count(), 3u);
  EXPECT_EQ(m.all.planned.max(), absl::Seconds(9));
  EXPECT_EQ(m.all.sent.count(), 1u);
}

TEST(RecorderTest, AShortRunEndsWhenItIsAskedFor) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  recorder.Add(Answer(0, 0, 0.1));
  const Measurement m = recorder.Result(At(2.5));
  EXPECT_EQ(m.elapsed, absl::Seconds(2.5));
  EXPECT_EQ(m.windows.size(), 2u);
  EXPECT_EQ(recorder.Result(At(-1)).elapsed, absl::ZeroDuration());
}

TEST(RecorderTest, WrongAnswersAreCountedAndTheFirstIsKept) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  Outcome outcome = Answer(1, 1, 2);
  outcome.verdict = Verdict::kEqual;
  recorder.Add(outcome);
  outcome.verdict = Verdict::kWrong;
  outcome.difference = "pixel 3";
  recorder.Add(outcome);
  outcome.difference = "pixel 4";
  outcome.request.planned = At(-1);  // In the warm-up a wrong answer is as wrong.
  recorder.Add(outcome);
  const Measurement m = recorder.Result(At(20));
  EXPECT_EQ(m.checked, 3u);
  EXPECT_EQ(m.wrong, 2u);
  EXPECT_EQ(m.first_wrong, "pixel 3");
}

TEST(RecorderTest, WaitsAfterRefusalsCountWithinTheInterval) {
  Recorder recorder(absl::Seconds(1));
  recorder.Begin(At(0), At(10));
  recorder.AddRefusalWait(At(-3), At(-1));
  recorder.AddRefusalWait(At(-3), At(1));
  recorder.AddRefusalWait(At(2), At(2.5));
  recorder.AddRefusalWait(At(9), At(12));
  recorder.AddRefusalWait(At(11), At(12));
  const Measurement m = recorder.Result(At(20));
  EXPECT_EQ(m.refusal_waits, 3u);
  EXPECT_EQ(m.refusal_wait, absl::Seconds(2.5));
}

TEST(RecorderTest, WindowsAreBounded) {
  Recorder recorder(absl::Milliseconds(1));
  recorder.Begin(At(0), At(3600));
  recorder.Add(Answer(3000, 3000, 3001));
  const Measurement m = recorder.Result(At(4000));
  EXPECT_EQ(m.windows.size(), Recorder::kMaxWindows);
  EXPECT_EQ(m.all.answered, 1u);
}

}  // namespace
}  // namespace sightline::load
