// SPDX-License-Identifier: Apache-2.0
//
// Which lanes of a packet for any hit are still asked about, a number of bits for each vector of
// them, and how they end.
//
// Thread safety: pure functions of what they are handed.

#if defined(SIGHTLINE_CORE_TRAVERSE_LANE_ANSWERS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_LANE_ANSWERS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_LANE_ANSWERS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_LANE_ANSWERS_INL_H_
#endif

#include <cstddef>
#include <cstdint>

#include "core/base/masked_store-inl.h"
#include "core/traverse/shaft_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Ends the lanes `hits` of a group: triangle `id` blocks them.
HWY_INLINE void AnswerLanes(uint32_t id, uint32_t group, uint32_t hits, uint32_t* active,
                            uint32_t* triangles) {
  const hn::RebindToUnsigned<ShaftD> du;
  active[group] &= ~hits;
  const uint32_t bits[2] = {hits};  // LoadMaskBits may read as many.
  StoreWhere(hn::LoadMaskBits(du, reinterpret_cast<const uint8_t*>(bits)), hn::Set(du, id), du,
             triangles + group * hn::Lanes(du));
}

// Ends a lane, if it is `hit`, likewise.
HWY_INLINE void AnswerLane(uint32_t id, size_t lane, bool hit, uint32_t* active,
                           uint32_t* triangles) {
  const size_t lanes = hn::Lanes(ShaftD());
  active[lane / lanes] &= ~((hit ? 1u : 0u) << lane % lanes);
  triangles[lane] = hit ? id : triangles[lane];
}

// The groups of which lanes are left, a bit each. Of 256 lanes; `active` is aligned as a vector.
HWY_INLINE uint32_t GroupsLeft(const uint32_t* active) {
  const hn::RebindToUnsigned<ShaftD> du;
  constexpr size_t kLanes = hn::MaxLanes(ShaftD());
  uint32_t groups = 0;
  for (size_t g = 0; g < size_t{kShaftBlocks} * kShaftBlockRays / kLanes; g += kLanes) {
    groups |= MaskBits(du, hn::Ne(hn::Load(du, active + g), hn::Zero(du))) << g;
  }
  return groups;
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
