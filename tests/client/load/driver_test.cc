// SPDX-License-Identifier: Apache-2.0
#include "client/load/driver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/cord.h"
#include "client/lib/status.h"
#include "sightline/v1/status.pb.h"
#include "tests/client/load/fake_target.h"
#include "tests/client/load/manual_clock.h"

namespace sightline::load {
namespace {

Work AnyWork(uint64_t number) { return {.kind = Kind::kTiles, .item = number}; }

// An open loop against a target that lives by the clock that the pacer moves.
struct OpenLoop {
  explicit OpenLoop(absl::Duration service) : target(clock, service) {
    clock.SetOnWait([this](absl::Time time) { target.AnswerUntil(time); });
  }
  Measurement Run(const RunPlan& plan) {
    Recorder recorder(absl::Seconds(1));
    Driver driver(plan, clock, target, recorder, AnyWork);
    EXPECT_TRUE(driver.Run().ok());
    return recorder.Result(absl::InfiniteFuture());
  }
  ManualClock clock;
  FakeTarget target;
};

TEST(DriverTest, AnOpenLoopSendsWhatIsDueAndCountsFromThePlan) {
  // 100 a second, each served in 4 ms: no waiting at all.
  OpenLoop loop(absl::Milliseconds(4));
  const Measurement measured = loop.Run({.mode = Mode::kOpen,
                                         .rate = 100,
                                         .warm_up = absl::Seconds(1),
                                         .duration = absl::Seconds(3),
                                         .drain = absl::ZeroDuration()});
  EXPECT_EQ(measured.all.requests, 300u);
  EXPECT_EQ(measured.all.answered, 300u);
  EXPECT_EQ(measured.all.planned.max(), absl::Milliseconds(4));
  EXPECT_EQ(measured.all.sent.max(), absl::Milliseconds(4));
  ASSERT_EQ(measured.windows.size(), 3u);
  EXPECT_NEAR(static_cast<double>(measured.windows[1].answered), 100, 1);
  EXPECT_EQ(measured.elapsed, absl::Seconds(3));
}

// Though nothing more is due, and nothing is waited for after the run.
TEST(DriverTest, WhatIsUnansweredHasTheRestOfTheTime) {
  OpenLoop loop(absl::Milliseconds(100));
  RunPlan plan{.mode = Mode::kOpen,
               .rate = 1,
               .duration = absl::Seconds(1.5),
               .drain = absl::ZeroDuration()};
  const Measurement measured = loop.Run(plan);
  EXPECT_EQ(measured.all.answered, 2u);
  EXPECT_EQ(measured.all.failed, 0u);
  OpenLoop slow(absl::Milliseconds(600));
  const Measurement given_up = slow.Run(plan);
  EXPECT_EQ(given_up.all.answered, 1u);
  EXPECT_EQ(given_up.all.failed, 1u);
  EXPECT_EQ(given_up.errors.at("CANCELLED"), 1u);
  // It waited until the end of the run.
  EXPECT_EQ(given_up.all.planned.min(), absl::Milliseconds(500));
}

TEST(DriverTest, AnOverloadedOpenLoopShowsTheWaitingInThePlannedLatencyAlone) {
  // 100 a second, each served in 20 ms, no more than one under way: half of it is never caught up.
  OpenLoop loop(absl::Milliseconds(20));
  const Measurement measured = loop.Run({.mode = Mode::kOpen,
                                         .rate = 100,
                                         .duration = absl::Seconds(2),
                                         .drain = absl::ZeroDuration()});
  EXPECT_EQ(measured.all.requests, 200u);
  EXPECT_NEAR(measured.Rate(), 50, 1);
  EXPECT_NEAR(absl::ToDoubleSeconds(measured.all.planned.max()), 1, 0.05);
  EXPECT_GT(measured.all.failed, 90u);
}

TEST(DriverTest, APoissonLoopPlansByItsSeed) {
  OpenLoop loop(absl::Microseconds(1));
  const RunPlan plan{.mode = Mode::kOpen,
                     .arrivals = Arrivals::kPoisson,
                     .rate = 1000,
                     .seed = 5,
                     .duration = absl::Seconds(1),
                     .drain = absl::ZeroDuration()};
  loop.Run(plan);
  const std::vector<Request> requests = loop.target.requests();
  ASSERT_GT(requests.size(), 800u);
  ArrivalSchedule arrivals(Arrivals::kPoisson, 1000, 5);
  const absl::Time start = requests[0].planned - arrivals.Next();
  for (size_t i = 1; i < requests.size(); ++i) {
    ASSERT_EQ(requests[i].planned - start, arrivals.Next()) << i;
    ASSERT_EQ(requests[i].number, i);
  }
}

TEST(DriverTest, AClosedLoopKeepsItsConcurrencyAndItsCount) {
  ManualClock clock;
  FakeTarget target(clock, absl::Milliseconds(1));
  target.Serve();
  Recorder recorder(absl::Seconds(1));
  const RunPlan plan{
      .mode = Mode::kClosed, .concurrency = 4, .duration = absl::Hours(1), .max_requests = 1000};
  Driver driver(plan, clock, target, recorder, AnyWork);
  ASSERT_TRUE(driver.Run().ok());
  target.StopServing();
  const Measurement measured = recorder.Result(driver.end());
  EXPECT_EQ(measured.all.requests, 1000u);
  EXPECT_EQ(measured.all.answered, 1000u);
  EXPECT_EQ(target.most_at_once(), 4u);
  EXPECT_NEAR(measured.Rate(), 1000, 10);
  EXPECT_NEAR(absl::ToDoubleMilliseconds(measured.all.planned.PercentileOf(50)), 4, 0.1);
}

TEST(DriverTest, AClosedLoopEndsWithItsTime) {
  ManualClock clock;
  FakeTarget target(clock, absl::Milliseconds(10));
  target.Serve();
  Recorder recorder(absl::Seconds(1));
  const RunPlan plan{.mode = Mode::kClosed,
                     .concurrency = 2,
                     .warm_up = absl::Seconds(1),
                     .duration = absl::Seconds(2)};
  Driver driver(plan, clock, target, recorder, AnyWork);
  ASSERT_TRUE(driver.Run().ok());
  target.StopServing();
  const Measurement measured = recorder.Result(driver.end());
  EXPECT_NEAR(static_cast<double>(measured.all.requests), 200, 2);
  EXPECT_EQ(measured.elapsed, absl::Seconds(2));
  EXPECT_EQ(measured.windows.size(), 2u);
}

TEST(DriverTest, NoMoreThanTheBoundIsUnanswered) {
  ManualClock clock;
  FakeTarget target(clock, absl::Milliseconds(20));
  clock.SetOnWait([&](absl::Time time) { target.AnswerUntil(time); });
  Recorder recorder(absl::Seconds(1));
  const RunPlan plan{.mode = Mode::kOpen,
                     .rate = 1000,
                     .duration = absl::Seconds(1),
                     .max_outstanding = 8,
                     .drain = absl::ZeroDuration()};
  // While the bound holds requests back nobody waits for the clock: it is moved on from here.
  std::thread time([&] {
    while (clock.Now() < absl::UnixEpoch() + absl::Seconds(2)) {
      clock.WaitUntil(clock.Now() + absl::Milliseconds(1));
      std::this_thread::yield();
    }
  });
  Driver driver(plan, clock, target, recorder, AnyWork);
  EXPECT_TRUE(driver.Run().ok());
  time.join();
  EXPECT_LE(target.most_at_once(), 8u);
}

// A server that answers nothing: what the bound keeps back was due as much as what went out.
TEST(DriverTest, WhatCouldNotBeSentIsCountedWithWhatItWaited) {
  for (const bool stop : {false, true}) {
    ManualClock clock;
    FakeTarget target(clock, absl::Hours(1));
    Recorder recorder(absl::Seconds(1));
    const RunPlan plan{.mode = Mode::kOpen,
                       .rate = 100,
                       .warm_up = absl::Seconds(1),
                       .duration = absl::Seconds(4),
                       .max_outstanding = 150,
                       .drain = absl::Seconds(2)};
    Driver driver(plan, clock, target, recorder, AnyWork);
    const absl::Duration end = stop ? absl::Seconds(3) : absl::Seconds(5);
    std::atomic<bool> over = false;
    std::thread time([&] {
      while (clock.Now() < absl::UnixEpoch() + end) {
        clock.WaitUntil(clock.Now() + absl::Milliseconds(1));
        std::this_thread::yield();
      }
      if (stop) driver.Stop();
      while (!over) {
        clock.WaitUntil(clock.Now() + absl::Milliseconds(1));
        std::this_thread::yield();
      }
    });
    EXPECT_TRUE(driver.Run().ok());
    over = true;
    time.join();
    const Measurement measured = recorder.Result(absl::InfiniteFuture());
    EXPECT_EQ(target.requests().size(), 150u);
    // 100 of those that went out are of the warm-up.
    EXPECT_EQ(measured.all.requests, measured.all.failed);
    EXPECT_EQ(measured.all.requests - measured.all.unsent, 50u);
    EXPECT_EQ(measured.errors.at("CANCELLED"), measured.all.failed);
    EXPECT_EQ(measured.all.planned.count(), measured.all.requests);
    EXPECT_EQ(measured.all.sent.count(), 0u);
    EXPECT_EQ(measured.all.requests, stop ? 200u : 400u);
    // The last one was due 10 ms before the end, and waited while there was time to drain; the
    // first that was kept back was due after a second and a half.
    EXPECT_GE(measured.all.planned.min(), absl::Seconds(2));
    EXPECT_GE(measured.all.planned.max(), end - absl::Seconds(1.5) + absl::Seconds(2));
  }
}

// Answers at once. At the 50th request a second passes, in which as many are due as a second has,
// and the run is stopped.
class StoppingTarget final : public Target {
 public:
  StoppingTarget(ManualClock& clock, std::function<void()> stop)
      : clock_(clock), stop_(std::move(stop)) {}
  void SetOnDone(OnDone on_done) override { on_done_ = std::move(on_done); }
  void Send(const Request& request) override {
    const absl::Time sent = clock_.Now();
    if (request.number == 50) {
      clock_.Advance(absl::Seconds(1));
      stop_();
    }
    on_done_({.request = request, .sent = sent, .received = clock_.Now()});
  }
  void CancelAll() override {}
  absl::Status status() const override { return absl::OkStatus(); }

