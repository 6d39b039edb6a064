// SPDX-License-Identifier: Apache-2.0
//
// Every bit of a number brought to all bits of a hash.
//
// Thread safety: a pure function.
#ifndef SIGHTLINE_CORE_BASE_MIX_BITS_H_
#define SIGHTLINE_CORE_BASE_MIX_BITS_H_

#include <cstdint>

namespace sightline {

// MurmurHash3's finalizer: a bijection. The same everywhere, so whoever wants to can make hashes
// collide; what uses it bounds what that costs.
constexpr uint64_t MixBits(uint64_t h) {
  h = (h ^ (h >> 33)) * 0xFF51AFD7ED558CCDull;
  h = (h ^ (h >> 33)) * 0xC4CEB9FE1A85EC53ull;
  return h ^ (h >> 33);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_MIX_BITS_H_
