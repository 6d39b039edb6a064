// SPDX-License-Identifier: Apache-2.0
#include "tests/support/failing_new.h"

#include <cstddef>
#include <cstdlib>
#include <new>

namespace sightline::testing_support {
namespace {

constexpr int kNever = -1;
// Allocations before the one that fails; kNever: none does, any more or at all.
thread_local int left = kNever;

}  // namespace

FailingNew::FailingNew(int allocations_before) { left = allocations_before; }
FailingNew::~FailingNew() { left = kNever; }
bool FailingNew::met() const { return left == kNever; }

}  // namespace sightline::testing_support

void* operator new(size_t bytes) {
  using sightline::testing_support::left;
  if (left != sightline::testing_support::kNever && left-- == 0) throw std::bad_alloc();
  if (void* const memory = std::malloc(bytes > 0 ? bytes : 1); memory != nullptr) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, size_t) noexcept { std::free(memory); }
