// SPDX-License-Identifier: Apache-2.0
//
// A task for which there is no memory is gone, and its pool can end. TBB's own allocations cannot
// be made to fail from here, so the linker puts a function of the test's in the place of the seam's
// (--wrap, CMakeLists.txt).
#include <atomic>
#include <memory>
#include <new>

#include "core/base/parallel.h"
#include "core/base/tbb_seam.h"
#include "gtest/gtest.h"

namespace {

std::atomic<bool> out_of_memory{false};

}  // namespace

namespace sightline::tbb_seam {

void RealEnqueue(Arena* arena, Call call,
                 void* context) asm("__real__ZN9sightline8tbb_seam7EnqueueEPNS0_5ArenaEPFvPvES3_");
void WrappedEnqueue(Arena* arena, Call call, void* context) asm(
    "__wrap__ZN9sightline8tbb_seam7EnqueueEPNS0_5ArenaEPFvPvES3_");

void WrappedEnqueue(Arena* arena, Call call, void* context) {
  if (out_of_memory) throw std::bad_alloc();
  RealEnqueue(arena, call, context);
}

}  // namespace sightline::tbb_seam

namespace sightline {
namespace {

TEST(SubmitMemoryTest, ATaskThatCannotBeSubmittedIsGoneAndHoldsNothingUp) {
  const auto captured = std::make_shared<int>(0);
  std::atomic<int> runs{0};
  {
    ThreadPool pool(2);
    pool.Submit([captured, &runs] { ++runs; });
    out_of_memory = true;
    EXPECT_THROW(pool.Submit([captured, &runs] { ++runs; }), std::bad_alloc);
    out_of_memory = false;
    pool.Submit([captured, &runs] { ++runs; });
  }  // Waits for those two alone.
  EXPECT_EQ(runs, 2);
  EXPECT_EQ(captured.use_count(), 1);
}

}  // namespace
}  // namespace sightline
