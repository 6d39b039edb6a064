// SPDX-License-Identifier: Apache-2.0
#include "server/admission/call_tracker.h"

#include "server/base/error.h"

namespace sightline {

void ActiveCall::Release() {
  if (tracker_ != nullptr) std::exchange(tracker_, nullptr)->Release(id_);
}

absl::StatusOr<ActiveCall> CallTracker::Admit(std::weak_ptr<DrainListener> listener) {
  MutexLock lock(mutex_);
  if (draining_) return DrainingError();
  const uint64_t id = next_id_++;
  calls_.emplace(id, std::move(listener));
  return ActiveCall(this, id);
}

void CallTracker::StartDrain() {
  std::vector<std::shared_ptr<DrainListener>> listeners;
  {
    MutexLock lock(mutex_);
    if (draining_) return;
    draining_ = true;
    drain_started_.SignalAll();
    listeners = ListenersLocked();
  }
  for (const auto& listener : listeners) listener->OnDrain();
}

void CallTracker::Sweep(std::chrono::steady_clock::time_point now) {
  std::vector<std::shared_ptr<DrainListener>> listeners;
  {
    MutexLock lock(mutex_);
    listeners = ListenersLocked();
  }
  for (const auto& listener : listeners) listener->EndIfStalled(now);
}

std::vector<std::shared_ptr<DrainListener>> CallTracker::ListenersLocked() const {
  std::vector<std::shared_ptr<DrainListener>> listeners;
  for (const auto& [id, weak] : calls_) {
    if (std::shared_ptr<DrainListener> listener = weak.lock()) {
      listeners.push_back(std::move(listener));
    }
  }
  return listeners;
}

bool CallTracker::WaitUntilDraining(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (!draining_) {
    if (!drain_started_.WaitUntil(mutex_, deadline)) return draining_;
  }
  return true;
}

bool CallTracker::WaitUntilIdle(std::chrono::steady_clock::time_point deadline) {
  MutexLock lock(mutex_);
  while (!calls_.empty()) {
    if (!idle_.WaitUntil(mutex_, deadline)) return calls_.empty();
  }
  return true;
}

bool CallTracker::draining() const {
  MutexLock lock(mutex_);
  return draining_;
}

size_t CallTracker::active_calls() const {
  MutexLock lock(mutex_);
  return calls_.size();
}

void CallTracker::Release(uint64_t id) {
  MutexLock lock(mutex_);
  calls_.erase(id);
  if (calls_.empty()) idle_.SignalAll();
}

absl::Status DrainingError() {
  return MakeError(absl::StatusCode::kUnavailable, v1::ERROR_REASON_DRAINING,
                   "the server is shutting down; another one, or this one later, may answer");
}

}  // namespace sightline
