// SPDX-License-Identifier: Apache-2.0
#include "client/cli/signal_watch.h"

#include <fcntl.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): sigaction is POSIX, not in <csignal>.
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <utility>

namespace sightline::cli {
namespace {

// What is written into the pipe.
constexpr char kSignal = 's', kEnd = 'e';

std::atomic<int> write_end{-1};
std::atomic<bool> told{false};
static_assert(std::atomic<int>::is_always_lock_free && std::atomic<bool>::is_always_lock_free,
              "a signal handler reads them");

bool Meets(int signal, void (*handler)(int)) {
  struct sigaction now {};
  return sigaction(signal, nullptr, &now) == 0 && now.sa_handler == handler;
}

void Hear(int) {
  const int error = errno;
  // One that is ignored stays so.
  for (const int signal : {SIGINT, SIGTERM}) {
    if (Meets(signal, Hear)) ::signal(signal, SIG_DFL);
  }
  ::signal(SIGHUP, SIG_IGN);
  // Of two signals at once that both came here, the watch reads one.
  if (::write(write_end, &kSignal, 1) < 0) told = false;
  constexpr char kHeard[] = "\ninterrupted: once more ends it there and then\n";
  if (told && ::write(STDERR_FILENO, kHeard, sizeof(kHeard) - 1) < 0) told = false;
  errno = error;
}

}  // namespace

SignalWatch::SignalWatch(bool tell, std::function<void()> heard) {
  int ends[2];
  // Without descriptors to be had, signals end the program as they always do.
  if (::pipe2(ends, O_CLOEXEC) != 0) return;
  read_end_ = ends[0];
  write_end = ends[1];
  told = tell;
  thread_ = std::thread([read_end = ends[0], heard = std::move(heard)] {
    bool first = true;
    for (char byte = 0; byte != kEnd;) {
      const ssize_t got = ::read(read_end, &byte, 1);
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) return;
      if (byte == kSignal && std::exchange(first, false)) heard();
    }
  });
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    if (!Meets(signal, SIG_IGN)) ::signal(signal, Hear);
  }
}

SignalWatch::~SignalWatch() {
  if (read_end_ < 0) return;
  while (::write(write_end, &kEnd, 1) < 0 && errno == EINTR) {
  }
  thread_.join();
  // The writing end stays: a handler may run still.
  ::close(read_end_);
}

}  // namespace sightline::cli
