// SPDX-License-Identifier: Apache-2.0
//
// Ends the process if something takes longer than it may, as a second signal would: for what waits
// for work that cannot be stopped.
//
// Thread safety: construction and destruction by one thread.
//
//   const ExitDeadline deadline(absl::Seconds(38), kExitSoftware);
//   server->Drain(absl::Seconds(30));
#ifndef SIGHTLINE_SERVER_BASE_EXIT_DEADLINE_H_
#define SIGHTLINE_SERVER_BASE_EXIT_DEADLINE_H_

#include <chrono>
#include <thread>

#include "absl/time/time.h"
#include "core/base/mutex.h"

namespace sightline {

class ExitDeadline {
 public:
  // Logs, flushes the log and exits with `code`, without destructors, unless it is gone within
  // `timeout`.
  ExitDeadline(absl::Duration timeout, int code);
  ~ExitDeadline();
  ExitDeadline(const ExitDeadline&) = delete;
  ExitDeadline& operator=(const ExitDeadline&) = delete;

 private:
  void Run(absl::Duration timeout, std::chrono::steady_clock::time_point deadline, int code);

  Mutex mutex_;
  CondVar met_changed_;
  bool met_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_EXIT_DEADLINE_H_