 private:
  ManualClock& clock_;
  const std::function<void()> stop_;
  OnDone on_done_;
};

TEST(DriverTest, WhatIsDueWhenARunIsStoppedIsStillSent) {
  ManualClock clock;
  Driver* running = nullptr;
  StoppingTarget target(clock, [&] { running->Stop(); });
  Recorder recorder(absl::Seconds(1));
  Driver driver({.mode = Mode::kOpen, .rate = 100, .duration = absl::Hours(1)}, clock, target,
                recorder, AnyWork);
  running = &driver;
  EXPECT_TRUE(driver.Run().ok());
  const Measurement measured = recorder.Result(driver.end());
  EXPECT_NEAR(static_cast<double>(measured.all.requests), 150, 1);
  EXPECT_EQ(measured.all.answered, measured.all.requests);
  EXPECT_NEAR(absl::ToDoubleSeconds(measured.elapsed), 1.5, 0.02);
}

// Says at once what `reply` says of a request. No time passes.
class RefusingTarget final : public Target {
 public:
  using Reply = std::function<absl::Status(const Request&)>;
  RefusingTarget(ManualClock& clock, Reply reply) : clock_(clock), reply_(std::move(reply)) {}
  void SetOnDone(OnDone on_done) override { on_done_ = std::move(on_done); }
  void Send(const Request& request) override {
    requests_.push_back(request);
    const absl::Time now = clock_.Now();
    on_done_({.request = request, .sent = now, .received = now, .status = reply_(request)});
  }
  void CancelAll() override {}
  absl::Status status() const override { return status_; }
  void Fail(absl::Status status) { status_ = std::move(status); }
  // In the order in which they came.
  const std::vector<Request>& requests() const { return requests_; }

