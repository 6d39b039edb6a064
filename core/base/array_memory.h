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

// Gives memory that was freed back to the system, as far as whole pages of it are free: each thread
// that ever allocated otherwise keeps the most that it once had. Takes milliseconds; for the end of
// large works that come now and then, such as letting go of a scene.
void ReturnFreeMemory();

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_ARRAY_MEMORY_H_
