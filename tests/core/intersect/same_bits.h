// SPDX-License-Identifier: Apache-2.0
//
// Whether two answers are the same to the last bit: NaN as itself, and 0 not as -0.
//
// Thread safety: pure functions.
#ifndef SIGHTLINE_TESTS_CORE_INTERSECT_SAME_BITS_H_
#define SIGHTLINE_TESTS_CORE_INTERSECT_SAME_BITS_H_

#include <bit>
#include <cstdint>

#include "core/intersect/hit.h"

namespace sightline::testing_support {

inline bool SameBits(float a, float b) {
  return std::bit_cast<uint32_t>(a) == std::bit_cast<uint32_t>(b);
}

inline bool SameBits(const Hit& a, const Hit& b) {
  return a.triangle == b.triangle && SameBits(a.t, b.t);
}

}  // namespace sightline::testing_support

#endif  // SIGHTLINE_TESTS_CORE_INTERSECT_SAME_BITS_H_
