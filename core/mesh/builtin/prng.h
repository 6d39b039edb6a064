// SPDX-License-Identifier: Apache-2.0
//
// Seeded random numbers with the same bits everywhere: splitmix64 (Steele, Lea, Flood: "Fast
// splittable pseudorandom number generators", 2014). A generator is named by (seed, stream, index),
// so the tenth chair looks the same however many chairs and trees there are.
//
// C++ leaves the order of operands and arguments open: draw one number per full expression, or
// inside braces (which are evaluated left to right).
//
// Thread safety: one thread per generator.
//
//   Prng rng(seed, "chair", 9);
//   const double yaw = rng.Uniform(-0.1, 0.1);
#ifndef SIGHTLINE_CORE_MESH_BUILTIN_PRNG_H_
#define SIGHTLINE_CORE_MESH_BUILTIN_PRNG_H_

#include <cstdint>
#include <string_view>

#include "core/base/mix_bits.h"

namespace sightline {

// FNV-1a.
constexpr uint64_t HashString(std::string_view text) {
  uint64_t h = 0xCBF29CE484222325u;
  for (char c : text) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001B3u;
  return h;
}

class Prng {
 public:
  Prng(uint64_t seed, std::string_view stream, uint64_t index = 0)
      : state_(MixBits(seed + kGoldenStep) ^
               MixBits(HashString(stream) + 0x632BE59BD9B4E019u * index)) {}

  uint64_t Next() { return MixBits(state_ += kGoldenStep); }
  // [0, 1), a multiple of 2^-53.
  double Uniform() { return static_cast<double>(Next() >> 11) * 0x1p-53; }
  double Uniform(double lo, double hi) { return lo + (hi - lo) * Uniform(); }
  // 0 .. n - 1. REQUIRES: 0 < n < 2^32.
  int Below(int n) { return static_cast<int>(((Next() >> 32) * static_cast<uint64_t>(n)) >> 32); }

 private:
  uint64_t state_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_MESH_BUILTIN_PRNG_H_
