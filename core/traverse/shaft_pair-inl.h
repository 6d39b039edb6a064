// SPDX-License-Identifier: Apache-2.0
//
// A relevant triangle and a block of rays that it may touch, packed as block | triangle <<
// kTriangleShift, with kCovered set where it covers the block; and what a leaf's pairs say of who
// answers which ray (answered_by.h).
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
#include <span>

#include "core/traverse/answered_by.h"
#include "core/traverse/leaf_view.h"
#include "core/traverse/shaft_rays-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

constexpr uint32_t kTriangleShift = 4, kCovered = 0x100;

// All of a packet's rays; nothing if nobody wants to know.
template <class Packet>
void MarkAll(const Packet& packet, AnsweredBy by) {
  if (packet.answered_by != nullptr) std::fill_n(packet.answered_by, packet.count, by);
}

// Marks the rays that the exact test will decide on when the leaf's pairs are worked off: those of
// blocks that are covered neither by the pair's triangle nor, for any hit, by one before.
template <bool kAny, bool kParallel>
HWY_NOINLINE void MarkTestedIn(const ShaftRays<kAny, kParallel>& rays, const ShaftBounds& bounds,
                               const LeafView& leaf, std::span<const uint32_t> pairs,
                               AnsweredBy* answered_by) {
  uint16_t open[kShaftBlocks];
  std::copy_n(bounds.open, kShaftBlocks, open);
  for (const uint32_t pair : pairs) {
    const uint32_t b = pair % kShaftBlocks;
    const uint32_t id = leaf.id(pair >> kTriangleShift & (kMaxLeafTriangles - 1));
    for (uint32_t rest = open[b]; rest != 0; rest &= rest - 1) {
      const uint32_t r = std::countr_zero(rest), lane = b * kShaftBlockRays + r;
      if (rays.has_sources() && rays.sources()[lane] == id) continue;
      if ((pair & kCovered) == 0) {
        answered_by[lane] = AnsweredBy::kTriangles;
      } else if (kAny) {
        open[b] &= static_cast<uint16_t>(~(1u << r));
      }
    }
  }
}

// The same; nothing where `answered_by` is null.
template <bool kAny, bool kParallel>
HWY_INLINE void MarkTested(const ShaftRays<kAny, kParallel>& rays, const ShaftBounds& bounds,
                           const LeafView& leaf, std::span<const uint32_t> pairs,
                           AnsweredBy* answered_by) {
  if (HWY_UNLIKELY(answered_by != nullptr)) MarkTestedIn(rays, bounds, leaf, pairs, answered_by);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
