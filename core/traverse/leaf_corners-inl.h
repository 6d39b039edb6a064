// SPDX-License-Identifier: Apache-2.0
//
// A leaf's triangles by their corners, as many at a time as a vector has lanes.
//
// Thread safety: pure functions.

#if defined(SIGHTLINE_CORE_TRAVERSE_LEAF_CORNERS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_LEAF_CORNERS_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_LEAF_CORNERS_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_LEAF_CORNERS_INL_H_
#endif

#include <cstdint>

#include "core/traverse/leaf_view.h"
#include "core/traverse/shaft_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Corner 0, 1 or 2 of the triangles from `first` on, as stored; any numbers behind the last.
HWY_INLINE Vec3V<ShaftV> LeafCorner(const LeafView& leaf, int corner, uint32_t first) {
  const ShaftD d;
  const float* const rows = leaf.rows + 3 * corner * leaf.stride + first;
  return {hn::LoadU(d, rows), hn::LoadU(d, rows + leaf.stride),
          hn::LoadU(d, rows + 2 * leaf.stride)};
}

// Likewise their ids.
HWY_INLINE hn::Vec<hn::RebindToUnsigned<ShaftD>> LeafIds(const LeafView& leaf, uint32_t first) {
  const ShaftD d;
  return hn::BitCast(hn::RebindToUnsigned<ShaftD>(), hn::LoadU(d, leaf.id_row() + first));
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
