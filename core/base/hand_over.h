// SPDX-License-Identifier: Apache-2.0
//
// Tells the thread sanitizer of an order that it cannot see, because a library that is not built
// for it (Debian's TBB, Debian's gRPC) does the synchronizing. Whatever happened before a Release
// is seen after a later Acquire of the same object. It synchronizes nothing by itself, and costs
// nothing in other builds.
//
// Use it only where the library promises the order: TBB between a loop's caller and its bodies,
// gRPC between the call that starts an operation and the reaction that ends it. A wrong
// announcement hides a race.
//
// Thread safety: both methods may be called from any thread.
//
//   order_.Release();          // Everything the reaction will look at is written.
//   StartWrite(&message_);
//   ...
//   void OnWriteDone(bool ok) override {
//     order_.Acquire();
#ifndef SIGHTLINE_CORE_BASE_HAND_OVER_H_
#define SIGHTLINE_CORE_BASE_HAND_OVER_H_

#include <cstdint>

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

class HandOver {
 public:
#if defined(SIGHTLINE_UNDER_TSAN)
  void Release() { __tsan_release(&address_); }
  void Acquire() { __tsan_acquire(&address_); }

 private:
  uint64_t address_ = 0;  // As wide as the sanitizer's own granule.
#else
  void Release() {}
  void Acquire() {}
#endif
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_HAND_OVER_H_
