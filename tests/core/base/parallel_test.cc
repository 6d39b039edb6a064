// SPDX-License-Identifier: Apache-2.0
#include "core/base/parallel.h"

#include <pmmintrin.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <set>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/aligned_vector.h"
#include "core/base/float_environment.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using Blocks = std::set<std::pair<size_t, size_t>>;

// Waits until `count` has reached `n`, and sees what was done before it was raised. What never
// comes is a failure, not a test that hangs: no machine is so slow.
void SpinUntil(const std::atomic<int>& count, int n) {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(2);
  while (count.load(std::memory_order_acquire) < n) {
    if (std::chrono::steady_clock::now() > deadline) {
      ADD_FAILURE() << count << " of " << n << " came within two minutes";
      return;
    }
    std::this_thread::yield();
  }
}

class ParallelForTest : public testing::TestWithParam<int> {};

TEST_P(ParallelForTest, CallsOncePerFixedBlock) {
  ThreadPool pool(GetParam());
  EXPECT_EQ(pool.threads(), GetParam());
  for (size_t n : {0, 1, 7, 64, 65, 1000}) {
    for (size_t grain : {1, 7, 64, 5000}) {
      Blocks expected, seen;
      for (size_t begin = 0; begin < n; begin += grain) {
        expected.emplace(begin, std::min(n, begin + grain));
      }
      Mutex mutex;
      pool.ParallelFor(n, grain, [&](size_t begin, size_t end) {
        MutexLock lock(mutex);
        EXPECT_TRUE(seen.emplace(begin, end).second) << begin << " came twice";
      });
      EXPECT_EQ(seen, expected) << "n " << n << " grain " << grain;
    }
  }
}

TEST_P(ParallelForTest, WritesAreSeenOnBothSidesWithoutLocks) {
  ThreadPool pool(GetParam());
  constexpr size_t kCount = 20000;
  std::vector<int> in(kCount), out(kCount);
  for (size_t i = 0; i < kCount; ++i) in[i] = static_cast<int>(i);
  for (int round = 0; round < 3; ++round) {
    pool.ParallelFor(kCount, 100, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) out[i] = 2 * in[i];
    });
    for (size_t i = 0; i < kCount; ++i) ASSERT_EQ(out[i], 2 * in[i]);
    for (size_t i = 0; i < kCount; ++i) in[i] = out[i] / 2 + 1;
  }
}

TEST_P(ParallelForTest, Nests) {
  ThreadPool pool(GetParam());
  std::vector<int> counts(64 * 64, 0);
  pool.ParallelFor(64, 1, [&](size_t row, size_t) {
    ParallelFor(64, 3, [&, row](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) ++counts[64 * row + i];
    });
  });
  for (int count : counts) ASSERT_EQ(count, 1);
}

TEST_P(ParallelForTest, SubmittedTasksMayLoop) {
  std::atomic<int> total{0};
  {
    ThreadPool pool(GetParam());
    for (int task = 0; task < 20; ++task) {
      pool.Submit([&] {
        pool.ParallelFor(100, 10,
                         [&](size_t begin, size_t end) { total += static_cast<int>(end - begin); });
      });
    }
  }
  EXPECT_EQ(total, 2000);
}

