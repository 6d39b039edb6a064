// SPDX-License-Identifier: Apache-2.0
//
// Random numbers of a load test: the same seed gives the same run on every machine, which the
// distributions of <random> and Abseil do not promise. SplitMix64 (Steele, Lea, Flood: "Fast
// splittable pseudorandom number generators", 2014, fig. 14).
//
// Thread safety: none; one thread.
//
//   Random random(seed);
//   double u = random.Uniform();
#ifndef SIGHTLINE_CLIENT_LOAD_RANDOM_H_
#define SIGHTLINE_CLIENT_LOAD_RANDOM_H_

#include <cstdint>

#include "core/base/mix_bits.h"

namespace sightline::load {

class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  uint64_t Next() { return MixBits(state_ += kGoldenStep); }
  // In [0, 1), on a grid of 2^-53.
  double Uniform() { return static_cast<double>(Next() >> 11) * 0x1p-53; }
  // In [0, n); biased by less than n / 2^64. REQUIRES: n > 0.
  uint64_t Below(uint64_t n) { return Next() % n; }

 private:
  uint64_t state_;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_RANDOM_H_
