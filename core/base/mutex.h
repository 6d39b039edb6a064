// SPDX-License-Identifier: Apache-2.0
//
// The one mutex of this project. It carries clang's thread-safety annotations (so that a field
// marked ABSL_GUARDED_BY(mutex_) cannot be touched without it) and stands on std::mutex, whose
// pthread calls the thread sanitizer sees. Debian's absl::Mutex is compiled without the sanitizer,
// which would then report races that are none; so engine and server code locks through this wrapper
// alone.
//
// Thread safety: that is what it is for.
//
//   class Counter {
//    public:
//     void Add(int n) {
//       MutexLock lock(mutex_);
//       total_ += n;
//       changed_.SignalAll();
//     }
//     void WaitFor(int n) {
//       MutexLock lock(mutex_);
//       while (total_ < n) changed_.Wait(mutex_);
//     }
//    private:
//     Mutex mutex_;
//     CondVar changed_;
//     int total_ ABSL_GUARDED_BY(mutex_) = 0;
//   };
#ifndef SIGHTLINE_CORE_BASE_MUTEX_H_
#define SIGHTLINE_CORE_BASE_MUTEX_H_

#include <chrono>
#include <condition_variable>
#include <mutex>

#include "absl/base/thread_annotations.h"

namespace sightline {

class ABSL_LOCKABLE Mutex {
 public:
  Mutex() = default;
  Mutex(const Mutex&) = delete;
  Mutex& operator=(const Mutex&) = delete;

  void Lock() ABSL_EXCLUSIVE_LOCK_FUNCTION() { mutex_.lock(); }
  void Unlock() ABSL_UNLOCK_FUNCTION() { mutex_.unlock(); }
  bool TryLock() ABSL_EXCLUSIVE_TRYLOCK_FUNCTION(true) { return mutex_.try_lock(); }

 private:
  friend class CondVar;
  std::mutex mutex_;
};

// Holds a mutex for its scope.
class ABSL_SCOPED_LOCKABLE MutexLock {
 public:
  explicit MutexLock(Mutex& mutex) ABSL_EXCLUSIVE_LOCK_FUNCTION(mutex) : mutex_(mutex) {
    mutex_.Lock();
  }
  ~MutexLock() ABSL_UNLOCK_FUNCTION() { mutex_.Unlock(); }
  MutexLock(const MutexLock&) = delete;
  MutexLock& operator=(const MutexLock&) = delete;

 private:
  Mutex& mutex_;
};

// A condition variable over Mutex. Waits may wake without a signal: wait in a loop over the
// condition, written out where the lock is held, so that the analysis sees the guarded reads.
class CondVar {
 public:
  CondVar() = default;
  CondVar(const CondVar&) = delete;
  CondVar& operator=(const CondVar&) = delete;

  void Wait(Mutex& mutex) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    std::unique_lock<std::mutex> lock(mutex.mutex_, std::adopt_lock);
    condition_.wait(lock);
    lock.release();
  }

  // False once `deadline` has passed.
  bool WaitUntil(Mutex& mutex, std::chrono::steady_clock::time_point deadline)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex) {
    std::unique_lock<std::mutex> lock(mutex.mutex_, std::adopt_lock);
    const std::cv_status status = condition_.wait_until(lock, deadline);
    lock.release();
    return status == std::cv_status::no_timeout;
  }

  void Signal() { condition_.notify_one(); }
  void SignalAll() { condition_.notify_all(); }

 private:
  std::condition_variable condition_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_MUTEX_H_
