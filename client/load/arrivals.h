// SPDX-License-Identifier: Apache-2.0
//
// When the requests of an open loop are due. The times are planned before anything is sent and
// never wait for an answer: a latency counted from them holds the time that a request had to wait
// behind slow ones, which one counted from the actual send leaves out ("coordinated omission", Gil
// Tene; wrk2 measures so).
//
//   constant   request i at i / rate
//   poisson    gaps of an exponential distribution of mean 1 / rate, as independent users make them
//
// Offsets are whole nanoseconds from the start of the run and never fall. The same seed gives the
// same times on every machine but for the last digit of log().
//
// Thread safety: none; one thread.
//
//   ArrivalSchedule arrivals(Arrivals::kPoisson, /*rate=*/200, /*seed=*/1);
//   absl::Duration first = arrivals.Next();
#ifndef SIGHTLINE_CLIENT_LOAD_ARRIVALS_H_
#define SIGHTLINE_CLIENT_LOAD_ARRIVALS_H_

#include <cstdint>

#include "absl/time/time.h"
#include "client/load/random.h"

namespace sightline::load {

enum class Arrivals { kConstant, kPoisson };

// Requests per second. More than any process here sends, let alone has answered.
inline constexpr double kHighestRate = 1e6;

class ArrivalSchedule {
 public:
  // REQUIRES: rate (requests per second) is finite and above 0.
  ArrivalSchedule(Arrivals arrivals, double rate, uint64_t seed);

  // The offset of the next request: the first of a constant schedule is 0.
  absl::Duration Next();

 private:
  const Arrivals arrivals_;
  const double rate_;
  Random random_;
  uint64_t count_ = 0;
  double seconds_ = 0;  // Poisson: the offset of the last one.
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_ARRIVALS_H_
