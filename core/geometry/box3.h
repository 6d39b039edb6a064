// SPDX-License-Identifier: Apache-2.0
//
// Axis-aligned boxes of stored coordinates. Empty boxes have lo = +inf, hi = -inf, so that
// extending one needs no special case. Minimum and maximum round nothing: a box holds its points
// exactly.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_GEOMETRY_BOX3_H_
#define SIGHTLINE_CORE_GEOMETRY_BOX3_H_

#include <algorithm>
#include <limits>

#include "core/geometry/vec3.h"

namespace sightline {

template <typename T>
struct Box3 {
  Vec3<T> lo{std::numeric_limits<T>::infinity(), std::numeric_limits<T>::infinity(),
             std::numeric_limits<T>::infinity()};
  Vec3<T> hi{-std::numeric_limits<T>::infinity(), -std::numeric_limits<T>::infinity(),
             -std::numeric_limits<T>::infinity()};

  void Extend(Vec3<T> p) {
    lo = {std::min(lo.x, p.x), std::min(lo.y, p.y), std::min(lo.z, p.z)};
    hi = {std::max(hi.x, p.x), std::max(hi.y, p.y), std::max(hi.z, p.z)};
  }
  void Extend(const Box3& b) {
    lo = {std::min(lo.x, b.lo.x), std::min(lo.y, b.lo.y), std::min(lo.z, b.lo.z)};
    hi = {std::max(hi.x, b.hi.x), std::max(hi.y, b.hi.y), std::max(hi.z, b.hi.z)};
  }
  bool empty() const { return !(lo.x <= hi.x && lo.y <= hi.y && lo.z <= hi.z); }
  Vec3<T> Extent() const { return hi - lo; }
  // Half the surface area, which is what the surface area heuristic needs; 0 for an empty box.
  T HalfArea() const {
    if (empty()) return T{0};
    const Vec3<T> e = Extent();
    return (e.x * e.y + e.y * e.z) + e.z * e.x;
  }
  friend bool operator==(const Box3&, const Box3&) = default;
};

using Box3f = Box3<float>;
using Box3d = Box3<double>;

}  // namespace sightline

#endif  // SIGHTLINE_CORE_GEOMETRY_BOX3_H_
