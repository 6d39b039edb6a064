// SPDX-License-Identifier: Apache-2.0
//
// Up to sixteen points that lie on triangles, in rows, and how near to them another triangle
// touches. Of hits they are the lanes of four by four pixels.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_QUERY_TOUCH_POINTS_H_
#define SIGHTLINE_CORE_QUERY_TOUCH_POINTS_H_

#include <algorithm>
#include <cstdint>

#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/query/nearest_triangle.h"

namespace sightline {

struct alignas(64) TouchPoints {
  static constexpr int kMost = 16;
  // Zero, so that vectors may be worked on in which some points are not there.
  double x[kMost] = {}, y[kMost] = {}, z[kMost] = {};
  double base[kMost] = {};  // TouchRadius::base.
  alignas(32)
      uint32_t source[kMost] = {};  // The triangle that the point lies on, kNoTriangle for none.
  double per_vertex = 0;            // TouchRadius::per_vertex, of all.
  uint32_t used = 0;                // Bit i: there is a point i.

  Vec3d at(int i) const { return {x[i], y[i], z[i]}; }
  TouchRadius radius(int i) const { return {base[i], per_vertex}; }
};

// Around some points.
struct TouchExtent {
  Box3d box;
  double base = 0, norm_one = 0;  // The largest.

  void Extend(const TouchExtent& other) {
    box.Extend(other.box);
    base = std::max(base, other.base);
    norm_one = std::max(norm_one, other.norm_one);
  }
};

// A point x is apart from a triangle if for any of these planes s = x·n - offset exceeds reach +
// 2·base, where plane 0 takes |s|. Plane 0 is the triangle's, 1 to 3 are those of its edges.
struct TouchPlanes {
  alignas(32) double x[4], y[4], z[4], offset[4], reach[4];
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_TOUCH_POINTS_H_
