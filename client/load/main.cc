// SPDX-License-Identifier: Apache-2.0
//
// sightline-load: the load tester. See `sightline-load --help`.
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "client/load/run.h"

namespace {

std::atomic<bool> interrupted{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets it");

// The first Ctrl-C or SIGTERM ends the run, which is then reported, and takes away what the test
// made on the server; the second ends the program.
void Interrupt(int signal) {
  interrupted.store(true);
  std::signal(signal, SIG_DFL);
}

}  // namespace

int main(int argc, char** argv) {
  // A closed pipe shows as a failed write, with an exit code of ours.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGINT, Interrupt);
  std::signal(SIGTERM, Interrupt);
  std::ios::sync_with_stdio(false);
  return sightline::load::RunLoad(std::vector<std::string>(argv + 1, argv + argc), std::cout,
                                  std::cerr, ::isatty(STDERR_FILENO) != 0, &interrupted);
}
