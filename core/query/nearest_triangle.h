// SPDX-License-Identifier: Apache-2.0
//
// Distances from a point to triangles: the nearest one, those within rounding, and whether a short
// way crosses any. All walk the BVH, or the kd-tree where it stands alone, in doubles, and give
// what looking at every triangle in order of ids would give.
//
// Why no box is culled wrongly, without a margin: a triangle's closest point is held within the
// triangle's box, and the distances to it and to a box are the same expression of coordinate
// differences. Subtraction, multiplication and addition round monotonically, so a box's distance
// never exceeds that of a triangle inside it, bit for bit. On the kd-tree the closest point lies in
// the cell and the box of some leaf that names the triangle, or, where splits are perfect, in the
// `reach` of all nodes above that leaf (core/accel/kd_tree.h).
//
// A search that `poll` (may be null) stops answers nothing: PointPoll::stopped() says so.
//
// Thread safety: functions only.
//
//   NearestTriangle nearest = FindNearest(scene, ToDouble(point), distance * distance);
//   if (nearest.triangle != kNoTriangle) ...
#ifndef SIGHTLINE_CORE_QUERY_NEAREST_TRIANGLE_H_
#define SIGHTLINE_CORE_QUERY_NEAREST_TRIANGLE_H_

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"
#include "core/query/point_poll.h"

namespace sightline {

// The point of triangle ABC closest to `p`, within a few roundings of doubles, and within ABC's
// box. Exact at corners; on an edge the same bits for every triangle with that edge. REQUIRES: ABC
// is not of zero area.
Vec3d ClosestPointOnTriangle(Vec3d p, Vec3f a, Vec3f b, Vec3f c);

// The same for many points and one triangle.
struct ClosestPoints {
  Vec3d a, b, c, ab, bc, ca;
  Vec3d n;  // (B - A) × (C - B), not normalized.
  double nn = 0;
  double longest = 0;  // Its longest edge, squared.
  Box3d box;
  bool sliver = true;  // Its edges stand for it.

  ClosestPoints() = default;
  ClosestPoints(Vec3f a, Vec3f b, Vec3f c);
  Vec3d To(Vec3d p) const;
  // No edge stands for it, and p's foot on its plane is inside, as far as doubles can tell.
  bool IsBelow(Vec3d p) const;
  // p held within its box.
  Vec3d Held(Vec3d p) const;
};

// (x² + y²) + z² of the difference.
inline double DistanceSquared(Vec3d a, Vec3d b) {
  const Vec3d d = a - b;
  return Dot(d, d);
}

// (|x| + |y|) + |z|.
inline double NormOne(Vec3d a) { return (std::abs(a.x) + std::abs(a.y)) + std::abs(a.z); }

struct NearestTriangle {
  uint32_t triangle = kNoTriangle;
  double distance_squared = std::numeric_limits<double>::infinity();
};

// The nearest triangle within the given distance (the bound included); the lowest id among equals.
NearestTriangle FindNearest(const IndexedGeometry& scene, Vec3d p, double max_distance_squared,
                            PointPoll* poll = nullptr);

// How near is touching: base + per_vertex · (the largest 1-norm of the triangle's corners).
struct TouchRadius {
  double base = 0;
  double per_vertex = 0;
  double Of(Vec3f a, Vec3f b, Vec3f c) const;
  // No triangle of the scene has a larger one.
  double Largest(const IndexedGeometry& scene) const;
};

// Whether p touches ABC: its distance is at most the radius, in doubles.
bool Touches(Vec3d p, TouchRadius radius, Vec3f a, Vec3f b, Vec3f c);

// Whatever does not meet this box is farther than `radius` from all points of `points`, in rounded
// doubles, too.
Box3f BoxAround(const Box3d& points, double radius);

// The ids of all triangles but `skip` that `p` touches, ascending, into `ids`; where they are more
// than `most`, some of them, and more than `most`.
void FindTouching(const IndexedGeometry& scene, Vec3d p, TouchRadius radius, uint32_t skip,
                  std::vector<uint32_t>* ids, size_t most = std::numeric_limits<size_t>::max(),
                  PointPoll* poll = nullptr);

// Whether p touches any triangle but `skip`.
bool TouchesAny(const IndexedGeometry& scene, Vec3d p, TouchRadius radius, uint32_t skip,
                PointPoll* poll = nullptr);

// Whether any triangle that is not in `skip` (ascending) blocks the segment. For short ones: boxes
// are tested against the segment's box.
bool CrossesAny(const IndexedGeometry& scene, Vec3f from, Vec3f to, std::span<const uint32_t> skip,
                PointPoll* poll = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_NEAREST_TRIANGLE_H_
