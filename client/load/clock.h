// SPDX-License-Identifier: Apache-2.0
//
// Time as a load test needs it: a clock that never steps, and waits that end on time. Tests put a
// clock of their own in its place.
//
// Thread safety: SteadyClock from any thread.
//
//   SteadyClock clock;
//   clock.WaitUntil(start + absl::Milliseconds(5));
#ifndef SIGHTLINE_CLIENT_LOAD_CLOCK_H_
#define SIGHTLINE_CLIENT_LOAD_CLOCK_H_

#include <chrono>

#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace sightline::load {

class Clock {
 public:
  virtual ~Clock() = default;
  virtual absl::Time Now() const = 0;
  // Returns at `time` or soon after; at once if that has passed.
  virtual void WaitUntil(absl::Time time) = 0;
};

// The system's steady clock, set to the wall clock once.
class SteadyClock final : public Clock {
 public:
  SteadyClock();
  absl::Time Now() const override {
    return wall_ + absl::FromChrono(std::chrono::steady_clock::now() - steady_);
  }
  void WaitUntil(absl::Time time) override;

 private:
  const absl::Time wall_ = absl::Now();
  const std::chrono::steady_clock::time_point steady_ = std::chrono::steady_clock::now();
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_CLOCK_H_
