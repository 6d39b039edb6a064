// SPDX-License-Identifier: Apache-2.0
//
// Places spread over a row, whatever repeats in it: multiples of the golden ratio keep no step with
// a picture's rows or blocks.
//
// Thread safety: a pure function.
#ifndef SIGHTLINE_CORE_QUERY_GOLDEN_PLACES_H_
#define SIGHTLINE_CORE_QUERY_GOLDEN_PLACES_H_

#include <cstddef>
#include <cstdint>

namespace sightline {

// The i-th such place of n: the fraction of i times the ratio, in 2^-32, of n. REQUIRES: n < 2^32.
constexpr size_t GoldenPlace(size_t i, size_t n) {
  constexpr uint32_t kGolden = 0x9e3779b1;
  return static_cast<size_t>(static_cast<uint32_t>(i) * kGolden * uint64_t{n} >> 32);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_GOLDEN_PLACES_H_
