// SPDX-License-Identifier: Apache-2.0
#include "core/base/parallel.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <memory>
#include <utility>

#include "core/base/check.h"
#include "core/base/float_environment.h"
#include "core/base/hand_over.h"
#include "core/base/tbb_seam.h"

namespace sightline {
namespace {

constexpr int kMaxThreads = 1000;

// The call of a function on a thread of TBB's choice, handed over both ways. Exceptions are carried
// by us, so that TBB, which the sanitizer does not see, never holds one.
class Transfer {
 public:
  // On the calling thread, before it goes through the seam.
  void Send() { begin_.Release(); }

  // On whichever thread runs `function`; on several of them, for a loop.
  template <typename Function>
  void Run(Function function) {
    begin_.Acquire();
    try {
      function();
    } catch (...) {
      if (!failed_.exchange(true, std::memory_order_relaxed)) error_ = std::current_exception();
    }
    end_.Release();
  }

  // On the calling thread, once the seam has returned.
  void Receive() {
    end_.Acquire();
    if (error_) std::rethrow_exception(std::move(error_));
  }

  // The same, when an exception is already on its way to the caller.
  void ReceiveAndDrop() {
    end_.Acquire();
    error_ = nullptr;
  }

  bool failed() const { return failed_.load(std::memory_order_relaxed); }

 private:
  HandOver begin_;
  HandOver end_;
  std::atomic<bool> failed_{false};
  std::exception_ptr error_;  // Written by the first to set failed_, read after the end.
};

// A loop on its way through the seam. Lives on the caller's stack until the loop is done.
struct Loop {
  const size_t n;
  const size_t grain;
  const BlockFn body;
  const CancelToken* const cancel;
  Transfer transfer = {};

  size_t blocks() const { return n / grain + (n % grain != 0); }

  void RunBlocks(size_t first, size_t last) {
    ScopedFloatEnvironment environment;
    for (size_t block = first; block < last; ++block) {
      if (transfer.failed() || (cancel != nullptr && cancel->cancelled())) return;
      const size_t from = block * grain;
      body(from, from + std::min(grain, n - from));
    }
  }

  // In the arena of the calling thread.
  void Run() {
    if (n == 0) return;
    if (blocks() == 1) return RunBlocks(0, 1);
    transfer.Send();
    tbb_seam::For(
        blocks(),
        [](void* context, size_t first, size_t last) {
          Loop& loop = *static_cast<Loop*>(context);
          loop.transfer.Run([&] { loop.RunBlocks(first, last); });
        },
        this);
    transfer.Receive();
  }
};

// A whole function on its way through the seam.
struct Errand {
  const absl::FunctionRef<void()> function;
  Transfer transfer = {};

  static void Run(void* context) {
    Errand& errand = *static_cast<Errand*>(context);
    errand.transfer.Run([&] {
      ScopedFloatEnvironment environment;
      errand.function();
    });
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
  Loop loop{n, grain, body, cancel};
  const auto run = [&loop] { loop.Run(); };
  // A worker runs the whole loop for us when every place of the arena is taken.
  Errand errand{run};
  errand.transfer.Send();
  tbb_seam::Execute(arena_, &Errand::Run, &errand);
  errand.transfer.Receive();
}

void ThreadPool::Submit(absl::AnyInvocable<void()> task) {
  auto submitted = std::make_unique<Submitted>(Submitted{this, std::move(task), {}});
  {
    MutexLock lock(mutex_);
    ++pending_;
  }
  submitted->begin.Release();
  try {
    tbb_seam::Enqueue(arena_, &RunSubmitted, submitted.get());
  } catch (...) {  // No memory for it: nobody will run it.
    EndSubmitted();
    throw;
  }
  (void)submitted.release();  // The worker's, who may be done with it already.
}

void ThreadPool::EndSubmitted() {
  MutexLock lock(mutex_);
  if (--pending_ == 0) idle_.SignalAll();
}

void ThreadPool::RunSubmitted(void* context) noexcept {
  std::unique_ptr<Submitted> submitted(static_cast<Submitted*>(context));
  submitted->begin.Acquire();
  ThreadPool* const pool = submitted->pool;
  {
    ScopedFloatEnvironment environment;
    submitted->task();
  }
  // What the task captured is destroyed before the destructor of the pool can return.
  submitted.reset();
  pool->EndSubmitted();
}

void ParallelFor(size_t n, size_t grain, BlockFn body, const CancelToken* cancel) {
  SIGHTLINE_CHECK_GT(grain, 0u);
  Loop{n, grain, body, cancel}.Run();
}

void ParallelInvoke(absl::FunctionRef<void()> first, absl::FunctionRef<void()> second) {
  Errand a{first};
  Errand b{second};
  a.transfer.Send();
  b.transfer.Send();
  tbb_seam::Invoke(&Errand::Run, &a, &Errand::Run, &b);
  // Both are received before an exception leaves: each hand-over has two ends.
  try {
    a.transfer.Receive();
  } catch (...) {
    b.transfer.ReceiveAndDrop();
    throw;
  }
  b.transfer.Receive();
}

}  // namespace sightline
