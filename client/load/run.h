// SPDX-License-Identifier: Apache-2.0
//
// The whole of `sightline-load` as a function, so that tests run it in their own process.
//
// Thread safety: calls may run side by side, each with streams of its own.
//
//   int exit_code = RunLoad({"--scene", "builtin:hall"}, std::cout, std::cerr, true);
#ifndef SIGHTLINE_CLIENT_LOAD_RUN_H_
#define SIGHTLINE_CLIENT_LOAD_RUN_H_

#include <atomic>
#include <ostream>
#include <string>
#include <vector>

namespace sightline::load {

// Beside those of client/cli/exit_code.h.
inline constexpr int kExitMissed = 1;  // The objective was not met.
inline constexpr int kExitWrong = 76;  // Answers were wrong.

// `args` without the program's name. The report goes to `out`; errors (one line), warnings and the
// live line (only if `err_is_terminal`) to `err`. Once `interrupted` (may be null) is
// set, a run ends early, and is reported; what comes before one is given up.
int RunLoad(const std::vector<std::string>& args, std::ostream& out, std::ostream& err,
            bool err_is_terminal = false, const std::atomic<bool>* interrupted = nullptr);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_RUN_H_
