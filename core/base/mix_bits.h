// SPDX-License-Identifier: Apache-2.0
//
// Every bit of a number brought to all bits of another: for hashes, and for random numbers.
//
// Thread safety: a pure function.
#ifndef SIGHTLINE_CORE_BASE_MIX_BITS_H_
#define SIGHTLINE_CORE_BASE_MIX_BITS_H_

#include <cstdint>

namespace sightline {

// What splitmix64's counter advances by: 2^64 over the golden ratio, made odd.
inline constexpr uint64_t kGoldenStep = 0x9E3779B97F4A7C15u;

// The finalizer of splitmix64 (Steele, Lea, Flood: "Fast splittable pseudorandom number
// generators", 2014): a bijection. The same everywhere, so whoever wants to can make hashes
// collide; what uses it bounds what that costs, or adds a salt that nobody knows.
constexpr uint64_t MixBits(uint64_t x) {
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9u;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBu;
  return x ^ (x >> 31);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_MIX_BITS_H_
