// SPDX-License-Identifier: Apache-2.0
//
// A target that lives by a ManualClock.
//
// Thread safety: as Target; Serve and StopServing by the test's thread.
//
//   FakeTarget target(clock, absl::Milliseconds(4));
//   clock.SetOnWait([&](absl::Time time) { target.AnswerUntil(time); });
#ifndef SIGHTLINE_TESTS_CLIENT_LOAD_FAKE_TARGET_H_
#define SIGHTLINE_TESTS_CLIENT_LOAD_FAKE_TARGET_H_

#include <algorithm>
#include <deque>
#include <functional>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "client/load/target.h"
#include "core/base/mutex.h"
#include "tests/client/load/manual_clock.h"

namespace sightline::load {

// Answers one request after the other, each `service` after it came or after the one before. The
// clock's waits move its time on; a closed loop, in which nobody waits, has a thread for it.
class FakeTarget final : public Target {
 public:
  // How long a request that comes now is worked on.
  using Service = std::function<absl::Duration(absl::Time now)>;

  FakeTarget(ManualClock& clock, Service service) : clock_(clock), service_(std::move(service)) {}
  FakeTarget(ManualClock& clock, absl::Duration service)
      : FakeTarget(clock, [service](absl::Time) { return service; }) {}
  ~FakeTarget() override { StopServing(); }

  void SetOnDone(OnDone on_done) override { on_done_ = std::move(on_done); }
  void Send(const Request& request) override {
    MutexLock lock(mutex_);
    const absl::Time now = clock_.Now();
    free_ = std::max(free_, now) + service_(now);
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
                   .status = absl::CancelledError("cancelled"),
                   .given_up = true};
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
  const Service service_;
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

}  // namespace sightline::load

#endif  // SIGHTLINE_TESTS_CLIENT_LOAD_FAKE_TARGET_H_
