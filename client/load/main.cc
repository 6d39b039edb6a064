// SPDX-License-Identifier: Apache-2.0
//
// sightline-load: the load tester. See `sightline-load --help`.
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "client/cli/signal_watch.h"
#include "client/load/run.h"

int main(int argc, char** argv) {
  // A closed pipe shows as a failed write, with an exit code of ours.
  std::signal(SIGPIPE, SIG_IGN);
  const bool err_is_terminal = ::isatty(STDERR_FILENO) != 0;
  // The first signal ends the run, which is then reported, or gives up what comes before it, and
  // takes away what the test made on the server.
  std::atomic<bool> interrupted{false};
  const sightline::cli::SignalWatch watch(err_is_terminal, [&] { interrupted = true; });
  std::ios::sync_with_stdio(false);
  return sightline::load::RunLoad(std::vector<std::string>(argv + 1, argv + argc), std::cout,
                                  std::cerr, err_is_terminal, &interrupted);
}
