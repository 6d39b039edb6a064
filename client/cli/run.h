// SPDX-License-Identifier: Apache-2.0
//
// The whole of `sightline` as a function, so that tests run commands in their own process.
//
// Thread safety: calls may run side by side, each with streams of its own.
//
//   int exit_code = RunCli({"view", "builtin:hall", "--out", "hall.png"}, std::cout, std::cerr,
//   true);
#ifndef SIGHTLINE_CLIENT_CLI_RUN_H_
#define SIGHTLINE_CLIENT_CLI_RUN_H_

#include <ostream>
#include <string>
#include <vector>

#include "client/cli/interruption.h"

namespace sightline::cli {

// `args` without the program's name. Results go to `out`; errors (one line), warnings and progress
// (only if `err_is_terminal`) to `err`. Returns the exit code (exit_code.h). Once `interruption`
// (may be null) comes, the command gives up what it is about, takes away what it made on a server,
// and returns kExitTemporary; an error that has nothing to do with that is told all the same.
int RunCli(const std::vector<std::string>& args, std::ostream& out, std::ostream& err,
           bool err_is_terminal = false, Interruption* interruption = nullptr);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_RUN_H_
