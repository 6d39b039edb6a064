// SPDX-License-Identifier: Apache-2.0
//
// SIGINT (Ctrl-C), SIGTERM and SIGHUP (the terminal is gone) as a call in a thread of its own, so
// that a tool can tidy up. The first of them calls back; after it, SIGINT or SIGTERM ends the
// program there and then, and SIGHUP does nothing: kernel and shell tell of the same hang-up. One
// that was ignored before stays so: SIGHUP under nohup, SIGINT of what a script starts behind it.
//
// Thread safety: one object per process, which is made before other threads are.
//
//   const SignalWatch watch(/*tell=*/isatty(STDERR_FILENO), [&] { interruption.Interrupt(); });
#ifndef SIGHTLINE_CLIENT_CLI_SIGNAL_WATCH_H_
#define SIGHTLINE_CLIENT_CLI_SIGNAL_WATCH_H_

#include <functional>
#include <thread>

namespace sightline::cli {

class SignalWatch {
 public:
  // `tell`: the first signal is answered on standard error, for tidying up may take a moment, or
  // ten seconds where a server does not answer. `heard` runs at most once, and not after the object
  // has gone.
  SignalWatch(bool tell, std::function<void()> heard);
  ~SignalWatch();
  SignalWatch(const SignalWatch&) = delete;
  SignalWatch& operator=(const SignalWatch&) = delete;

 private:
  int read_end_ = -1;
  std::thread thread_;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_SIGNAL_WATCH_H_
