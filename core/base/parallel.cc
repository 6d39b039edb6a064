// SPDX-License-Identifier: Apache-2.0
#include "core/base/parallel.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "core/base/check.h"
#include "core/base/float_environment.h"
#include "core/base/tbb_seam.h"

#if defined(__SANITIZE_THREAD__)
#define SIGHTLINE_UNDER_TSAN 1
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define SIGHTLINE_UNDER_TSAN 1
#endif
#endif
#if defined(SIGHTLINE_UNDER_TSAN)
#include <sanitizer/tsan_interface.h>
#endif

namespace sightline {
namespace {

constexpr int kMaxThreads = 1000;

// One direction of a hand-over between threads, told to the thread sanitizer: whatever happened
// before a Release is seen after a later Acquire. TBB does the real synchronization. Costs nothing
// elsewhere.
class HandOver {
 public:
#if defined(SIGHTLINE_UNDER_TSAN)
  void Release() { __tsan_release(&address_); }
  void Acquire() { __tsan_acquire(&address_); }

 private:
  char address_ = 0;
#else
  void Release() {}
  void Acquire() {}
#endif
};

// A loop on its way through the seam. Lives on the caller's stack until the loop is done.
struct Loop {
  size_t n;
  size_t grain;
  BlockFn body;
  const CancelToken* cancel;
  HandOver begin;
  HandOver end;

  size_t blocks() const { return n / grain + (n % grain != 0); }

  void RunBlocks(size_t first, size_t last) {
    ScopedFloatEnvironment environment;
    for (size_t block = first; block < last; ++block) {
      if (cancel != nullptr && cancel->cancelled()) return;
      const size_t from = block * grain;
      body(from, std::min(grain, n - from) + from);
    }
  }

  static void RunRange(void* context, size_t first, size_t last) {
    Loop& loop = *static_cast<Loop*>(context);
    loop.begin.Acquire();
    loop.RunBlocks(first, last);
    loop.end.Release();
  }

  // In the arena of the calling thread.
  void Run() {
    if (n == 0) return;
    if (blocks() == 1) return RunBlocks(0, 1);
    begin.Release();
    tbb_seam::For(blocks(), &RunRange, this);
    end.Acquire();
  }
};

// One of two functions run by ParallelInvoke.
struct Branch {
  absl::FunctionRef<void()> function;
  HandOver begin;
  HandOver end;

  static void Run(void* context) {
    Branch& branch = *static_cast<Branch*>(context);
    branch.begin.Acquire();
    {
      ScopedFloatEnvironment environment;
      branch.function();
    }
    branch.end.Release();
  }
};

int ResolveThreads(int threads) {
  SIGHTLINE_CHECK_GE(threads, 0);
  SIGHTLINE_CHECK_LE(threads, kMaxThreads);
  return threads == 0 ? std::min(kMaxThreads, tbb_seam::HardwareThreads()) : threads;
}

}  // namespace

struct ThreadPool::Submitted {
  ThreadPool* pool;
  absl::AnyInvocable<void()> task;
  HandOver begin;
};

ThreadPool::ThreadPool(int threads)
    : threads_(ResolveThreads(threads)), arena_(tbb_seam::CreateArena(threads_)) {}

ThreadPool::~ThreadPool() {
  {
    MutexLock lock(mutex_);
    while (pending_ > 0) idle_.Wait(mutex_);
  }
  tbb_seam::DestroyArena(arena_);
}

void ThreadPool::ParallelFor(size_t n, size_t grain, BlockFn body, const CancelToken* cancel) {
  SIGHTLINE_CHECK_GT(grain, 0u);
  // The whole loop may be run for us by a worker when every place of the arena is taken.
  struct Entry {
    Loop loop;
    HandOver begin;
    HandOver end;
  } entry{{n, grain, body, cancel, {}, {}}, {}, {}};
  entry.begin.Release();
  tbb_seam::Execute(
      arena_,
      [](void* context) {
        Entry& entry = *static_cast<Entry*>(context);
        entry.begin.Acquire();
        entry.loop.Run();
        entry.end.Release();
      },
      &entry);
  entry.end.Acquire();
}

void ThreadPool::Submit(absl::AnyInvocable<void()> task) {
  auto submitted = std::make_unique<Submitted>(Submitted{this, std::move(task), {}});
  {
    MutexLock lock(mutex_);
    ++pending_;
  }
  submitted->begin.Release();
  tbb_seam::Enqueue(arena_, &RunSubmitted, submitted.release());
}

void ThreadPool::RunSubmitted(void* context) {
  std::unique_ptr<Submitted> submitted(static_cast<Submitted*>(context));
  submitted->begin.Acquire();
  ThreadPool* const pool = submitted->pool;
  {
    ScopedFloatEnvironment environment;
    submitted->task();
  }
  // What the task captured is destroyed before the destructor of the pool can return.
  submitted.reset();
  MutexLock lock(pool->mutex_);
  if (--pool->pending_ == 0) pool->idle_.SignalAll();
}

void ParallelFor(size_t n, size_t grain, BlockFn body, const CancelToken* cancel) {
  SIGHTLINE_CHECK_GT(grain, 0u);
  Loop{n, grain, body, cancel, {}, {}}.Run();
}

void ParallelInvoke(absl::FunctionRef<void()> first, absl::FunctionRef<void()> second) {
  Branch a{first, {}, {}};
  Branch b{second, {}, {}};
  a.begin.Release();
  b.begin.Release();
  tbb_seam::Invoke(&Branch::Run, &a, &Branch::Run, &b);
  a.end.Acquire();
  b.end.Acquire();
}

}  // namespace sightline
