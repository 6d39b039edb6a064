// SPDX-License-Identifier: Apache-2.0
//
// Memory for large arrays, aligned to cache lines, on huge pages where the system lends them on
// request (Linux's "madvise" setting): a walk through a tree of many megabytes otherwise misses the
// TLB at every step.
//
// Thread safety: functions may be called from any thread.
#ifndef SIGHTLINE_CORE_BASE_ARRAY_MEMORY_H_
#define SIGHTLINE_CORE_BASE_ARRAY_MEMORY_H_

#include <cstddef>

namespace sightline {

inline constexpr size_t kArrayAlignment = 64;

// `bytes` > 0 of memory that hold whatever they hold. Throws std::bad_alloc when there are none.
void* AllocateArray(size_t bytes);
// What AllocateArray(bytes) gave, or null.
void FreeArray(void* array, size_t bytes);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_ARRAY_MEMORY_H_
