// SPDX-License-Identifier: Apache-2.0
//
// A shaft's lanes: sixteen blocks of sixteen rays, or of thirty-two, a bit for each, and what is
// reduced over the rays of every block at once.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_LANES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_LANES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_LANES_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>

#include "core/base/compress-inl.h"
#include "core/intersect/predicate-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr int kShaftBlocks = 16;
constexpr int kShaftBlockRays = 16;

using ShaftD = hn::CappedTag<float, 16>;  // Sixteen rays, triangles or blocks.
using ShaftV = hn::Vec<ShaftD>;
using ShaftM = hn::Mask<ShaftD>;

// Bit r of rays[b]: ray r of block b, which has as many as Bits.
template <class Bits>
struct BlockRays {
  Bits rays[kShaftBlocks];
};
using RaySet = BlockRays<uint16_t>;

// 1 / x, good to 3.3u (u = 2^-24), of x and 1 / x that are normal: a reciprocal of 11 bits or more,
// refined once. A quotient of sixteen lanes holds up what follows for as many cycles.
HWY_INLINE ShaftV InverseOf(ShaftV x) {
  const ShaftV rough = hn::ApproximateReciprocal(x);
  return hn::MulAdd(rough, hn::NegMulAdd(x, rough, hn::Set(ShaftD(), 1.0f)), rough);
}

// Lanes at .. at + Lanes() of a row of bits, `at` a multiple of eight.
template <class Bits>
HWY_INLINE ShaftM LanesOf(const Bits* bits, size_t at) {
  return hn::LoadMaskBits(ShaftD(), reinterpret_cast<const uint8_t*>(bits) + at / 8);
}

// The lanes of a block's `bits`, vector by vector.
template <size_t kVectors>
HWY_INLINE void BlockLanes(uint32_t bits, ShaftM (&lanes)[kVectors]) {
  const ShaftD d;
  const hn::RebindToUnsigned<ShaftD> du;
  if constexpr (hn::MaxLanes(ShaftD()) == kShaftBlockRays) {
    for (size_t k = 0; k < kVectors; ++k) lanes[k] = LanesOf(&bits, k * kShaftBlockRays);
  } else {
    alignas(64) static constexpr uint32_t kBits[] = {
        1u << 0, 1u << 1, 1u << 2,  1u << 3,  1u << 4,  1u << 5,  1u << 6,  1u << 7,
        1u << 8, 1u << 9, 1u << 10, 1u << 11, 1u << 12, 1u << 13, 1u << 14, 1u << 15};
    static_assert(std::size(kBits) == kVectors * hn::MaxLanes(ShaftD()));
    const auto all = hn::Set(du, bits);
    for (size_t k = 0; k < kVectors; ++k) {
      const auto own = hn::Load(du, kBits + k * hn::MaxLanes(d));
      lanes[k] = hn::RebindMask(d, hn::Eq(hn::And(all, own), own));
    }
  }
}

// hn::Iota of a value known at run time goes through memory, a number at a time.
alignas(64) constexpr uint32_t kCountUp[kShaftBlocks] = {0, 1, 2,  3,  4,  5,  6,  7,
                                                         8, 9, 10, 11, 12, 13, 14, 15};

// Stores first + lane for each of the lanes `chosen`, in their order, and any numbers behind them,
// a vector in all. Returns how many lanes those are.
HWY_INLINE size_t ListLanes(uint32_t first, ShaftM chosen, uint32_t* to) {
  const hn::RebindToUnsigned<ShaftD> du;
  const auto numbers = hn::Add(hn::Load(du, kCountUp), hn::Set(du, first));
  // Compressed in a register: a compressing store is microcode.
  hn::StoreU(CompressLanes(du, numbers, hn::RebindMask(du, chosen)), du, to);
  return hn::CountTrue(ShaftD(), chosen);
}

// Bit b of the result: block b has a ray. `rays` is aligned as a vector.
template <class Bits>
HWY_INLINE uint32_t OpenBlocks(const Bits* rays) {
  const hn::CappedTag<Bits, kShaftBlocks> d;
  static_assert(hn::MaxLanes(d) == kShaftBlocks);
  return MaskBits(d, hn::Ne(hn::Load(d, rays), hn::Zero(d)));
}

