// SPDX-License-Identifier: Apache-2.0
//
// The functions of oneTBB that parallel.cc uses, behind plain function pointers. Private to
// core/base: everybody else includes parallel.h.
//
// tbb_seam.cc is the only source that includes TBB, and is compiled without the thread sanitizer,
// so that nothing of TBB is half seen by it. Nothing but TBB belongs there: it would go unchecked.
//
// Thread safety: every function may be called from any thread; an arena is destroyed once, when
// idle.
#ifndef SIGHTLINE_CORE_BASE_TBB_SEAM_H_
#define SIGHTLINE_CORE_BASE_TBB_SEAM_H_

#include <cstddef>

namespace sightline::tbb_seam {

class Arena;  // A tbb::task_arena.

using Call = void (*)(void* context);
using RangeCall = void (*)(void* context, size_t begin, size_t end);

int HardwareThreads();

// An arena in which up to `threads` threads work at once, callers of Execute included.
Arena* CreateArena(int threads);
void DestroyArena(Arena* arena);

// Runs `call` within the arena and returns when it is done: on this thread where a place is free.
void Execute(Arena* arena, Call call, void* context);
// Has a worker of the arena run `call` later, and returns at once.
void Enqueue(Arena* arena, Call call, void* context);

// Covers [0, n) by calls over disjoint ranges, in the arena of the calling thread; returns when
// done.
void For(size_t n, RangeCall call, void* context);
// Runs both, perhaps at once; returns when both are done.
void Invoke(Call first, void* first_context, Call second, void* second_context);

}  // namespace sightline::tbb_seam

#endif  // SIGHTLINE_CORE_BASE_TBB_SEAM_H_
