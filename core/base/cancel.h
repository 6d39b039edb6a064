// SPDX-License-Identifier: Apache-2.0
//
// A flag that asks running work to stop: set by a caller, or by a deadline, and polled by the work.
// Once set it stays set. A token may have a parent (an item's within its stream's): it stops when
// either does.
//
// Cost of cancelled(): one relaxed load; with a deadline also one reading of the steady clock (some
// 25 ns through the vDSO). Poll it per block of work of a few microseconds, not per ray.
//
// The memory order is relaxed: cancellation publishes no data. Results of a cancelled computation
// are dropped, never read as if they were complete.
//
// Thread safety: every method may be called from any thread at any time.
//
//   CancelToken cancel;
//   cancel.set_deadline(std::chrono::steady_clock::now() + std::chrono::seconds(2));
//   pool.ParallelFor(n, 64, body, &cancel);
//   if (cancel.cancelled()) return cancel.ToStatus();
#ifndef SIGHTLINE_CORE_BASE_CANCEL_H_
#define SIGHTLINE_CORE_BASE_CANCEL_H_

#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>

#include "absl/status/status.h"

namespace sightline {

class CancelToken {
 public:
  using Clock = std::chrono::steady_clock;

  CancelToken() = default;
  // REQUIRES: `parent` (may be null) outlives this token.
  explicit CancelToken(const CancelToken* parent) : parent_(parent) {}
  CancelToken(const CancelToken&) = delete;
  CancelToken& operator=(const CancelToken&) = delete;

  // Has no effect on a token whose deadline has already been noticed: the first reason is kept.
  void Cancel() { Latch(kCancelled); }

  // Replaces the deadline. One that has been noticed is not taken back by a later one.
  void set_deadline(Clock::time_point deadline) {
    deadline_.store(deadline.time_since_epoch().count(), std::memory_order_relaxed);
  }

  // Has it fire, as a deadline does, at the look after so many more: for tests of how often work
  // looks, which tell no time. Replaces the deadline.
  void set_looks_left(uint32_t looks) {
    deadline_.store(kNoLooks + Clock::rep{looks}, std::memory_order_relaxed);
  }

  bool cancelled() const { return reason() != kLive; }

  // OK while live, then CANCELLED or DEADLINE_EXCEEDED.
  absl::Status ToStatus() const;

 private:
  enum Reason : uint32_t { kLive = 0, kCancelled = 1, kDeadlineExceeded = 2 };
  static constexpr Clock::rep kNoDeadline = std::numeric_limits<Clock::rep>::max();
  // As a deadline: from here on to kMostLooks, how many looks are left, which no clock shows.
  static constexpr Clock::rep kNoLooks = std::numeric_limits<Clock::rep>::min();
  static constexpr Clock::rep kMostLooks = kNoLooks + std::numeric_limits<uint32_t>::max();

  Reason reason() const {
    const Reason reason = reason_.load(std::memory_order_relaxed);
    if (reason != kLive) return reason;
    const Clock::rep deadline = deadline_.load(std::memory_order_relaxed);
    if (deadline != kNoDeadline && HasPassed(deadline)) return Latch(kDeadlineExceeded);
    if (parent_ == nullptr) return kLive;
    const Reason inherited = parent_->reason();
    return inherited == kLive ? kLive : Latch(inherited);
  }

  bool HasPassed(Clock::rep deadline) const {
    if (deadline <= kMostLooks) [[unlikely]]
      return !TakeLook(deadline);
    return Clock::now().time_since_epoch().count() >= deadline;
  }
  // Whether one was left.
  bool TakeLook(Clock::rep left) const;

  // Keeps the first reason, and returns it.
  Reason Latch(Reason reason) const {
    Reason expected = kLive;
    return reason_.compare_exchange_strong(expected, reason, std::memory_order_relaxed) ? reason
                                                                                        : expected;
  }

  const CancelToken* const parent_ = nullptr;
  mutable std::atomic<Reason> reason_{kLive};
  // Mutable where it tells how many looks are left: each changes it.
  mutable std::atomic<Clock::rep> deadline_{kNoDeadline};
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_CANCEL_H_
