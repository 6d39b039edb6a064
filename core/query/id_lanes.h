// SPDX-License-Identifier: Apache-2.0
//
// Where a triangle's id stands in a row of them.
//
// One instruction set is enough (AVX2, the floor).
//
// Thread safety: functions only.
//
//   const uint32_t lanes = WhereIs(triangle, packet.triangle + first);
#ifndef SIGHTLINE_CORE_QUERY_ID_LANES_H_
#define SIGHTLINE_CORE_QUERY_ID_LANES_H_

#include <cstdint>

#include "hwy/highway.h"

namespace sightline {

// Bit i: ids[i] == id, of eight. REQUIRES: ids is aligned to 32 bytes.
inline uint32_t WhereIs(uint32_t id, const uint32_t* ids) {
  namespace hn = hwy::HWY_NAMESPACE;
  const hn::CappedTag<uint32_t, 8> d;
  static_assert(hn::MaxLanes(d) == 8, "x86-64-v3 holds eight in a vector");
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(d, hn::Eq(hn::Load(d, ids), hn::Set(d, id)), bytes);
  return bytes[0];
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_ID_LANES_H_
