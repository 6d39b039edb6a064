// SPDX-License-Identifier: Apache-2.0
//
// sightline: the command line tool. See `sightline help`.
#include <unistd.h>

#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "client/cli/run.h"

int main(int argc, char** argv) {
  // A closed pipe shows as a failed write, with an exit code of ours.
  std::signal(SIGPIPE, SIG_IGN);
  std::ios::sync_with_stdio(false);
  return sightline::cli::RunCli(std::vector<std::string>(argv + 1, argv + argc), std::cout,
                                std::cerr, ::isatty(STDERR_FILENO) != 0);
}
