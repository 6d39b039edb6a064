// SPDX-License-Identifier: Apache-2.0
//
// Some lanes of a vector, moved together. AVX-512 has an instruction for it. For AVX2 Highway 1.0.3
// looks the order up in a table that GCC, since it is no static one, copies to the stack each time:
// a kilobyte, for every node and every triangle. So here is one that stays where it is.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_BASE_COMPRESS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_BASE_COMPRESS_INL_H_
#undef SIGHTLINE_CORE_BASE_COMPRESS_INL_H_
#else
#define SIGHTLINE_CORE_BASE_COMPRESS_INL_H_
#endif

#include <array>
#include <cstddef>
#include <cstdint>

#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// By mask: the lanes of its bits, then the others.
using LaneOrders = std::array<std::array<uint8_t, 8>, 256>;
constexpr LaneOrders MakeLaneOrders() {
  LaneOrders orders = {};
  for (size_t mask = 0; mask < orders.size(); ++mask) {
    size_t at = 0;
    for (const size_t chosen : {size_t{1}, size_t{0}}) {
      for (uint8_t lane = 0; lane < 8; ++lane) {
        if ((mask >> lane & 1) == chosen) orders[mask][at++] = lane;
      }
    }
  }
  return orders;
}
alignas(64) inline constexpr LaneOrders kLaneOrders = MakeLaneOrders();

#if HWY_TARGET == HWY_AVX2
// Eight lanes, as numbers of four bytes: those whose bits are set in `chosen`, then the others.
template <class D>
HWY_INLINE hn::Vec<hn::RebindToUnsigned<D>> LaneOrder(D /*d*/, uint32_t chosen) {
  const hn::Rebind<uint8_t, D> bytes;
  return hn::PromoteTo(hn::RebindToUnsigned<D>(), hn::LoadU(bytes, kLaneOrders[chosen].data()));
}
// The same of `chosen`, whose bits go to *bits.
template <class D, class M>
HWY_INLINE hn::Vec<hn::RebindToUnsigned<D>> ChosenFirst(D d, M chosen, uint8_t* bits) {
  uint8_t stored[8];  // As many as StoreMaskBits may write.
  hn::StoreMaskBits(d, chosen, stored);
  *bits = stored[0];
  return LaneOrder(d, stored[0]);
}
#endif

// The lanes of `chosen`, four bytes each, in their order, from the first on; those behind them are
// any.
template <class D, class V = hn::Vec<D>, class M>
HWY_INLINE V CompressLanes(D d, V v, M chosen) {
  static_assert(sizeof(hn::TFromD<D>) == sizeof(uint32_t));
#if HWY_TARGET == HWY_AVX2
  if constexpr (hn::MaxLanes(d) == 8) {
    uint8_t bits;
    return hn::TableLookupLanes(v, hn::IndicesFromVec(d, ChosenFirst(d, chosen, &bits)));
  }
#endif
  return hn::Compress(v, chosen);
}

// The same for eight lanes, by the bits of `chosen`, which has no others: where they are known
// anyway.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V CompressLanesByBits(D d, V v, uint32_t chosen) {
  static_assert(sizeof(hn::TFromD<D>) == sizeof(uint32_t) && hn::MaxLanes(d) == 8);
#if HWY_TARGET == HWY_AVX2
  return hn::TableLookupLanes(v, hn::IndicesFromVec(d, LaneOrder(d, chosen)));
#else
  const uint8_t bits[8] = {static_cast<uint8_t>(chosen)};  // As many as LoadMaskBits may read.
  return hn::Compress(v, hn::LoadMaskBits(d, bits));
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
