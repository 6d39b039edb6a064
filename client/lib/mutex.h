// SPDX-License-Identifier: Apache-2.0
//
// Abseil's mutex, as the client locks it. Debian's Abseil is not built for the thread sanitizer,
// which would take everything it guards for a race: under the sanitizer the same is made of
// std::mutex, which it knows. In other builds these are absl::Mutex and absl::MutexLock.
//
// Thread safety: as absl::Mutex.
//
//   Mutex mutex_;
//   int count_ ABSL_GUARDED_BY(mutex_);
//   ...
//   MutexLock lock(&mutex_);
//   ++count_;
#ifndef SIGHTLINE_CLIENT_LIB_MUTEX_H_
#define SIGHTLINE_CLIENT_LIB_MUTEX_H_

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/time.h"

#if defined(__SANITIZE_THREAD__)
#define SIGHTLINE_CLIENT_UNDER_TSAN 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define SIGHTLINE_CLIENT_UNDER_TSAN 1
#endif
#endif
#if defined(SIGHTLINE_CLIENT_UNDER_TSAN)
#include <condition_variable>
#include <mutex>

#include "absl/time/clock.h"
#endif

namespace sightline::client {

#if defined(SIGHTLINE_CLIENT_UNDER_TSAN)

class ABSL_LOCKABLE Mutex {
 public:
  void Lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() { mutex_.lock(); }
  void Unlock() ABSL_UNLOCK_FUNCTION() {
    changed_.notify_all();  // Whatever is awaited may hold now.
    mutex_.unlock();
  }
  void Await(const absl::Condition& condition) ABSL_NO_THREAD_SAFETY_ANALYSIS {
    AwaitWithDeadline(condition, absl::InfiniteFuture());
  }
  bool AwaitWithDeadline(const absl::Condition& condition,
                         absl::Time deadline) ABSL_NO_THREAD_SAFETY_ANALYSIS {
    std::unique_lock<std::mutex> lock(mutex_, std::adopt_lock);
    changed_.notify_all();  // As Unlock: this gives the lock up.
    bool met = condition.Eval();
    while (!met && absl::Now() < deadline) {
      if (deadline == absl::InfiniteFuture()) {
        changed_.wait(lock);
      } else {
        changed_.wait_until(lock, absl::ToChronoTime(deadline));
      }
      met = condition.Eval();
    }
    lock.release();
    return met;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
};

class ABSL_SCOPED_LOCKABLE MutexLock {
 public:
  explicit MutexLock(Mutex* mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_->Lock();
  }
  ~MutexLock() ABSL_UNLOCK_FUNCTION() { mutex_->Unlock(); }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

 private:
  Mutex* const mutex_;
};

#else

using Mutex = absl::Mutex;
using MutexLock = absl::MutexLock;

#endif

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_MUTEX_H_
