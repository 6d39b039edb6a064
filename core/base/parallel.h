// SPDX-License-Identifier: Apache-2.0
//
// Threads for the engine, by oneTBB: a pool of bounded width, loops, pairs, and tasks to run later.
//
// - Every body and task runs under ScopedFloatEnvironment, on the calling thread too.
// - A loop is cut into fixed blocks: body(begin, end) is called once for each
//   [k·grain, min(n, (k+1)·grain)), whatever the number of threads. Reductions over blocks in their
//   order are therefore the same on every machine.
// - What happened before a call is seen by its bodies, and
//   what they did is seen after it; the thread sanitizer is
//   told so, since Debian's TBB is not built for it. Bodies
//   of one loop are not ordered.
// - Loops nest. A thread that waits for a loop may run other
//   blocks of the same pool meanwhile: hold no mutex across
//   ParallelFor or ParallelInvoke.
// - Bodies and tasks return their errors through what they capture.
//   An exception out of a loop's body ends the loop and reaches its
//   caller; one out of a submitted task ends the process.
//
// Thread safety: every method may be called from any thread. ~ThreadPool must not run on one of the
// pool's own threads, nor while another thread still calls a method.
//
//   ThreadPool pool(0);
//   pool.ParallelFor(rays.size(), 256, [&](size_t begin, size_t end) {
//     for (size_t i = begin; i < end; ++i) hits[i] = Trace(rays[i]);
//   }, &cancel);
//   if (cancel.cancelled()) return cancel.ToStatus();
#ifndef SIGHTLINE_CORE_BASE_PARALLEL_H_
#define SIGHTLINE_CORE_BASE_PARALLEL_H_

#include <cstddef>

#include "absl/functional/any_invocable.h"
#include "absl/functional/function_ref.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"

namespace sightline {

namespace tbb_seam {
class Arena;
}

using BlockFn = absl::FunctionRef<void(size_t begin, size_t end)>;

class ThreadPool {
 public:
  // Up to `threads` threads work at once; 0 means one per hardware thread.
  // REQUIRES: 0 <= threads <= 1000.
  explicit ThreadPool(int threads);
  // Waits until every submitted task has run.
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int threads() const { return threads_; }

  // Covers [0, n) and returns when done. Blocks that have not begun when `cancel` fires are left
  // out: the caller asks the token afterwards. On a thread of this pool it takes part in the loop
  // itself. REQUIRES: grain > 0.
  void ParallelFor(size_t n, size_t grain, BlockFn body, const CancelToken* cancel = nullptr);

  // Has the pool run `task` later and returns at once. Tasks begin about in the order of
  // submission. Where memory runs out it throws, and the task is gone.
  void Submit(absl::AnyInvocable<void()> task);

 private:
  struct Submitted;
  static void RunSubmitted(void* context) noexcept;
  void EndSubmitted() ABSL_LOCKS_EXCLUDED(mutex_);

  const int threads_;
  tbb_seam::Arena* const arena_;
  Mutex mutex_;
  CondVar idle_;
  size_t pending_ ABSL_GUARDED_BY(mutex_) = 0;  // Submitted and not yet done.
};

// The same loop within the pool that the calling thread works for; on any other thread, within
// TBB's default arena. For code below the level that owns the pool.
void ParallelFor(size_t n, size_t grain, BlockFn body, const CancelToken* cancel = nullptr);

// Runs both, perhaps at once, and returns when both are done. For recursive builders.
void ParallelInvoke(absl::FunctionRef<void()> first, absl::FunctionRef<void()> second);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_PARALLEL_H_
