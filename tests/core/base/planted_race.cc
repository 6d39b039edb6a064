// SPDX-License-Identifier: Apache-2.0
//
// Two blocks of one loop write the same variable without a lock. ctest passes when the thread
// sanitizer says so: the annotations of the TBB seam order callers and bodies, and must not order
// bodies among themselves.
#include <atomic>
#include <cstdio>

#include "core/base/parallel.h"

namespace {
// Volatile, so that each increment is an access of its own: of two accesses at the very same
// instant the sanitizer may see neither, of many thousands it sees some.
volatile long long shared_total = 0;
}  // namespace

int main() {
  sightline::ThreadPool pool(2);
  std::atomic<int> inside{0};
  pool.ParallelFor(2, 1, [&](size_t, size_t) {
    // Both blocks are in flight before either writes, so each is on a thread of its own. Relaxed:
    // orders nothing else.
    inside.fetch_add(1, std::memory_order_relaxed);
    while (inside.load(std::memory_order_relaxed) < 2) {
    }
    for (int i = 0; i < 100000; ++i) shared_total = shared_total + 1;
  });
  std::printf("total %lld\n", static_cast<long long>(shared_total));
  return 0;
}
