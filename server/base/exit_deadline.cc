// SPDX-License-Identifier: Apache-2.0
#include "server/base/exit_deadline.h"

#include <unistd.h>

#include "server/base/log.h"

namespace sightline {

ExitDeadline::ExitDeadline(absl::Duration timeout, int code)
    : thread_([this, timeout, code,
               deadline = std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(timeout)] {
        Run(timeout, deadline, code);
      }) {}

ExitDeadline::~ExitDeadline() {
  {
    MutexLock lock(mutex_);
    met_ = true;
    met_changed_.SignalAll();
  }
  thread_.join();
}

void ExitDeadline::Run(absl::Duration timeout, std::chrono::steady_clock::time_point deadline,
                       int code) {
  {
    MutexLock lock(mutex_);
    while (!met_ && met_changed_.WaitUntil(mutex_, deadline)) {
    }
    if (met_) return;
  }
  Log(LogLevel::kError, "cut_short",
      {{"after", absl::FormatDuration(timeout)},
       {"why", "work that was cut off has not ended: the process ends without it"}});
  FlushLog();
  _exit(code);
}

}  // namespace sightline
