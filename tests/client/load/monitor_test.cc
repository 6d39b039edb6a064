// SPDX-License-Identifier: Apache-2.0
#include "client/load/monitor.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "client/load/driver.h"
#include "client/load/recorder.h"
#include "client/load/stability.h"
#include "core/base/mutex.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/client/load/fake_target.h"
#include "tests/client/load/manual_clock.h"
#include "tests/support/watched_stream.h"

namespace sightline::load {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

Work AnyWork(uint64_t number) { return {.kind = Kind::kTiles, .item = number}; }

// ---- The line

TEST(LiveLineTest, TheWarmUpIsCalledThat) {
  const MonitorOptions options{.title = "8 at once", .duration = absl::Seconds(30)};
  EXPECT_EQ(LiveLine(options, {.elapsed = absl::ZeroDuration(), .answered = 7}),
            "8 at once  warming up");
}

TEST(LiveLineTest, ItSaysHowFarTheRunIsAndHowItsLastWindowWas) {
  const MonitorOptions options{.title = "600/s", .duration = absl::Seconds(30)};
  Glance glance{.elapsed = absl::Milliseconds(1240), .answered = 12'345};
  EXPECT_EQ(LiveLine(options, glance), "600/s  1.2 s of 30.0 s  12,345 answers");
  Window older, last;
  older.answered = 1;
  older.planned.Record(absl::Seconds(1));
  last.answered = 1'200;
  last.planned.Record(absl::Milliseconds(2), 1'100);
  last.planned.Record(absl::Milliseconds(50), 100);
  glance.last = {older, last};
  const std::string line = LiveLine(options, glance);
  EXPECT_THAT(line, StartsWith("600/s  1.2 s of 30.0 s  12,345 answers  last window 1,200 answers, "
                               "p50 2"));
  EXPECT_THAT(line, EndsWith(", p99 50 ms"));
  glance.last.back().planned.Record(absl::Seconds(2), 1'000'000);
  EXPECT_THAT(LiveLine(options, glance), EndsWith(", p50 2000 ms, p99 2000 ms"));
}

TEST(LiveLineTest, FailuresAndWrongAnswersAreSaidWhereThereAreAny) {
  const MonitorOptions options{.title = "x", .duration = absl::Seconds(1)};
  Glance glance{.elapsed = absl::Seconds(1), .answered = 5};
  EXPECT_THAT(LiveLine(options, glance), Not(HasSubstr("failed")));
  glance.failed = 3000;
  EXPECT_THAT(LiveLine(options, glance), EndsWith("  3,000 failed"));
  glance.wrong = 2;
  EXPECT_THAT(LiveLine(options, glance), EndsWith("  3,000 failed  2 WRONG"));
}

// ---- The watch

// What a monitor writes, and a wait for the n-th line of it.
class Terminal : public testing_support::WatchedStream {
 public:
  void WaitForLines(ptrdiff_t count) {
    MutexLock lock(mutex_);
    while (lines_ < count) written_.Wait(mutex_);
  }
  std::string text() const {
    MutexLock lock(mutex_);
    return text_;
  }

 private:
  void OnWrite(std::string_view bytes) override {
    MutexLock lock(mutex_);
    text_.append(bytes);
    // A line begins where the last one is overwritten.
    lines_ += std::count(bytes.begin(), bytes.end(), '\r');
    written_.SignalAll();
  }
  mutable Mutex mutex_;
  CondVar written_;
  std::string text_ ABSL_GUARDED_BY(mutex_);
  ptrdiff_t lines_ ABSL_GUARDED_BY(mutex_) = 0;
};

// A closed loop whose answers take as long as `service` says, by a clock that runs as fast as they
// come. Only the monitor ends it, or the test.
class WatchedRun {
 public:
  WatchedRun(MonitorOptions options, FakeTarget::Service service, Terminal& terminal)
      : target_(clock_, std::move(service)),
        driver_({.concurrency = 1, .duration = absl::Hours(100'000)}, clock_, target_, recorder_,
                AnyWork) {
    options.title = "a run";
    options.duration = absl::Hours(100'000);
    target_.Serve();
    runner_ = std::thread([this, options, &terminal] {
      Monitor monitor(options, recorder_, driver_, clock_, terminal.stream);
      EXPECT_TRUE(driver_.Run().ok());
      MutexLock lock(mutex_);
      ended_ = true;
      changed_.SignalAll();
      // Until the test has seen enough of it.
      while (!let_go_) changed_.Wait(mutex_);
    });
  }
  ~WatchedRun() {
    driver_.Stop();
    LetGo();
  }
  void WaitForEnd() {
    MutexLock lock(mutex_);
    while (!ended_) changed_.Wait(mutex_);
  }
  bool ended() const {
    MutexLock lock(mutex_);
    return ended_;
  }
  // Takes the monitor away.
  void LetGo() {
    {
      MutexLock lock(mutex_);
      let_go_ = true;
      changed_.SignalAll();
    }
    if (runner_.joinable()) runner_.join();
  }
  Measurement measured() const { return recorder_.Result(driver_.end()); }

 private:
  ManualClock clock_;
  FakeTarget target_;
  Recorder recorder_{absl::Seconds(1)};
  Driver driver_;
  mutable Mutex mutex_;
  CondVar changed_;
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;
  bool let_go_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread runner_;  // Last: it uses the others.
};

FakeTarget::Service Always(absl::Duration service) {
  return [service](absl::Time) { return service; };
}

// Every other second takes half as long again.
absl::Duration Swinging(absl::Time now) {
  const bool odd = absl::ToInt64Seconds(now - absl::UnixEpoch()) % 2 == 1;
  return odd ? absl::Milliseconds(3) : absl::Milliseconds(2);
}

TEST(MonitorTest, ARunThatIsToEndOnceItIsStableDoes) {
  Terminal terminal;
  WatchedRun run({.until_stable = true}, Always(absl::Milliseconds(2)), terminal);
  run.WaitForEnd();
  const Measurement measured = run.measured();
  EXPECT_GE(measured.windows.size(), kStableWindows);
  EXPECT_TRUE(JudgeStability(measured.windows, 0.10).stable);
  EXPECT_LT(measured.elapsed, absl::Hours(100'000));
  EXPECT_EQ(terminal.text(), "") << "nobody looks";
}

TEST(MonitorTest, ARunThatIsNotStableGoesOn) {
  Terminal terminal;
  WatchedRun run({.is_terminal = true, .until_stable = true}, Swinging, terminal);
  terminal.WaitForLines(4);  // It was judged before each but the first.
  EXPECT_FALSE(run.ended());
}

TEST(MonitorTest, WithoutTheFlagAStableRunGoesOn) {
  Terminal terminal;
  WatchedRun run({.is_terminal = true}, Always(absl::Milliseconds(2)), terminal);
  terminal.WaitForLines(4);
  EXPECT_FALSE(run.ended());
}

TEST(MonitorTest, TheLineIsRewrittenInPlaceAndTakenAway) {
  Terminal terminal;
  {
    WatchedRun run({.is_terminal = true}, Always(absl::Milliseconds(2)), terminal);
    terminal.WaitForLines(3);
  }
  EXPECT_THAT(terminal.text(), StartsWith("\ra run  "));
  EXPECT_THAT(terminal.text(), HasSubstr("last window 500 answers, p50 2 ms, p99 2 ms\x1b[K\r"));
  EXPECT_THAT(terminal.text(), EndsWith("\x1b[K\r\x1b[K"));
  EXPECT_THAT(terminal.text(), Not(HasSubstr("\n")));
}

TEST(MonitorTest, AnInterruptedRunEnds) {
  const std::atomic<bool> interrupted{true};
  Terminal terminal;
  WatchedRun run({.interrupted = &interrupted}, Swinging, terminal);
  run.WaitForEnd();
  EXPECT_GT(run.measured().all.requests, 0u);
}

}  // namespace
}  // namespace sightline::load
