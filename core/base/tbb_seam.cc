// SPDX-License-Identifier: Apache-2.0
#include "core/base/tbb_seam.h"

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/global_control.h>
#include <oneapi/tbb/info.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>
#include <oneapi/tbb/task_arena.h>

#include <new>

namespace sightline::tbb_seam {
namespace {

// TBB lends all arenas together no more workers than the machine has cores, unless told otherwise.
// A pool that was asked for more threads gets them (the tests compare answers over thread counts on
// small machines). Workers are made when first needed, so a high limit costs nothing; of several
// controls TBB takes the lowest, hence one for all pools.
constexpr size_t kMaxWorkers = 1024;

void LiftWorkerLimit() {
  // Never destroyed: pools with static storage may outlive anything with a destructor.
  using Control = oneapi::tbb::global_control;
  alignas(Control) static unsigned char storage[sizeof(Control)];
  static const bool lifted =
      (new (storage) Control(Control::max_allowed_parallelism, kMaxWorkers), true);
  (void)lifted;
}

}  // namespace

class Arena {
 public:
  // No place is reserved for callers: submitted tasks may use every thread of the pool.
  explicit Arena(int threads) : arena(threads, /*reserved_for_masters=*/0) {}
  oneapi::tbb::task_arena arena;
};

int HardwareThreads() { return oneapi::tbb::info::default_concurrency(); }

Arena* CreateArena(int threads) {
  LiftWorkerLimit();
  return new Arena(threads);
}

void DestroyArena(Arena* arena) { delete arena; }

void Execute(Arena* arena, Call call, void* context) {
  arena->arena.execute([call, context] { call(context); });
}

void Enqueue(Arena* arena, Call call, void* context) {
  arena->arena.enqueue([call, context] { call(context); });
}

void For(size_t n, RangeCall call, void* context) {
  oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<size_t>(0, n),
                            [call, context](const oneapi::tbb::blocked_range<size_t>& range) {
                              call(context, range.begin(), range.end());
                            });
}

void Invoke(Call first, void* first_context, Call second, void* second_context) {
  oneapi::tbb::parallel_invoke([=] { first(first_context); }, [=] { second(second_context); });
}

}  // namespace sightline::tbb_seam
