// SPDX-License-Identifier: Apache-2.0
#include "client/load/driver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <memory>
#include <thread>
#include <vector>

#include "tests/client/load/manual_clock.h"

namespace sightline::load {
namespace {

// Answers one request after the other, each `service` after it came or after the one before. The
// clock's waits move its time on; a closed loop, in which nobody waits, has a thread for it.
class FakeTarget final : public Target {
 public:
  FakeTarget(ManualClock& clock, absl::Duration service) : clock_(clock), service_(service) {}
  ~FakeTarget() override { StopServing(); }

  void SetOnDone(OnDone on_done) override { on_done_ = std::move(on_done); }
  void Send(const Request& request) override {
    MutexLock lock(mutex_);
    const absl::Time now = clock_.Now();
    free_ = std::max(free_, now) + service_;
    queue_.push_back({request, now, free_});
    most_ = std::max(most_, queue_.size());
    requests_.push_back(request);
    changed_.SignalAll();
  }
  void CancelAll() override {
    while (true) {
      Outcome outcome;
      {
        MutexLock lock(mutex_);
        if (queue_.empty()) return;
        outcome = {.request = queue_.front().request,
                   .sent = queue_.front().sent,
                   .received = clock_.Now(),
                   .status = absl::CancelledError("cancelled")};
        queue_.pop_front();
      }
      on_done_(outcome);
    }
  }
  absl::Status status() const override {
    MutexLock lock(mutex_);
    return status_;
  }
  void Fail(absl::Status status) {
    MutexLock lock(mutex_);
    status_ = std::move(status);
  }

  // Answers everything that is ready by `time`.
  void AnswerUntil(absl::Time time) {
    while (true) {
      Outcome outcome;
      {
        MutexLock lock(mutex_);
        if (queue_.empty() || queue_.front().ready > time) return;
        outcome = {.request = queue_.front().request,
                   .sent = queue_.front().sent,
                   .received = queue_.front().ready,
                   .rays = 10};
        queue_.pop_front();
      }
      on_done_(outcome);
    }
  }
  // For closed loops: the clock goes to whatever is ready next.
  void Serve() {
    server_ = std::thread([this] {
      while (true) {
        absl::Time ready;
        {
          MutexLock lock(mutex_);
          while (queue_.empty() && !done_) changed_.Wait(mutex_);
          if (done_) return;
          ready = queue_.front().ready;
        }
        clock_.WaitUntil(ready);
        AnswerUntil(ready);
      }
    });
  }
  void StopServing() {
    {
      MutexLock lock(mutex_);
      done_ = true;
      changed_.SignalAll();
    }
    if (server_.joinable()) server_.join();
  }

  std::vector<Request> requests() const {
    MutexLock lock(mutex_);
    return requests_;
  }
  size_t most_at_once() const {
    MutexLock lock(mutex_);
    return most_;
  }

 private:
  struct Waiting {
    Request request;
    absl::Time sent, ready;
  };
  ManualClock& clock_;
  const absl::Duration service_;
  OnDone on_done_;
  mutable Mutex mutex_;
  CondVar changed_;
  std::deque<Waiting> queue_ ABSL_GUARDED_BY(mutex_);
  std::vector<Request> requests_ ABSL_GUARDED_BY(mutex_);
  absl::Time free_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  size_t most_ ABSL_GUARDED_BY(mutex_) = 0;
  bool done_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  std::thread server_;
};

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
