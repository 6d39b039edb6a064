// SPDX-License-Identifier: Apache-2.0
#include "client/load/clock.h"

#include <sys/prctl.h>

#include <thread>

namespace sightline::load {

SteadyClock::SteadyClock() {
  // Linux lets a sleeping thread oversleep by 50 us to save power; a pacer must not.
  ::prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
}

void SteadyClock::WaitUntil(absl::Time time) {
  const absl::Duration left = time - Now();
  if (left > absl::ZeroDuration()) {
    std::this_thread::sleep_for(absl::ToChronoNanoseconds(left));
  }
}

}  // namespace sightline::load
