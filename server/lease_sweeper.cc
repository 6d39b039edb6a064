// SPDX-License-Identifier: Apache-2.0
#include "server/lease_sweeper.h"

#include <chrono>

namespace sightline {

LeaseSweeper::LeaseSweeper(PointSetStore& store, absl::Duration period)
    : store_(store), thread_([this, period] { Run(period); }) {}

LeaseSweeper::~LeaseSweeper() {
  {
    MutexLock lock(mutex_);
    stop_ = true;
    stopped_.SignalAll();
  }
  thread_.join();
}

void LeaseSweeper::Run(absl::Duration period) {
  const std::chrono::nanoseconds wait = absl::ToChronoNanoseconds(period);
  auto next = std::chrono::steady_clock::now() + wait;
  while (true) {
    {
      MutexLock lock(mutex_);
      while (!stop_ && stopped_.WaitUntil(mutex_, next)) {
      }
      if (stop_) return;
    }
    store_.Sweep();
    next = std::chrono::steady_clock::now() + wait;
  }
}

}  // namespace sightline
