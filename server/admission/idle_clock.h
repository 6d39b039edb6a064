// SPDX-License-Identifier: Apache-2.0
//
// How long a client has kept somebody waiting. Only waiting counts, not what the server does in
// between; and a message makes up for the waits before it by what it brings alone, a second for
// every kBytesPerSecond, so that neither empty messages nor a few bytes now and then keep anything
// alive.
//
// Units: the steady clock's; bytes.
//
// Thread safety: one thread at a time.
//
//   IdleClock idle;
//   idle.Wait(IdleClock::Now());                    // A message is asked for,
//   idle.Arrived(IdleClock::Now(), /*bytes=*/1 << 20);  // and is there.
//   if (idle.Idle(now) >= limit) End();
#ifndef SIGHTLINE_SERVER_ADMISSION_IDLE_CLOCK_H_
#define SIGHTLINE_SERVER_ADMISSION_IDLE_CLOCK_H_

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace sightline {

class IdleClock {
 public:
  using Time = std::chrono::steady_clock::time_point;
  using Duration = std::chrono::steady_clock::duration;

  // Slower than any connection that is of use, faster than what costs a client nothing.
  static constexpr uint64_t kBytesPerSecond = 256;

  static Time Now() { return std::chrono::steady_clock::now(); }

  void Wait(Time now) {
    waiting_ = true;
    since_ = now;
  }
  // `bytes`: how much of use it brings.
  void Arrived(Time now, uint64_t bytes) {
    constexpr uint64_t kMost = uint64_t{1} << 32;  // Makes up for half a year.
    const Duration worth = std::chrono::nanoseconds(std::chrono::seconds(1)) *
                           std::min(bytes, kMost) / kBytesPerSecond;
    before_ = std::max(Duration::zero(), Idle(now) - worth);
    waiting_ = false;
  }
  // Zero while nobody waits.
  Duration Idle(Time now) const { return waiting_ ? before_ + (now - since_) : Duration::zero(); }

 private:
  bool waiting_ = false;
  Time since_;
  Duration before_ = Duration::zero();  // Waits that nothing has made up for.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_IDLE_CLOCK_H_
