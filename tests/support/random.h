// SPDX-License-Identifier: Apache-2.0
//
// Random numbers for tests. The same seed gives the same numbers with every compiler and library,
// and each failure within the generator's lifetime prints the seed that brings it back.
//
// The seed is SIGHTLINE_SEED where that is set to a number, a fresh one where it is set to
// "random", and fixed otherwise, so that the suite does the same work on every run.
//
// Thread safety: none; one generator per thread. A generator made on another thread than the test's
// adds its line to that thread's failures alone.
//
//   TestRng rng;                        // TestRng rng(i) for an independent stream per case i.
//   const double x = rng.Uniform(-1, 1);
//   EXPECT_LE(Bound(x), 1);             // On failure: "SIGHTLINE_SEED=1 stream 0".
#ifndef SIGHTLINE_TESTS_SUPPORT_RANDOM_H_
#define SIGHTLINE_TESTS_SUPPORT_RANDOM_H_

#include <cstdint>
#include <limits>

#include "gtest/gtest.h"

namespace sightline::testing_support {

// The seed of this process, as above.
uint64_t TestSeed();

class TestRng {
 public:
  using result_type = uint64_t;  // A UniformRandomBitGenerator, for std::shuffle and the like.

  // The place is the caller's. (std::source_location would say it, but clang 14 lacks libstdc++'s.)
  explicit TestRng(uint64_t stream = 0, const char* file = __builtin_FILE(),
                   int line = __builtin_LINE());
  TestRng(const TestRng&) = delete;
  TestRng& operator=(const TestRng&) = delete;

  static constexpr uint64_t min() { return 0; }
  static constexpr uint64_t max() { return std::numeric_limits<uint64_t>::max(); }
  uint64_t operator()();

  // In [0, n). REQUIRES: n > 0.
  uint64_t Below(uint64_t n);
  // In [low, high), on a grid of 2^-53 of the width.
  double Uniform(double low, double high);
  bool Chance(double probability) { return Uniform(0, 1) < probability; }
  // Any finite float by its bits: every exponent alike, zeros and denormals among them.
  float AnyFloat();

 private:
  uint64_t state_;
  testing::ScopedTrace trace_;
};

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_SUPPORT_RANDOM_H_
