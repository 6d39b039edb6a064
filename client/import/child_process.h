// SPDX-License-Identifier: Apache-2.0
//
// Runs a function in a forked child process and hands back what it returns: a crash, an endless
// loop or a runaway allocation in a library becomes a Status here.
//
// The child is a copy of this process with this thread alone. The function may use the heap, but
// must not wait for another thread, nor for a lock that one may have held. It writes nothing but
// its result, and leaves by _exit: no destructors of globals, no flushed streams.
//
// Thread safety: may be called from any thread.
//
//   absl::StatusOr<std::string> bytes = RunInChild([&] { return Serialize(Parse(file)); }, limits);
#ifndef SIGHTLINE_CLIENT_IMPORT_CHILD_PROCESS_H_
#define SIGHTLINE_CLIENT_IMPORT_CHILD_PROCESS_H_

#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"

namespace sightline {

struct ChildLimits {
  double timeout_seconds = 300;
  // Bytes of address space beyond what the process has already. Not applied under the address or
  // thread sanitizer, which reserve terabytes.
  uint64_t memory_bytes = uint64_t{8} << 30;
  // The most that the child may hand back.
  uint64_t result_bytes = uint64_t{8} << 30;
  // Once it stops, the child is ended, and its status returned; may be null.
  const CancelToken* cancel = nullptr;
};

// DataLoss: the child died of a signal. DeadlineExceeded, ResourceExhausted: it went over a limit.
// Unavailable: it could not be started. An exception out of `work` is
// InvalidArgument with its message; length_error and bad_alloc are ResourceExhausted.
absl::StatusOr<std::string> RunInChild(absl::FunctionRef<std::string()> work,
                                       const ChildLimits& limits);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_CHILD_PROCESS_H_
