// SPDX-License-Identifier: Apache-2.0
//
// A thread of its own that does something every so often, such as letting go of point sets whose
// lease ran out when no call comes by to do it.
//
// Thread safety: construction and destruction by one thread.
//
//   PeriodicTask sweeper(absl::Seconds(5), [&] { store.Sweep(); });
#ifndef SIGHTLINE_SERVER_BASE_PERIODIC_TASK_H_
#define SIGHTLINE_SERVER_BASE_PERIODIC_TASK_H_

#include <functional>
#include <thread>

#include "absl/time/time.h"
#include "core/base/mutex.h"

namespace sightline {

class PeriodicTask {
 public:
  // The first time comes after one period. The task must not throw.
  PeriodicTask(absl::Duration period, std::function<void()> task);
  // Ends the thread, after the task if that runs.
  ~PeriodicTask();
  PeriodicTask(const PeriodicTask&) = delete;
  PeriodicTask& operator=(const PeriodicTask&) = delete;

 private:
  void Run(absl::Duration period);

  const std::function<void()> task_;
  Mutex mutex_;
  CondVar stopped_;
  bool stop_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_PERIODIC_TASK_H_
