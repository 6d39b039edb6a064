// SPDX-License-Identifier: Apache-2.0
//
// How `sightline` ends, for scripts: the numbers of BSD's sysexits.h.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_CLI_EXIT_CODE_H_
#define SIGHTLINE_CLIENT_CLI_EXIT_CODE_H_

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace sightline::cli {

enum ExitCode : int {
  kExitOk = 0,
  kExitUsage = 64,         // The command line makes no sense.
  kExitData = 65,          // A file or a value given is bad, or passes a limit.
  kExitNoInput = 66,       // A file cannot be read; the server has no such scene, or refuses.
  kExitUnavailable = 69,   // No connection to the server; trying again may help.
  kExitInternal = 70,      // A bug of ours.
  kExitCannotCreate = 73,  // An output file cannot be written.
  kExitTemporary = 75,     // The server was busy, time ran out, or a signal came.
  // 78 is core/base/cpu_check.h's: the processor cannot run the program. No code of ours ran then.
};

// The table of exit codes, for --help.
absl::string_view ExitCodeHelp();

// `status` marked to end with `code`, whatever its own code says. OK stays OK.
absl::Status WithExitCode(absl::Status status, ExitCode code);

// INVALID_ARGUMENT marked as a mistake of the command line.
absl::Status UsageError(absl::string_view message);

ExitCode ToExitCode(const absl::Status& status);

// Whether `status` may come of a command's having been given up: it was cancelled, or cut off from
// a server, or may be well another time. What is wrong with a command line, a file or an answer
// is not of that kind, whenever the signal came.
bool MayComeOfInterruption(const absl::Status& status);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_EXIT_CODE_H_
