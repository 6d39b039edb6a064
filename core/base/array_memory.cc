// SPDX-License-Identifier: Apache-2.0
#include "core/base/array_memory.h"

#include <malloc.h>
#include <sys/mman.h>

#include <new>

namespace sightline {
namespace {

constexpr size_t kHugePage = size_t{1} << 21;

std::align_val_t AlignmentOf(size_t bytes) {
  return std::align_val_t{bytes >= kHugePage ? kHugePage : kArrayAlignment};
}

}  // namespace

void* AllocateArray(size_t bytes) {
  void* const array = ::operator new(bytes, AlignmentOf(bytes));
  // The last page is left small where the array does not fill it. That it may be refused does not
  // matter.
  if (bytes >= kHugePage) (void)madvise(array, bytes / kHugePage * kHugePage, MADV_HUGEPAGE);
  return array;
}

void FreeArray(void* array, size_t bytes) { ::operator delete(array, AlignmentOf(bytes)); }

void ReturnFreeMemory() { (void)malloc_trim(0); }

}  // namespace sightline
