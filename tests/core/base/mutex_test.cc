// SPDX-License-Identifier: Apache-2.0
#include "core/base/mutex.h"

#include <chrono>
#include <cstdint>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

namespace sightline {
namespace {

class Queue {
 public:
  void Push(int value) {
    MutexLock lock(mutex_);
    values_.push_back(value);
    changed_.Signal();
  }
  int Pop() {
    MutexLock lock(mutex_);
    while (values_.empty()) changed_.Wait(mutex_);
    const int value = values_.back();
    values_.pop_back();
    return value;
  }
  bool PopBefore(std::chrono::steady_clock::time_point deadline, int* value) {
    MutexLock lock(mutex_);
    while (values_.empty()) {
      if (!changed_.WaitUntil(mutex_, deadline) && values_.empty()) return false;
    }
    *value = values_.back();
    values_.pop_back();
    return true;
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  std::vector<int> values_ ABSL_GUARDED_BY(mutex_);
};

TEST(MutexTest, HandsValuesBetweenThreads) {
  constexpr int kThreads = 4, kEach = 500;
  Queue queue;
  std::vector<std::thread> threads;
  threads.reserve(kThreads);
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&queue] {
      for (int i = 1; i <= kEach; ++i) queue.Push(i);
    });
  }
  int64_t sum = 0;
  for (int i = 0; i < kThreads * kEach; ++i) sum += queue.Pop();
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(sum, int64_t{1} * kThreads * kEach * (kEach + 1) / 2);
}

TEST(MutexTest, AWaitEndsAtItsDeadline) {
  Queue queue;
  int value = 0;
  EXPECT_FALSE(queue.PopBefore(std::chrono::steady_clock::now(), &value));
  queue.Push(3);
  EXPECT_TRUE(queue.PopBefore(std::chrono::steady_clock::now() + std::chrono::hours(1), &value));
  EXPECT_EQ(value, 3);
}

// Whether another thread could take the mutex now.
bool IsFree(Mutex& mutex) {
  bool taken = false;
  std::thread([&] {
    if (mutex.TryLock()) {
      taken = true;
      mutex.Unlock();
    }
  }).join();
  return taken;
}

TEST(MutexTest, TryLockFailsWhileHeld) {
  Mutex mutex;
  {
    MutexLock lock(mutex);
    EXPECT_FALSE(IsFree(mutex));
  }
  EXPECT_TRUE(IsFree(mutex));
}

}  // namespace
}  // namespace sightline
