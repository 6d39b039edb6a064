// SPDX-License-Identifier: Apache-2.0
//
// Where running out of memory ends: what a request needed is given back with its stack, and its
// status says so. The rest of the server goes on. Around what may need much for one request;
// elsewhere a failed allocation ends the process, as it should.
//
// Thread safety: functions only.
//
//   absl::Status status = GuardMemory([&] { return work->RunPart(part, ...); });
#ifndef SIGHTLINE_SERVER_BASE_MEMORY_GUARD_H_
#define SIGHTLINE_SERVER_BASE_MEMORY_GUARD_H_

#include <new>
#include <type_traits>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/base/error.h"

namespace sightline {

// Others' requests give memory back within about this long.
inline constexpr absl::Duration kOutOfMemoryRetry = absl::Seconds(1);

// What `run` returns (an absl::Status or StatusOr), or RESOURCE_EXHAUSTED
// (OUT_OF_MEMORY_BUDGET, with a retry delay) when memory ran out in it.
template <typename Run>
std::invoke_result_t<Run> GuardMemory(const Run& run) {
  try {
    return run();
  } catch (const std::bad_alloc&) {
    return WithRetryDelay(
        MakeError(absl::StatusCode::kResourceExhausted, v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET,
                  "the server ran out of memory in this request: ask for less at once, or later",
                  {{"limit", "memory of the process"}}),
        kOutOfMemoryRetry);
  }
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_MEMORY_GUARD_H_
