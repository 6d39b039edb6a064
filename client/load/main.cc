// SPDX-License-Identifier: Apache-2.0
//
// sightline-load: the load tester. See `sightline-load --help`.
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <csignal>
#include <iostream>
#include <string>
#include <vector>

#include "client/load/run.h"

namespace {

std::atomic<bool> interrupted{false};
std::atomic<bool> told{false};  // Standard error is a terminal.
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler sets them");

// The first Ctrl-C or SIGTERM ends the run, which is then reported, or gives up what comes before
// it, and takes away what the test made on the server; the second ends the program.
void Interrupt(int signal) {
  const int error = errno;
  interrupted.store(true);
  std::signal(signal, SIG_DFL);
  // Tidying up takes a moment, or ten seconds where the server does not answer.
  constexpr char kHeard[] = "\ninterrupted: once more ends it there and then\n";
  if (told && ::write(STDERR_FILENO, kHeard, sizeof(kHeard) - 1) < 0) told = false;
  errno = error;
}

}  // namespace

int main(int argc, char** argv) {
  // A closed pipe shows as a failed write, with an exit code of ours.
  std::signal(SIGPIPE, SIG_IGN);
  told = ::isatty(STDERR_FILENO) != 0;
  std::signal(SIGINT, Interrupt);
  std::signal(SIGTERM, Interrupt);
  std::ios::sync_with_stdio(false);
  return sightline::load::RunLoad(std::vector<std::string>(argv + 1, argv + argc), std::cout,
                                  std::cerr, told, &interrupted);
}
