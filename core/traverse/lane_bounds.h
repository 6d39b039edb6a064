// SPDX-License-Identifier: Apache-2.0
//
// Boxes and groups of lanes as the walk for any hit meets them (occluded_packet-inl.h), whether its
// rays have one origin or one direction.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_LANE_BOUNDS_H_
#define SIGHTLINE_CORE_TRAVERSE_LANE_BOUNDS_H_

#include <limits>

namespace sightline {

// A box's faces by axis: that which the rays come to first, and the other.
struct LaneSlab {  // Trivial: stacks of them are not initialized.
  float first[3], second[3];

  // One that no lane misses: what is no number culls nothing.
  static constexpr LaneSlab Everywhere() {
    constexpr float kNoNumber = std::numeric_limits<float>::quiet_NaN();
    return {{kNoNumber, kNoNumber, kNoNumber}, {kNoNumber, kNoNumber, kNoNumber}};
  }
};

// Of a group's lanes in the packet's frame: extents of their slopes or offsets, wide enough for
// their rounding.
struct LaneRectangle {
  float x0, x1, y0, y1;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_LANE_BOUNDS_H_
