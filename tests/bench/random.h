// SPDX-License-Identifier: Apache-2.0
//
// Random numbers of the benchmark: the same seed gives the same numbers everywhere. Needs no test
// framework, unlike tests/support/random.h.
//
// Thread safety: none; one generator per thread.
//
//   Random random(seed);
//   const double x = random.Uniform(-1, 1);
#ifndef SIGHTLINE_TESTS_BENCH_RANDOM_H_
#define SIGHTLINE_TESTS_BENCH_RANDOM_H_

#include <cstdint>

#include "core/base/mix_bits.h"

namespace sightline::bench {

class Random {
 public:
  // `stream` tells apart generators of one seed.
  explicit Random(uint64_t seed, uint64_t stream = 0)
      : state_(MixBits(seed + kGoldenStep) ^ MixBits(stream * kGoldenStep)) {}

  uint64_t Next() { return MixBits(state_ += kGoldenStep); }
  // In [0, n), biased by less than n / 2^64. REQUIRES: n > 0.
  uint64_t Below(uint64_t n) {
    return static_cast<uint64_t>((static_cast<unsigned __int128>(Next()) * n) >> 64);
  }
  // In [low, high), on a grid of 2^-53 of the width.
  double Uniform(double low, double high) {
    return low + (high - low) * (static_cast<double>(Next() >> 11) * 0x1p-53);
  }
  bool Chance(double probability) { return Uniform(0, 1) < probability; }

 private:
  uint64_t state_;
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_RANDOM_H_
