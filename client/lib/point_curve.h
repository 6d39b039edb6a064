// SPDX-License-Identifier: Apache-2.0
//
// Points brought along a space-filling curve before they are cut into items, so that each item's
// points are neighbours: a server answers a hundred neighbours by one walk, and meshes, grids and
// shuffled clouds come in orders that part them. For the library's own files.
//
// Thread safety: constant once made. The points given must outlive it.
//
//   const PointCurve curve(query.points);
//   curve.points();      // What to send ...
//   curve.index(i);      // ... and where the answer of its point i belongs.
#ifndef SIGHTLINE_CLIENT_LIB_POINT_CURVE_H_
#define SIGHTLINE_CLIENT_LIB_POINT_CURVE_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "client/lib/types.h"

namespace sightline::client {

class PointCurve {
 public:
  // Along a Morton curve through the points' box, 2^10 cells an axis; in a cell as they come. A
  // coordinate that is no number counts as the least, an infinite one as the least or the greatest.
  // REQUIRES: arrays of the right lengths, and fewer than 2^32 points.
  explicit PointCurve(const Points& points);
  PointCurve(const PointCurve&) = delete;
  PointCurve& operator=(const PointCurve&) = delete;

  Points points() const { return {positions_, source_objects_, source_triangles_, normals_}; }
  uint32_t index(size_t i) const { return order_[i]; }

 private:
  std::vector<uint32_t> order_;
  std::vector<double> positions_, normals_;
  std::vector<uint32_t> source_objects_, source_triangles_;
};

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_POINT_CURVE_H_
