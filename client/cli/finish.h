// SPDX-License-Identifier: Apache-2.0
//
// How a tool ends: its status as one line on standard error and an exit code (exit_code.h). The one
// boundary at which libraries' exceptions end.
//
// Thread safety: free functions.
//
//   return RunAndFinish("sightline-load", out, err, [&] { return Load(args); });
#ifndef SIGHTLINE_CLIENT_CLI_FINISH_H_
#define SIGHTLINE_CLIENT_CLI_FINISH_H_

#include <ostream>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace sightline::cli {

// Tells `status` as `name`'s, after `out` was flushed: output that cannot be written is an error,
// too. Usage errors end with "see NAME --help".
int Finish(absl::Status status, absl::string_view name, std::ostream& out, std::ostream& err);

// Calls `run`, then Finish.
int RunAndFinish(absl::string_view name, std::ostream& out, std::ostream& err,
                 absl::FunctionRef<absl::Status()> run);

// What `run` returns; of an exception, what it stands for.
absl::Status WithoutExceptions(absl::FunctionRef<absl::Status()> run);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_FINISH_H_
