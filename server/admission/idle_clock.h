// SPDX-License-Identifier: Apache-2.0
//
// How long somebody has been waiting for a client that brings nothing. Only waiting counts, not
// what the server does in between; and a message that brings nothing does not begin a new wait, so
// that empty messages keep nothing alive.
//
// Units: the steady clock's.
//
// Thread safety: one thread at a time.
//
//   IdleClock idle;
//   idle.Wait(IdleClock::Now());                    // A message is asked for,
//   idle.Arrived(IdleClock::Now(), /*brings=*/true);  // and is there.
//   if (idle.Idle(now) >= limit) End();
#ifndef SIGHTLINE_SERVER_ADMISSION_IDLE_CLOCK_H_
#define SIGHTLINE_SERVER_ADMISSION_IDLE_CLOCK_H_

#include <chrono>

namespace sightline {

class IdleClock {
 public:
  using Time = std::chrono::steady_clock::time_point;
  using Duration = std::chrono::steady_clock::duration;

  static Time Now() { return std::chrono::steady_clock::now(); }

  void Wait(Time now) {
    waiting_ = true;
    since_ = now;
  }
  // `brings`: whether what came is of any use.
  void Arrived(Time now, bool brings) {
    before_ = brings ? Duration::zero() : Idle(now);
    waiting_ = false;
  }
  // Zero while nobody waits.
  Duration Idle(Time now) const { return waiting_ ? before_ + (now - since_) : Duration::zero(); }

 private:
  bool waiting_ = false;
  Time since_;
  Duration before_ = Duration::zero();  // Waits that ended with nothing.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_IDLE_CLOCK_H_
