// SPDX-License-Identifier: Apache-2.0
//
// The bounds on what the whole server, and each of its clients, has accepted and not yet answered,
// in rays. A ticket takes its share of both and gives it back when it goes; an item that does not
// fit is refused at once, never kept waiting.
//
// Invariant: the tickets alive never hold more than the limit together, nor those of one client
// more than its quota, except that one ticket is granted whenever none is alive (so that a single
// item larger than the queue, or than the quota, can be answered at all).
//
// Thread safety: every method of RayQueue from any thread; a ticket or an account belongs to one
// owner at a time. The queue outlives both; an account is gone when its last copy and ticket are.
//
//   RayAccount account = queue.Open("10.1.2.3");
//   absl::StatusOr<RayTicket> ticket = queue.Admit(account, cost);
//   // RESOURCE_EXHAUSTED (QUEUE_FULL or QUOTA_EXCEEDED)
#ifndef SIGHTLINE_SERVER_ADMISSION_RAY_QUEUE_H_
#define SIGHTLINE_SERVER_ADMISSION_RAY_QUEUE_H_

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "core/base/mutex.h"

namespace sightline {

class RayQueue;

// What one client has in the queue; copies are the same account.
class RayAccount {
 public:
  RayAccount() = default;

 private:
  friend class RayQueue;
  friend class RayTicket;
  struct Held {
    // All guarded by the queue's lock.
    uint64_t rays = 0, tickets = 0, most = 0;
    bool by_role = false;  // Whether `most` is the access file's.
  };
  explicit RayAccount(std::shared_ptr<Held> held) : held_(std::move(held)) {}

  std::shared_ptr<Held> held_;
};

class RayTicket {
 public:
  RayTicket() = default;
  RayTicket(RayTicket&& other) noexcept
      : queue_(std::exchange(other.queue_, nullptr)),
        account_(std::move(other.account_)),
        rays_(other.rays_) {}
  RayTicket& operator=(RayTicket&& other) noexcept {
    Release();
    queue_ = std::exchange(other.queue_, nullptr);
    account_ = std::move(other.account_);
    rays_ = other.rays_;
    return *this;
  }
  ~RayTicket() { Release(); }

  void Release();
  // 0 once it is given back.
  uint64_t rays() const { return queue_ == nullptr ? 0 : rays_; }

 private:
  friend class RayQueue;
  RayTicket(RayQueue* queue, RayAccount account, uint64_t rays)
      : queue_(queue), account_(std::move(account)), rays_(rays) {}

  RayQueue* queue_ = nullptr;
  RayAccount account_;
  uint64_t rays_ = 0;
};

class RayQueue {
 public:
  RayQueue(uint64_t max_rays, uint64_t max_rays_per_client)
      : max_rays_(max_rays), max_rays_per_client_(max_rays_per_client) {}
  RayQueue(const RayQueue&) = delete;
  RayQueue& operator=(const RayQueue&) = delete;

  // The account of the client of that name; the same one as long as somebody has it. `max_rays`:
  // its quota from now on; 0: what every client may have.
  RayAccount Open(const std::string& client, uint64_t max_rays = 0);
  absl::StatusOr<RayTicket> Admit(const RayAccount& account, uint64_t rays);
  uint64_t queued_rays() const;

 private:
  friend class RayTicket;
  void Release(RayAccount::Held* held, uint64_t rays);

  const uint64_t max_rays_, max_rays_per_client_;
  mutable Mutex mutex_;
  uint64_t queued_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t tickets_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<std::string, std::weak_ptr<RayAccount::Held>> accounts_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_RAY_QUEUE_H_
