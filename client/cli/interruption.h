// SPDX-License-Identifier: Apache-2.0
//
// What a command gives up by: its calls to a server and the work in this process end within a
// moment, and what it made on the server is taken away on the way out.
//
// Thread safety: all members may be called from any thread.
//
//   Interruption interruption;
//   const SignalWatch watch(told, [&] { interruption.Interrupt(); });
//   return RunCli(args, std::cout, std::cerr, told, &interruption);
#ifndef SIGHTLINE_CLIENT_CLI_INTERRUPTION_H_
#define SIGHTLINE_CLIENT_CLI_INTERRUPTION_H_

#include "client/lib/cancellation.h"
#include "core/base/cancel.h"

namespace sightline::cli {

class Interruption {
 public:
  void Interrupt() {
    work_.Cancel();
    calls_.Cancel();
  }
  bool interrupted() const { return work_.cancelled(); }

  client::Cancellation* calls() { return &calls_; }
  const CancelToken* work() const { return &work_; }

 private:
  CancelToken work_;
  client::Cancellation calls_;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_INTERRUPTION_H_
