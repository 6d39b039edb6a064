// SPDX-License-Identifier: Apache-2.0
//
// Where running out of memory ends in the library's own threads: as a status of the query, which
// its caller can tell, and tidy up after. Out of a thread an exception would end the process.
//
// Thread safety: functions only.
//
//   absl::Status status = GuardMemory([&] { return on_part(std::move(part)); });
#ifndef SIGHTLINE_CLIENT_LIB_MEMORY_GUARD_H_
#define SIGHTLINE_CLIENT_LIB_MEMORY_GUARD_H_

#include <new>
#include <type_traits>

#include "absl/status/status.h"

namespace sightline::client {

// What `run` returns, an absl::Status or StatusOr; RESOURCE_EXHAUSTED when memory ran out in it.
template <typename Run>
std::invoke_result_t<Run> GuardMemory(const Run& run) {
  try {
    return run();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the answers: ask for fewer at once");
  }
}

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_MEMORY_GUARD_H_
