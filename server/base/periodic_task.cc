// SPDX-License-Identifier: Apache-2.0
#include "server/base/periodic_task.h"

#include <chrono>
#include <utility>

namespace sightline {

PeriodicTask::PeriodicTask(absl::Duration period, std::function<void()> task)
    : task_(std::move(task)), thread_([this, period] { Run(period); }) {}

PeriodicTask::~PeriodicTask() {
  {
    MutexLock lock(mutex_);
    stop_ = true;
    stopped_.SignalAll();
  }
  thread_.join();
}

void PeriodicTask::Run(absl::Duration period) {
  const std::chrono::nanoseconds wait = absl::ToChronoNanoseconds(period);
  auto next = std::chrono::steady_clock::now() + wait;
  while (true) {
    {
      MutexLock lock(mutex_);
      while (!stop_ && stopped_.WaitUntil(mutex_, next)) {
      }
      if (stop_) return;
    }
    task_();
    next = std::chrono::steady_clock::now() + wait;
  }
}

}  // namespace sightline