TEST_P(ParallelForTest, CallersFromManyThreadsShareThePool) {
  ThreadPool pool(GetParam());
  std::atomic<int> total{0};
  std::vector<std::thread> callers;
  callers.reserve(8);
  for (int caller = 0; caller < 6; ++caller) {
    callers.emplace_back([&] {
      pool.ParallelFor(1000, 10,
                       [&](size_t begin, size_t end) { total += static_cast<int>(end - begin); });
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_EQ(total, 6000);
}

INSTANTIATE_TEST_SUITE_P(Threads, ParallelForTest, testing::Values(1, 2, 3, 8));

TEST(ThreadPoolTest, ZeroMeansTheHardware) { EXPECT_GE(ThreadPool(0).threads(), 1); }

TEST(ThreadPoolTest, HasAsManyThreadsAsAskedForWhateverTheMachine) {
  constexpr int kThreads = 6;
  ThreadPool pool(kThreads);
  std::atomic<int> inside{0};
  pool.ParallelFor(kThreads, 1, [&](size_t, size_t) {
    ++inside;
    SpinUntil(inside, kThreads);  // Ends only if all blocks are in flight at once.
  });
  EXPECT_EQ(inside, kThreads);
}

TEST(ThreadPoolTest, SubmittedTasksUseEveryThread) {
  for (int threads : {1, 2, 4}) {
    std::atomic<int> inside{0};
    ThreadPool pool(threads);
    for (int task = 0; task < threads; ++task) {
      pool.Submit([&] {
        ++inside;
        SpinUntil(inside, threads);
      });
    }
    SpinUntil(inside, threads);
  }
}

TEST(ThreadPoolTest, NeverMoreThreadsAtOnceThanAskedFor) {
  std::atomic<int> inside{0}, most{0};
  ThreadPool pool(2);
  const auto enter = [&](size_t, size_t) {
    const int now = ++inside;
    int seen = most;
    while (now > seen && !most.compare_exchange_weak(seen, now)) {
    }
    for (int i = 0; i < 50; ++i) std::this_thread::yield();
    --inside;
  };
  std::vector<std::thread> callers;
  callers.reserve(8);
  for (int caller = 0; caller < 4; ++caller) {
    callers.emplace_back([&] { pool.ParallelFor(50, 1, enter); });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_LE(most, 2);
}

TEST(ThreadPoolTest, SubmitReturnsBeforeTheTaskEnds) {
  std::atomic<int> released{0};
  std::vector<int> order;
  {
    ThreadPool pool(1);
    pool.Submit([&] {
      SpinUntil(released, 1);
      order.push_back(2);
    });
    order.push_back(1);
    released = 1;
  }
  EXPECT_EQ(order, (std::vector<int>{1, 2}));
}

TEST(ThreadPoolTest, TheDestructorWaitsForTasksThatSubmitTasks) {
  int done = 0;  // Only ever touched by the one thread of the pool, then by this one.
  {
    ThreadPool pool(1);
    pool.Submit([&] {
      ++done;
      pool.Submit([&] {
        ++done;
        pool.Submit([&] { ++done; });
      });
    });
  }
  EXPECT_EQ(done, 3);
}

TEST(ThreadPoolTest, WhatATaskCapturedIsGoneWhenThePoolIs) {
  auto owned = std::make_shared<int>(1);
  {
    ThreadPool pool(2);
    for (int i = 0; i < 100; ++i) pool.Submit([owned] { ASSERT_EQ(*owned, 1); });
  }
  EXPECT_EQ(owned.use_count(), 1);
}

TEST(ThreadPoolTest, ACancelledLoopLeavesBlocksOut) {
  ThreadPool pool(2);
  CancelToken cancel;
  std::atomic<int> blocks{0};
  pool.ParallelFor(
      1000000, 1,
      [&](size_t, size_t) {
        if (++blocks == 10) cancel.Cancel();
      },
      &cancel);
  EXPECT_GE(blocks, 10);
  EXPECT_LT(blocks, 1000000);

  int called = 0;
  ParallelFor(
      1, 1, [&](size_t, size_t) { ++called; }, &cancel);
  EXPECT_EQ(called, 0);
}

TEST(ThreadPoolTest, AnExceptionReachesTheCallerOfTheLoop) {
  ThreadPool pool(2);
  EXPECT_THROW(pool.ParallelFor(100, 1,
                                [](size_t begin, size_t) {
                                  if (begin == 50) throw std::runtime_error("from a body");
                                }),
               std::runtime_error);
  int after = 0;
  pool.ParallelFor(1, 1, [&](size_t, size_t) { ++after; });
  EXPECT_EQ(after, 1);
}

TEST(ThreadPoolTest, BodiesRunInTheEnginesFloatEnvironmentAndTheCallersComesBack) {
  const unsigned saved = _mm_getcsr();
  _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
  const unsigned before = _mm_getcsr() & ~_MM_EXCEPT_MASK;
  std::atomic<int> wrong{0};
  const auto check = [&] {
    if ((_mm_getcsr() & ~_MM_EXCEPT_MASK) != ScopedFloatEnvironment::kEngineMxcsr) ++wrong;
  };
  const auto check_block = [&](size_t, size_t) { check(); };
  {
    ThreadPool pool(3);
    pool.ParallelFor(100, 1, check_block);
    pool.ParallelFor(1, 1, check_block);
    ParallelFor(100, 1, check_block);
    ParallelInvoke(check, check);
    pool.Submit(check);
  }
  EXPECT_EQ(_mm_getcsr() & ~_MM_EXCEPT_MASK, before);
  _mm_setcsr(saved);
  EXPECT_EQ(wrong, 0);
}

int Fibonacci(int n) {
  if (n < 2) return n;
  int a = 0, b = 0;
  ParallelInvoke([&] { a = Fibonacci(n - 1); }, [&] { b = Fibonacci(n - 2); });
  return a + b;
}

TEST(ParallelInvokeTest, AnExceptionOfEitherReachesTheCallerOnceBothAreDone) {
  for (const bool first_throws : {false, true}) {
    for (const bool second_throws : {false, true}) {
      int done = 0, also_done = 0, caught = 0;
      try {
        ParallelInvoke(
            [&] {
              ++done;
              if (first_throws) throw std::runtime_error("first");
            },
            [&] {
              ++also_done;
              if (second_throws) throw std::runtime_error("second");
            });
      } catch (const std::runtime_error& error) {
        ++caught;
        EXPECT_STREQ(error.what(), first_throws ? "first" : "second");
      }
      EXPECT_EQ(caught, first_throws || second_throws);
      EXPECT_EQ(done + also_done, 2);
    }
  }
}

TEST(ParallelInvokeTest, RecursesWithinAPoolAndOutside) {
  ThreadPool pool(4);
  int inside = 0;
  pool.ParallelFor(1, 1, [&](size_t, size_t) { inside = Fibonacci(12); });
  EXPECT_EQ(inside, 144);
  EXPECT_EQ(Fibonacci(10), 55);
}

}  // namespace
}  // namespace sightline
