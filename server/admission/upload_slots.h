// SPDX-License-Identifier: Apache-2.0
//
// How many uploads there are at once: each holds what has arrived of it in memory.
//
// Thread safety: every method of UploadSlots from any thread; a slot belongs to one owner at a
// time. The slots' pool outlives them.
//
//   absl::StatusOr<UploadSlot> slot = slots.Take();
//   // RESOURCE_EXHAUSTED (LIMIT_EXCEEDED), with the delay after which to try again
#ifndef SIGHTLINE_SERVER_ADMISSION_UPLOAD_SLOTS_H_
#define SIGHTLINE_SERVER_ADMISSION_UPLOAD_SLOTS_H_

#include <cstdint>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "server/base/error.h"

namespace sightline {

class UploadSlots;

class UploadSlot {
 public:
  UploadSlot() = default;
  UploadSlot(UploadSlot&& other) noexcept : pool_(std::exchange(other.pool_, nullptr)) {}
  UploadSlot& operator=(UploadSlot&& other) noexcept {
    Release();
    pool_ = std::exchange(other.pool_, nullptr);
    return *this;
  }
  ~UploadSlot() { Release(); }
  inline void Release();

 private:
  friend class UploadSlots;
  explicit UploadSlot(UploadSlots* pool) : pool_(pool) {}
  UploadSlots* pool_ = nullptr;
};

class UploadSlots {
 public:
  explicit UploadSlots(uint64_t count) : count_(count) {}

  absl::StatusOr<UploadSlot> Take() {
    MutexLock lock(mutex_);
    if (taken_ >= count_) {
      // When an upload ends is its client's affair: a try a second costs nobody anything.
      return WithRetryDelay(
          OverLimit("uploads at once", taken_ + 1, "max_concurrent_uploads", count_),
          absl::Seconds(1));
    }
    ++taken_;
    return UploadSlot(this);
  }
  uint64_t taken() const {
    MutexLock lock(mutex_);
    return taken_;
  }

 private:
  friend class UploadSlot;
  void Return() {
    MutexLock lock(mutex_);
    --taken_;
  }

  const uint64_t count_;
  mutable Mutex mutex_;
  uint64_t taken_ ABSL_GUARDED_BY(mutex_) = 0;
};

inline void UploadSlot::Release() {
  if (pool_ != nullptr) std::exchange(pool_, nullptr)->Return();
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_UPLOAD_SLOTS_H_
