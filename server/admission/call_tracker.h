// SPDX-License-Identifier: Apache-2.0
//
// Which calls are under way, and whether the server still takes new ones. Draining tells the
// long-lived calls (streams) and waits for all of them, plain ones among them: a call is under way
// until its answer is written. Long-lived ones are also asked from time to time whether their
// clients take what they are sent.
//
// Invariants: after StartDrain no new call is admitted; every listener hears of it once, either
// from StartDrain or, if it comes later, not at all because it is refused.
//
// Thread safety: every method from any thread. Listeners are called without the lock held, and are
// kept alive during the call. The tracker outlives the calls.
//
//   absl::StatusOr<ActiveCall> call = tracker.Admit(stream);   // UNAVAILABLE (DRAINING)
#ifndef SIGHTLINE_SERVER_ADMISSION_CALL_TRACKER_H_
#define SIGHTLINE_SERVER_ADMISSION_CALL_TRACKER_H_

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"

namespace sightline {

// A call that outlives its first answer and has to be told that the server shuts down.
class DrainListener {
 public:
  virtual ~DrainListener() = default;
  virtual void OnDrain() = 0;
  // Ends the call if its client has held it up for too long by `now`. Must not block.
  virtual void EndIfStalled(std::chrono::steady_clock::time_point now) { (void)now; }
};

class CallTracker;

// Ends when it is destroyed or released.
class ActiveCall {
 public:
  ActiveCall() = default;
  ActiveCall(ActiveCall&& other) noexcept
      : tracker_(std::exchange(other.tracker_, nullptr)), id_(other.id_) {}
  ActiveCall& operator=(ActiveCall&& other) noexcept {
    Release();
    tracker_ = std::exchange(other.tracker_, nullptr);
    id_ = other.id_;
    return *this;
  }
  ~ActiveCall() { Release(); }

  void Release();

 private:
  friend class CallTracker;
  ActiveCall(CallTracker* tracker, uint64_t id) : tracker_(tracker), id_(id) {}

  CallTracker* tracker_ = nullptr;
  uint64_t id_ = 0;
};

class CallTracker {
 public:
  CallTracker() = default;
  CallTracker(const CallTracker&) = delete;
  CallTracker& operator=(const CallTracker&) = delete;

  // `listener` may be null.
  absl::StatusOr<ActiveCall> Admit(std::weak_ptr<DrainListener> listener = {});

  // Refuses new calls and tells the listeners.
  void StartDrain();
  // Asks the listeners whether they are stalled.
  void Sweep(std::chrono::steady_clock::time_point now);
  // True once StartDrain was called, false when `deadline` passes first.
  bool WaitUntilDraining(std::chrono::steady_clock::time_point deadline);
  // True once no call is left, false when `deadline` passes first.
  bool WaitUntilIdle(std::chrono::steady_clock::time_point deadline);

  bool draining() const;
  size_t active_calls() const;

 private:
  friend class ActiveCall;
  void Release(uint64_t id);
  std::vector<std::shared_ptr<DrainListener>> ListenersLocked() const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable Mutex mutex_;
  CondVar idle_, drain_started_;
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
  uint64_t next_id_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<uint64_t, std::weak_ptr<DrainListener>> calls_ ABSL_GUARDED_BY(mutex_);
};

// UNAVAILABLE (DRAINING).
absl::Status DrainingError();

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_CALL_TRACKER_H_
