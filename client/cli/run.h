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

namespace sightline::cli {

// `args` without the program's name. Results go to `out`; errors (one line), warnings and progress
// (only if `err_is_terminal`) to `err`. Returns the exit code (exit_code.h).
int RunCli(const std::vector<std::string>& args, std::ostream& out, std::ostream& err,
           bool err_is_terminal = false);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_RUN_H_
