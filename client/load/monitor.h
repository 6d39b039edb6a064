// SPDX-License-Identifier: Apache-2.0
//
// Watches a run from beside it: a line of what is measured so far where people look (a terminal),
// the end of the run once it is stable where that is wanted, and when the user interrupts it.
//
// Thread safety: one thread makes and destroys it.
//
//   Monitor monitor(options, recorder, driver, clock, err);
//   driver.Run();
#ifndef SIGHTLINE_CLIENT_LOAD_MONITOR_H_
#define SIGHTLINE_CLIENT_LOAD_MONITOR_H_

#include <atomic>
#include <ostream>
#include <string>
#include <thread>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"
#include "client/load/clock.h"
#include "client/load/driver.h"
#include "client/load/recorder.h"
#include "core/base/mutex.h"

namespace sightline::load {

struct MonitorOptions {
  bool is_terminal = false;  // Shows the line.
  bool until_stable = false;
  double tolerance = 0.10;                         // Of stability.
  std::string title;                               // Before the line: "open loop".
  absl::Duration duration;                         // Of the run, for the line.
  const std::atomic<bool>* interrupted = nullptr;  // May be null.
};

// The line, without the terminal's control characters.
std::string LiveLine(const MonitorOptions& options, const Glance& glance);

class Monitor {
 public:
  Monitor(const MonitorOptions& options, const Recorder& recorder, Driver& driver, Clock& clock,
          std::ostream& err);
  // Takes the line away.
  ~Monitor();

 private:
  void Run();

  const MonitorOptions options_;
  const Recorder& recorder_;
  Driver& driver_;
  Clock& clock_;
  std::ostream& err_;
  bool shown_ = false;  // Of the thread.
  Mutex mutex_;
  CondVar changed_;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // Last: it uses the others.
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_MONITOR_H_
