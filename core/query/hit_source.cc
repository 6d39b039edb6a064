// SPDX-License-Identifier: Apache-2.0
#include "core/query/hit_source.h"

#include <cmath>

#include "core/geometry/permanent.h"
#include "core/intersect/predicate.h"

namespace sightline {
HitSource::HitSource(const IndexedGeometry& scene, Vec3f origin, uint32_t triangle)
    : triangle(triangle) {
  const auto corners = scene.geometry.Corners(triangle);
  const auto& [a, b, c] = corners;
  anchor = ToDouble(a);
  const Vec3d ab = ToDouble(b) - anchor, ac = ToDouble(c) - anchor;
  normal = Cross(ab, ac);
  permanent = Permanent(ab, ac);
  closest = ClosestPoints(a, b, c);
  // An origin within the plane sees the triangle by a test of the papers' alone; either side will
  // do.
  const int side = SideOfPlane(a, b, c, origin);
  plane = MakePlane(corners, side != 0 ? side : 1);
}

Placement HitSource::PlacementOf(Vec3f origin, Vec3f direction, float t) const {
  const Vec3d d = ToDouble(direction);
  Vec3d p = ToDouble(origin) + d * static_cast<double>(t);
  // What rounding took from t, from the height left over the plane.
  const double lost = Dot(normal, anchor - p) / Dot(normal, d);
  const bool clear = std::abs(lost) <= kHitParameterError * t;
  if (clear) p = p + d * lost;
  const Vec3d at = clear && closest.IsBelow(p) ? closest.Held(p) : closest.To(p);
  return {.at = at,
          .source = triangle,
          .side = plane.side,
          .radius = HitTouchRadius(NormOne(at), NormOne(d) * t),
          .reference = origin};
}

}  // namespace sightline
