// SPDX-License-Identifier: Apache-2.0
#include "client/load/driver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

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
  // The last is still unanswered when the run gives up: nobody moves the clock on.
  EXPECT_EQ(measured.all.answered, 299u);
  EXPECT_EQ(measured.all.failed, 1u);
  EXPECT_EQ(measured.errors.at("CANCELLED"), 1u);
  EXPECT_EQ(measured.all.planned.max(), absl::Milliseconds(4));
  EXPECT_EQ(measured.all.sent.max(), absl::Milliseconds(4));
  ASSERT_EQ(measured.windows.size(), 3u);
  EXPECT_NEAR(static_cast<double>(measured.windows[1].answered), 100, 1);
  EXPECT_EQ(measured.elapsed, absl::Seconds(3));
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
