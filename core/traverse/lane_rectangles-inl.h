// SPDX-License-Identifier: Apache-2.0
//
// Where the lanes of a packet for any hit are seen, group by group, in the packet's own frame
// (occluded_packet-inl.h): what a leaf's triangles are put to before any of the lanes.
//
// Thread safety: belongs to one walk.

#if defined(SIGHTLINE_CORE_TRAVERSE_LANE_RECTANGLES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SIGHTLINE_CORE_TRAVERSE_LANE_RECTANGLES_INL_H_
#undef SIGHTLINE_CORE_TRAVERSE_LANE_RECTANGLES_INL_H_
#else
#define SIGHTLINE_CORE_TRAVERSE_LANE_RECTANGLES_INL_H_
#endif

#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/traverse/shaft_lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Extents of slopes or offsets, wide enough for their rounding.
struct LaneRectangle {
  float x0, x1, y0, y1;
};

// Of each group of lanes, a vector of them.
class LaneRectangles {
 public:
  // By a row of each coordinate, which `margin` widens.
  void Put(const float* x, const float* y, float margin) {
    VectorRanges(x, x0_, x1_);
    VectorRanges(y, y0_, y1_);
    const ShaftD d;
    const ShaftV by = hn::Set(d, margin);
    for (size_t g = 0; g < kGroups; g += hn::Lanes(d)) {
      for (float* row : {x0_, y0_}) hn::Store(hn::Sub(hn::Load(d, row + g), by), d, row + g);
      for (float* row : {x1_, y1_}) hn::Store(hn::Add(hn::Load(d, row + g), by), d, row + g);
    }
  }
  // Of which nothing is known.
  void Open(uint32_t group) {
    x0_[group] = y0_[group] = -std::numeric_limits<float>::infinity();
    x1_[group] = y1_[group] = std::numeric_limits<float>::infinity();
  }
  HWY_INLINE LaneRectangle of(uint32_t group) const {
    return {x0_[group], x1_[group], y0_[group], y1_[group]};
  }

 private:
  static constexpr size_t kGroups = size_t{kShaftBlocks} * kShaftBlockRays / hn::MaxLanes(ShaftD());

  alignas(64) float x0_[kGroups], x1_[kGroups], y0_[kGroups], y1_[kGroups];
};

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#endif  // per-target include guard
