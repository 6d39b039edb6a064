// SPDX-License-Identifier: Apache-2.0
//
// How many uploads there are at once: each holds what has arrived of it in memory. Those that wait
// for their clients are asked from time to time whether they have waited for too long.
//
// Thread safety: every method of UploadSlots from any thread; a slot belongs to one owner at a
// time. The slots' pool outlives them. Uploads are asked without the lock held, and are kept alive
// while they are.
//
//   absl::StatusOr<UploadSlot> slot = slots.Take(upload);
//   // RESOURCE_EXHAUSTED (LIMIT_EXCEEDED), with the delay after which to try again
//   PeriodicTask sweeper(absl::Seconds(5), [&] { slots.Sweep(IdleClock::Now()); });
#ifndef SIGHTLINE_SERVER_ADMISSION_UPLOAD_SLOTS_H_
#define SIGHTLINE_SERVER_ADMISSION_UPLOAD_SLOTS_H_

#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "server/admission/idle_clock.h"
#include "server/base/error.h"

namespace sightline {

class UploadSlots;

// An upload that may have to be ended because nothing comes any more.
class WaitingUpload {
 public:
  virtual ~WaitingUpload() = default;
  // Must not block.
  virtual void EndIfIdle(IdleClock::Time now) = 0;
};

class UploadSlot {
 public:
  UploadSlot() = default;
  UploadSlot(UploadSlot&& other) noexcept
      : pool_(std::exchange(other.pool_, nullptr)), id_(other.id_) {}
  UploadSlot& operator=(UploadSlot&& other) noexcept {
    Release();
    pool_ = std::exchange(other.pool_, nullptr);
    id_ = other.id_;
    return *this;
  }
  ~UploadSlot() { Release(); }
  inline void Release();

 private:
  friend class UploadSlots;
  UploadSlot(UploadSlots* pool, uint64_t id) : pool_(pool), id_(id) {}
  UploadSlots* pool_ = nullptr;
  uint64_t id_ = 0;
};

class UploadSlots {
 public:
  explicit UploadSlots(uint64_t count) : count_(count) {}

  // `upload` is asked by Sweep for as long as it has the slot; may be null.
  absl::StatusOr<UploadSlot> Take(std::weak_ptr<WaitingUpload> upload = {}) {
    MutexLock lock(mutex_);
    if (uploads_.size() >= count_) {
      // When an upload ends is its client's affair: a try a second costs nobody anything.
      return WithRetryDelay(
          OverLimit("uploads at once", uploads_.size() + 1, "max_concurrent_uploads", count_,
                    "try again when some of them have ended"),
          absl::Seconds(1));
    }
    uploads_.emplace(next_id_, std::move(upload));
    return UploadSlot(this, next_id_++);
  }
  uint64_t taken() const {
    MutexLock lock(mutex_);
    return uploads_.size();
  }

  void Sweep(IdleClock::Time now) {
    std::vector<std::shared_ptr<WaitingUpload>> asked;
    {
      MutexLock lock(mutex_);
      for (const auto& [id, weak] : uploads_) {
        if (std::shared_ptr<WaitingUpload> upload = weak.lock()) asked.push_back(std::move(upload));
      }
    }
    for (const auto& upload : asked) upload->EndIfIdle(now);
  }

 private:
  friend class UploadSlot;
  void Return(uint64_t id) {
    MutexLock lock(mutex_);
    uploads_.erase(id);
  }

  const uint64_t count_;
  mutable Mutex mutex_;
  uint64_t next_id_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<uint64_t, std::weak_ptr<WaitingUpload>> uploads_ ABSL_GUARDED_BY(mutex_);
};

inline void UploadSlot::Release() {
  if (pool_ != nullptr) std::exchange(pool_, nullptr)->Return(id_);
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_UPLOAD_SLOTS_H_
