// SPDX-License-Identifier: Apache-2.0
//
// Paces one run. In an open loop requests go out when they are due, whatever the server does; in a
// closed loop a fixed number is always under way, each answer calling the next request. A refusal
// (RESOURCE_EXHAUSTED, UNAVAILABLE) calls it after a back-off, and not before the server wants it,
// as any client's would: at refusal speed the failures alone would be what the server works on.
//
// Bounded: a run ends after its warm-up and duration, or once `max_requests` of the measured ones
// were planned; then what is unanswered after `drain` is cancelled and counted as failed. No more
// than `max_outstanding` requests are unanswered at once: an open loop that gets there sends later
// ones late, and their latencies from the planned time say so. Those that it could not send by
// then were due all the same: they are counted as failed, after as long as they waited.
//
// Thread safety: Run by one thread; Stop from any. The target's threads never wait here.
//
//   Driver driver(plan, clock, target, recorder, [&](uint64_t n) { return workload.Pick(n); });
//   absl::Status status = driver.Run();
#ifndef SIGHTLINE_CLIENT_LOAD_DRIVER_H_
#define SIGHTLINE_CLIENT_LOAD_DRIVER_H_

#include <cstdint>
#include <functional>
#include <map>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/lib/backoff.h"
#include "client/load/arrivals.h"
#include "client/load/clock.h"
#include "client/load/recorder.h"
#include "client/load/target.h"
#include "core/base/mutex.h"

namespace sightline::load {

enum class Mode { kOpen, kClosed };

struct RunPlan {
  Mode mode = Mode::kClosed;
  Arrivals arrivals = Arrivals::kConstant;  // Open loop.
  double rate = 0;                          // Open loop: requests per second, above 0.
  uint64_t concurrency = 1;                 // Closed loop: requests under way, at least 1.
  uint64_t seed = 1;
  absl::Duration warm_up = absl::ZeroDuration();
  absl::Duration duration = absl::Seconds(30);  // After the warm-up.
  uint64_t max_requests = 0;                    // Measured ones; 0: no bound but the time.
  uint64_t max_outstanding = 65536;
  absl::Duration drain = absl::Seconds(10);
};

class Driver {
 public:
  using Pick = std::function<Work(uint64_t number)>;

  // All but the plan must outlive the driver, and the target must be done by then.
  Driver(const RunPlan& plan, Clock& clock, Target& target, Recorder& recorder, Pick pick);

  // Returns when every request has its outcome. The target's status if it cannot be reached.
  absl::Status Run();
  // Ends the run early, as if its time were over now: what was due by now is sent, and may be
  // answered.
  void Stop();
  // When the run ended: its time was over; it was stopped, and the last request had its outcome; or
  // the last of max_requests had.
  absl::Time end() const;

 private:
  // Of a closed loop, after a refusal.
  struct Waiting {
    uint64_t slot = 0;
    absl::Time since;
  };

  bool Next(absl::Time planned, Request* request) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  Request Plan(absl::Time planned) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Time LastDue() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool IsDue(absl::Time planned) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool Over(absl::Time time) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void RunOpen();
  void RunClosed();
  void SendWaiting() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void WaitAfterRefusal(const Outcome& outcome, absl::Time now)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool WaitUntilDue(absl::Time due);
  bool WaitForRoom(absl::Time due);
  void CountUnsent(absl::Time due, ArrivalSchedule* arrivals);
  void WaitForAnswers();
  void OnDone(const Outcome& outcome);

  const RunPlan plan_;
  Clock& clock_;
  Target& target_;
  Recorder& recorder_;
  const Pick pick_;
  absl::Time start_, measure_, end_;  // Set once, before anything is sent.
  mutable Mutex mutex_;
  CondVar answered_;
  uint64_t planned_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t measured_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t outstanding_ ABSL_GUARDED_BY(mutex_) = 0;
  // When Stop was called, or the target was gone.
  absl::Time stop_ ABSL_GUARDED_BY(mutex_) = absl::InfiniteFuture();
  bool given_up_ ABSL_GUARDED_BY(mutex_) = false;  // Nothing more is sent.
  absl::Time last_outcome_ ABSL_GUARDED_BY(mutex_);
  // A closed loop's slots, as many as its concurrency at most: those that wait, by when they may
  // go on, and the back-offs of those whose last request was refused.
  std::multimap<absl::Time, Waiting> waiting_ ABSL_GUARDED_BY(mutex_);
  std::map<uint64_t, client::Backoff> backoffs_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_DRIVER_H_