// op over the values of each of kBlocks blocks of kRays, powers of two: lane b for block b, and
// then again. fetch(i) gives values i .. i + Lanes(); `at` is the first block's first. A tree of
// pairwise steps, each of which halves the values and brings two vectors together. By recursion,
// not over an array: GCC fills one by copying memory.
template <size_t kBlocks, size_t kRays, class Op, class Fetch>
HWY_INLINE ShaftV ReduceTree(const Op& op, const Fetch& fetch, size_t at) {
  const ShaftD d;
  if constexpr (kBlocks == 1) {
    ShaftV row = fetch(at);
    for (size_t i = hn::Lanes(d); i < kRays; i += hn::Lanes(d)) row = op(row, fetch(at + i));
    return row;
  } else {
    const ShaftV low = ReduceTree<kBlocks / 2, kRays>(op, fetch, at);
    const ShaftV high = ReduceTree<kBlocks / 2, kRays>(op, fetch, at + kBlocks / 2 * kRays);
    return op(hn::ConcatEven(d, high, low), hn::ConcatOdd(d, high, low));
  }
}

// out[b] = op over the kRays values of block b, of so many.
template <size_t kRays = kShaftBlockRays, size_t kBlocks = kShaftBlocks, class Op, class Fetch>
HWY_INLINE void ReduceBlocks(const Op& op, const Fetch& fetch, float* out) {
  const ShaftD d;
  constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  for (size_t first = 0; first < kBlocks; first += kLanes) {
    hn::Store(ReduceTree<kLanes, kRays>(op, fetch, first * kRays), d, out + first);
  }
}

// The range of each block's values, of those of `open` (null: all) alone: inverted where there are
// none. No part of its callers: unrolled, it is a kilobyte, of which they would have a dozen.
template <class Bits>
HWY_NOINLINE void BlockRanges(const float* values, const Bits* open, float* least, float* most) {
  constexpr size_t kRays = 8 * sizeof(Bits);
  const auto min = [](ShaftV a, ShaftV b) HWY_ATTR { return hn::Min(a, b); };
  const auto max = [](ShaftV a, ShaftV b) HWY_ATTR { return hn::Max(a, b); };
  if (open == nullptr) {
    // Both before either is stored, so that the first step of their trees is taken once.
    const ShaftD d;
    const auto all = [values](size_t at) HWY_ATTR { return hn::Load(ShaftD(), values + at); };
    for (size_t first = 0; first < kShaftBlocks; first += hn::Lanes(d)) {
      constexpr size_t kLanes = hn::MaxLanes(ShaftD());
      const ShaftV lo = ReduceTree<kLanes, kRays>(min, all, first * kRays);
      const ShaftV hi = ReduceTree<kLanes, kRays>(max, all, first * kRays);
      hn::Store(lo, d, least + first);
      hn::Store(hi, d, most + first);
    }
    return;
  }
  const ShaftV infinity = hn::Set(ShaftD(), std::numeric_limits<float>::infinity());
  const ShaftV minus_infinity = hn::Neg(infinity);
  ReduceBlocks<kRays>(
      min,
      [&](size_t at) HWY_ATTR {
        return hn::IfThenElse(LanesOf(open, at), hn::Load(ShaftD(), values + at), infinity);
      },
      least);
  ReduceBlocks<kRays>(
      max,
      [&](size_t at) HWY_ATTR {
        return hn::IfThenElse(LanesOf(open, at), hn::Load(ShaftD(), values + at), minus_infinity);
      },
      most);
}

// The range of each vector's values.
inline HWY_NOINLINE void VectorRanges(const float* values, float* least, float* most) {
  if constexpr (hn::MaxLanes(ShaftD()) == kShaftBlockRays) {
    BlockRanges<uint16_t>(values, nullptr, least, most);
  } else {
    constexpr size_t kLanes = hn::MaxLanes(ShaftD());
    const auto all = [values](size_t at) HWY_ATTR { return hn::Load(ShaftD(), values + at); };
    constexpr size_t kVectors = kShaftBlocks * kShaftBlockRays / kLanes;
    const auto min = [](ShaftV a, ShaftV b) HWY_ATTR { return hn::Min(a, b); };
    const auto max = [](ShaftV a, ShaftV b) HWY_ATTR { return hn::Max(a, b); };
    ReduceBlocks<kLanes, kVectors>(min, all, least);
    ReduceBlocks<kLanes, kVectors>(max, all, most);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
