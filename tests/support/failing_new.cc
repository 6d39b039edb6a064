// SPDX-License-Identifier: Apache-2.0
#include "tests/support/failing_new.h"

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <new>

namespace sightline::testing_support {
namespace {

constexpr int kNever = -1;
// Allocations before the one that fails; kNever: none does, any more or at all.
thread_local int left = kNever;
// By all threads.
std::atomic<int64_t> held{0}, most_held{0};

void Hold(int64_t bytes) {
  const int64_t now = held.fetch_add(bytes, std::memory_order_relaxed) + bytes;
  int64_t most = most_held.load(std::memory_order_relaxed);
  while (now > most && !most_held.compare_exchange_weak(most, now, std::memory_order_relaxed)) {
  }
}

void Free(void* memory) {
  if (memory != nullptr) Hold(-static_cast<int64_t>(malloc_usable_size(memory)));
  std::free(memory);
}

}  // namespace

FailingNew::FailingNew(int allocations_before) { left = allocations_before; }
FailingNew::~FailingNew() { left = kNever; }
bool FailingNew::met() const { return left == kNever; }

HeldByNew::HeldByNew() : before_(held) { most_held = before_; }
int64_t HeldByNew::most() const { return most_held - before_; }

}  // namespace sightline::testing_support

void* operator new(size_t bytes, const std::nothrow_t&) noexcept {
  using namespace sightline::testing_support;  // NOLINT
  if (left != kNever && left-- == 0) return nullptr;
  void* const memory = std::malloc(std::max<size_t>(bytes, 1));
  if (memory != nullptr) Hold(static_cast<int64_t>(malloc_usable_size(memory)));
  return memory;
}
void* operator new(size_t bytes) {
  void* const memory = ::operator new(bytes, std::nothrow);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void operator delete(void* memory) noexcept { sightline::testing_support::Free(memory); }
void operator delete(void* memory, size_t) noexcept { sightline::testing_support::Free(memory); }
