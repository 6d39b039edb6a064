// SPDX-License-Identifier: Apache-2.0
//
// A clock that stands still until someone waits for it: a wait sets it to the time waited for.
//
// Thread safety: every method from any thread.
//
//   ManualClock clock;
//   clock.Advance(absl::Milliseconds(5));
#ifndef SIGHTLINE_TESTS_CLIENT_LOAD_MANUAL_CLOCK_H_
#define SIGHTLINE_TESTS_CLIENT_LOAD_MANUAL_CLOCK_H_

#include <algorithm>
#include <functional>
#include <utility>

#include "client/load/clock.h"
#include "core/base/mutex.h"

namespace sightline::load {

class ManualClock final : public Clock {
 public:
  absl::Time Now() const override {
    MutexLock lock(mutex_);
    return now_;
  }
  void WaitUntil(absl::Time time) override {
    if (on_wait_) on_wait_(time);
    MutexLock lock(mutex_);
    now_ = std::max(now_, time);
  }
  void Advance(absl::Duration duration) {
    MutexLock lock(mutex_);
    now_ += duration;
  }
  // Called at every wait, before the time changes. Set before the clock is used.
  void SetOnWait(std::function<void(absl::Time)> on_wait) { on_wait_ = std::move(on_wait); }

 private:
  mutable Mutex mutex_;
  absl::Time now_ ABSL_GUARDED_BY(mutex_) = absl::UnixEpoch();
  std::function<void(absl::Time)> on_wait_;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_TESTS_CLIENT_LOAD_MANUAL_CLOCK_H_
