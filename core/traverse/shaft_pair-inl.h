// SPDX-License-Identifier: Apache-2.0
//
// A leaf's relevant triangles and the blocks of rays that each may touch; and what such pairs say
// of who answers which ray (answered_by.h).
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_SHAFT_PAIR_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_SHAFT_PAIR_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_SHAFT_PAIR_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_PAIR_INL_H_
#endif

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "core/traverse/answered_by.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/shaft_rays-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Each pair is block | triangle << kTriangleShift.
constexpr uint32_t kTriangleShift = 4;
static_assert(kShaftBlocks == 1 << kTriangleShift);
struct BlockPairs {
  size_t count = 0;
  // A whole vector is stored at its end.
  alignas(64) uint32_t pairs[kMaxLeafTriangles * kShaftBlocks + kShaftBlocks];
};
HWY_INLINE uint32_t BlockOf(uint32_t pair) { return pair % kShaftBlocks; }
HWY_INLINE uint32_t TriangleOf(uint32_t pair) { return pair >> kTriangleShift; }

// The rays of block b that triangle `id` may answer.
template <class Rays>
HWY_INLINE uint32_t AskedOf(const Rays& rays, const typename Rays::Bounds& bounds, uint32_t b,
                            uint32_t id) {
  uint32_t bits = bounds.open[b];
  if (rays.has_sources()) {
    const hn::RebindToUnsigned<ShaftD> d;
    const uint32_t* sources = rays.sources() + Rays::At(size_t{b} * Rays::kRays);
    for (size_t i = 0; i < Rays::kRays; i += hn::Lanes(d)) {
      const auto own = hn::Eq(hn::Load(d, sources + i), hn::Set(d, id));
      bits &= ~(MaskBits(d, own) << i);
    }
  }
  return bits;
}

// All of a packet's rays; nothing if nobody wants to know.
template <class Packet>
void MarkAll(const Packet& packet, AnsweredBy by) {
  if (packet.answered_by != nullptr) std::fill_n(packet.answered_by, packet.count, by);
}

// Marks the rays that the exact test will decide on when the leaf's pairs are worked off.
template <class Rays>
HWY_NOINLINE void MarkTestedIn(const Rays& rays, const typename Rays::Bounds& bounds,
                               const LeafView& leaf, const BlockPairs& touched,
                               AnsweredBy* answered_by) {
  for (size_t k = 0; k < touched.count; ++k) {
    const uint32_t b = BlockOf(touched.pairs[k]);
    const uint32_t id = leaf.id(TriangleOf(touched.pairs[k]));
    for (uint32_t rest = bounds.open[b]; rest != 0; rest &= rest - 1) {
      const uint32_t lane = b * Rays::kRays + std::countr_zero(rest);
      if (rays.has_sources() && rays.sources()[Rays::At(lane)] == id) continue;
      answered_by[lane] = AnsweredBy::kTriangles;
    }
  }
}

// The same; nothing where `answered_by` is null.
template <class Rays>
HWY_INLINE void MarkTested(const Rays& rays, const typename Rays::Bounds& bounds,
                           const LeafView& leaf, const BlockPairs& touched,
                           AnsweredBy* answered_by) {
  if (HWY_UNLIKELY(answered_by != nullptr)) MarkTestedIn(rays, bounds, leaf, touched, answered_by);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
