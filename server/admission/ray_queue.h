// SPDX-License-Identifier: Apache-2.0
//
// The bound on what the whole server has accepted and not yet answered, in rays. A ticket takes its
// share and gives it back when it goes; an item that does not fit is refused at once, never kept
// waiting.
//
// Invariant: the tickets alive never hold more than the limit together, except that one ticket is
// granted whenever none is alive (so that a single item larger than the queue can be answered at
// all).
//
// Thread safety: every method of RayQueue from any thread; a ticket belongs to one owner at a time.
// The queue outlives its tickets.
//
//   absl::StatusOr<RayTicket> ticket = queue.Admit(cost);   // RESOURCE_EXHAUSTED (QUEUE_FULL)
#ifndef SIGHTLINE_SERVER_ADMISSION_RAY_QUEUE_H_
#define SIGHTLINE_SERVER_ADMISSION_RAY_QUEUE_H_

#include <cstdint>
#include <utility>

#include "absl/status/statusor.h"
#include "core/base/mutex.h"

namespace sightline {

class RayQueue;

class RayTicket {
 public:
  RayTicket() = default;
  RayTicket(RayTicket&& other) noexcept
      : queue_(std::exchange(other.queue_, nullptr)), rays_(other.rays_) {}
  RayTicket& operator=(RayTicket&& other) noexcept {
    Release();
    queue_ = std::exchange(other.queue_, nullptr);
    rays_ = other.rays_;
    return *this;
  }
  ~RayTicket() { Release(); }

  void Release();

 private:
  friend class RayQueue;
  RayTicket(RayQueue* queue, uint64_t rays) : queue_(queue), rays_(rays) {}

  RayQueue* queue_ = nullptr;
  uint64_t rays_ = 0;
};

class RayQueue {
 public:
  explicit RayQueue(uint64_t max_rays) : max_rays_(max_rays) {}
  RayQueue(const RayQueue&) = delete;
  RayQueue& operator=(const RayQueue&) = delete;

  absl::StatusOr<RayTicket> Admit(uint64_t rays);
  uint64_t queued_rays() const;

 private:
  friend class RayTicket;
  void Release(uint64_t rays);

  const uint64_t max_rays_;
  mutable Mutex mutex_;
  uint64_t queued_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t tickets_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_RAY_QUEUE_H_