 private:
  ManualClock& clock_;
  const Reply reply_;
  OnDone on_done_;
  absl::Status status_;
  std::vector<Request> requests_;
};

absl::Status RefusedFor(absl::Duration delay) {
  absl::Status status = absl::ResourceExhaustedError("full");
  v1::RetryInfo info;
  info.mutable_retry_delay()->set_seconds(absl::ToInt64Seconds(delay));
  status.SetPayload(client::kRetryInfoUrl, absl::Cord(info.SerializeAsString()));
  return status;
}

// At the speed of refusals a server would do little else, and the clock would not get on here.
TEST(DriverTest, AClosedLoopBacksOffAfterRefusals) {
  for (const absl::Status& refusal :
       {absl::ResourceExhaustedError("full"), absl::UnavailableError("draining")}) {
    ManualClock clock;
    RefusingTarget target(clock, [&](const Request&) { return refusal; });
    Recorder recorder(absl::Seconds(1));
    Driver driver({.concurrency = 4, .warm_up = absl::Seconds(1), .duration = absl::Seconds(10)},
                  clock, target, recorder, AnyWork);
    ASSERT_TRUE(driver.Run().ok());
    std::array<std::vector<absl::Time>, 4> sent;
    for (const Request& request : target.requests())
      sent.at(request.slot).push_back(request.planned);
    for (const std::vector<absl::Time>& times : sent) {
      // Waits of 25 to 50 ms, then twice that and so on, up to 2.5 to 5 s.
      EXPECT_GE(times.size(), 8u);
      EXPECT_LE(times.size(), 12u);
      absl::Duration most = absl::Milliseconds(50);
      for (size_t i = 1; i < times.size(); ++i) {
        EXPECT_GE(times[i] - times[i - 1], most / 2) << i;
        // Late by a step at most: one that may go sooner waits for the step that is under way.
        EXPECT_LE(times[i] - times[i - 1], most + absl::Milliseconds(5)) << i;
        most = std::min(2 * most, absl::Seconds(5));
      }
    }
    const Measurement measured = recorder.Result(driver.end());
    EXPECT_EQ(measured.elapsed, absl::Seconds(10));
    EXPECT_EQ(measured.all.failed, measured.all.requests);
    // They did nothing but wait; what was of the warm-up does not count.
    EXPECT_EQ(measured.refusal_wait, 4 * absl::Seconds(10));
    EXPECT_EQ(measured.refusal_waits, measured.all.requests + 4);
  }
}

TEST(DriverTest, AClosedLoopWaitsAsLongAsTheServerSays) {
  ManualClock clock;
  // Of one slot: refused twice, answered, refused.
  RefusingTarget target(clock, [](const Request& request) -> absl::Status {
    if (request.number == 0) return RefusedFor(absl::Seconds(20));
    if (request.number == 1) return RefusedFor(absl::ZeroDuration());
    if (request.number == 2) return absl::OkStatus();
    return absl::UnavailableError("draining");
  });
  Recorder recorder(absl::Seconds(1));
  Driver driver({.duration = absl::Hours(1), .max_requests = 5}, clock, target, recorder, AnyWork);
  ASSERT_TRUE(driver.Run().ok());
  const std::vector<Request>& requests = target.requests();
  ASSERT_EQ(requests.size(), 5u);
  const auto gap = [&](size_t i) { return requests[i].planned - requests[i - 1].planned; };
  EXPECT_GE(gap(1), absl::Seconds(20));
  EXPECT_LE(gap(1), absl::Seconds(30));
  // The second in a row.
  EXPECT_GE(gap(2), absl::Milliseconds(50));
  EXPECT_LE(gap(2), absl::Milliseconds(100));
  EXPECT_EQ(gap(3), absl::ZeroDuration());
  // An answer came between: as at the beginning.
  EXPECT_GE(gap(4), absl::Milliseconds(25));
  EXPECT_LE(gap(4), absl::Milliseconds(50));
  const Measurement measured = recorder.Result(driver.end());
  EXPECT_EQ(measured.refusal_waits, 3u);
  EXPECT_EQ(measured.refusal_wait, gap(1) + gap(2) + gap(4));
  EXPECT_EQ(measured.all.planned.max(), absl::ZeroDuration()) << "no request was due meanwhile";
}

TEST(DriverTest, OtherFailuresAreNoReasonToWait) {
  ManualClock clock;
  RefusingTarget target(clock, [](const Request&) { return absl::DeadlineExceededError("late"); });
  Recorder recorder(absl::Seconds(1));
  Driver driver({.concurrency = 2, .max_requests = 20}, clock, target, recorder, AnyWork);
  ASSERT_TRUE(driver.Run().ok());
  EXPECT_EQ(target.requests().size(), 20u);
  EXPECT_EQ(clock.Now(), absl::UnixEpoch());
  EXPECT_EQ(recorder.Result(driver.end()).refusal_waits, 0u);
}

// Whatever ends the run ends the waits, though the server would have them go on for a day.
TEST(DriverTest, AWaitAfterARefusalEndsWithTheRun) {
  enum class End { kTime, kStop, kTargetGone };
  for (const End end : {End::kTime, End::kStop, End::kTargetGone}) {
    ManualClock clock;
    RefusingTarget target(clock, [](const Request&) { return RefusedFor(absl::Hours(24)); });
    Recorder recorder(absl::Seconds(1));
    Driver driver(
        {.concurrency = 3, .duration = end == End::kTime ? absl::Seconds(2) : absl::Hours(1000)},
        clock, target, recorder, AnyWork);
    clock.SetOnWait([&](absl::Time time) {
      if (time < absl::UnixEpoch() + absl::Seconds(2)) return;
      if (end == End::kStop) driver.Stop();
      if (end == End::kTargetGone) target.Fail(absl::UnavailableError("gone"));
    });
    EXPECT_EQ(driver.Run().ok(), end != End::kTargetGone);
    EXPECT_EQ(target.requests().size(), 3u);
    EXPECT_LE(clock.Now(), absl::UnixEpoch() + absl::Seconds(2.1));
    const Measurement measured = recorder.Result(driver.end());
    // Not until the last outcome alone, or the rate would be that of no time at all.
    EXPECT_NEAR(absl::ToDoubleSeconds(measured.elapsed), 2, 0.01);
    EXPECT_EQ(measured.refusal_waits, 3u);
    EXPECT_NEAR(absl::ToDoubleSeconds(measured.refusal_wait), 6, 0.03);
  }
}

TEST(DriverTest, StopEndsARunThatHasHoursLeft) {
  ManualClock clock;
  FakeTarget target(clock, absl::Milliseconds(1));
  target.Serve();
  Recorder recorder(absl::Seconds(1));
  const RunPlan plan{.mode = Mode::kClosed, .concurrency = 1, .duration = absl::Hours(1000)};
  Driver* running = nullptr;
  std::thread stopper;
  Driver driver(plan, clock, target, recorder, [&](uint64_t number) {
    // Stop takes the driver's lock, which is held here.
    if (number == 50) stopper = std::thread([&] { running->Stop(); });
    return AnyWork(number);
  });
  running = &driver;
  EXPECT_TRUE(driver.Run().ok());
  target.StopServing();
  stopper.join();
  EXPECT_GE(target.requests().size(), 51u);
}

TEST(DriverTest, ATargetThatIsGoneEndsTheRunWithItsStatus) {
  ManualClock clock;
  FakeTarget target(clock, absl::Milliseconds(1));
  clock.SetOnWait([&](absl::Time time) {
    target.AnswerUntil(time);
    if (time > absl::UnixEpoch() + absl::Seconds(1)) target.Fail(absl::UnavailableError("gone"));
  });
  Recorder recorder(absl::Seconds(1));
  const RunPlan plan{
      .mode = Mode::kOpen, .rate = 10, .duration = absl::Hours(1), .drain = absl::ZeroDuration()};
  Driver driver(plan, clock, target, recorder, AnyWork);
  EXPECT_EQ(driver.Run().code(), absl::StatusCode::kUnavailable);
  EXPECT_LT(target.requests().size(), 100u);
}

}  // namespace
}  // namespace sightline::load
