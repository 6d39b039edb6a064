// SPDX-License-Identifier: Apache-2.0
//
// sightline: the command line tool. See `sightline help`.
#include <unistd.h>

#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "client/cli/interruption.h"
#include "client/cli/run.h"
#include "client/cli/signal_watch.h"

int main(int argc, char** argv) {
  // A closed pipe shows as a failed write, with an exit code of ours.
  std::signal(SIGPIPE, SIG_IGN);
  std::ios::sync_with_stdio(false);
  const bool err_is_terminal = ::isatty(STDERR_FILENO) != 0;
  sightline::cli::Interruption interruption;
  const sightline::cli::SignalWatch watch(err_is_terminal, [&] { interruption.Interrupt(); });
  return sightline::cli::RunCli(std::vector<std::string>(argv + 1, argv + argc), std::cout,
                                std::cerr, err_is_terminal, &interruption);
}
