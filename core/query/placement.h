// SPDX-License-Identifier: Apache-2.0
//
// Placing a point beside the surface it lies on, so that after rounding it is strictly on the right
// side of its source triangle, by the exact predicate, and where possible of every other triangle
// that it touches within rounding.
//
// Sides. The point's side of its source is given. The side of another touched triangle follows from
// it:
//  * over shared edges (two bit-equal corners), step by step: the
//    side that is contiguous with it on the sheet, whether the edge
//    is convex or concave, and whichever way the triangles are wound;
//  * of a triangle that is not so connected and rises above the
//    source's plane (a wall on a floor): the source's own side
//    of it, if the source lies on one, else that of `reference`;
//  * any other touched triangle lies behind the source or in
//    its plane: it needs no side. No segment between two
//    points strictly in front of the source's plane meets it.
//
// Three tries, each verified exactly on the rounded point: all sides; the sides of triangles that
// rise above the source's plane; the source alone, which always succeeds. The first two also must
// not cross any further triangle on the way.
//
// What follows. If the source is part of a convex closed mesh and the point in front of it, nothing
// of that mesh blocks a light strictly in front of the source's plane: both ends lie strictly in
// front, the whole mesh behind. With the first try, a point at a convex vertex is lit by all lights
// in front of any of its triangles. A point in the concave corner of a room is strictly inside all
// the walls it touches.
//
// Thread safety: functions only; a PlacementScratch belongs to one thread.
#ifndef SIGHTLINE_CORE_QUERY_PLACEMENT_H_
#define SIGHTLINE_CORE_QUERY_PLACEMENT_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/intersect/predicate.h"
#include "core/query/nearest_triangle.h"
#include "core/query/point_poll.h"

namespace sightline {

// Distances below which a point and a triangle cannot be told apart. Rounding to nearest moves a
// coordinate x by at most 2^-24·|x|, a point by at most 2^-24 times its 1-norm; a triangle's
// corners were rounded too, and every point of it moved by at most what its corners did. So a point
// that lay on a triangle in the world lies within 2^-24·(|P|₁ + max|V|₁) of the stored one.
// Doubles' roundings are covered by the 1-norm standing for the 2-norm and by 2^-44, which exceeds
// a few hundred of them.
inline constexpr TouchRadius WorldTouchRadius(double norm_one) {
  return {0x1p-24 * norm_one, 0x1p-24 + 0x1p-44};
}
// A camera hit lies on its stored source; only its own rounding is yet to come. It will move by the
// placement, less than 3·2^-24·|P|₂ (PlacementOffset, times kAim), and by one rounding: 4. What
// doubles lose on the way to the point grows with the corners, not with P: 2^-44 as above. Two
// triangles whose distances from the eye round to one float tie, and the lower id is the hit even
// if it is the farther one, by up to 2^-23 of `along` = |t·D|₁: so the nearer one is touched too.
// For an eye much farther away than the origin that is held to kMostTied roundings of P, lest all
// of a fine mesh be touched; a tie may then leave a point behind the nearer triangle.
inline constexpr double kMostTied = 16;
inline constexpr double kHitTouchPerVertex = 0x1p-44;
inline constexpr TouchRadius HitTouchRadius(double norm_one, double along) {
  const double tied = 0x1p-23 * along, most = kMostTied * 0x1p-24 * norm_one;
  return {4 * 0x1p-24 * norm_one + (tied < most ? tied : most), kHitTouchPerVertex};
}

// A point that is less than one offset from a plane is moved to this many. More than 1, so that
// going back and forth between several planes ends: each move is a projection onto a half-space, so
// it brings the point nearer to every point that is kAim offsets inside all of them, by at least
// (kAim - 1)² offset² in squared distance.
inline constexpr double kAim = 1.5;

// One oriented plane: the point belongs where normal·(P - anchor) > 0.
struct Plane {
  std::array<Vec3f, 3> corners;
  int side = 0;
  Vec3d normal;  // Unit, times side.
  double conditioning =
      0;  // |AB|·|AC| / |AB × AC|: how much worse than one double rounding the normal is.

  bool Holds(Vec3f p) const {
    return SideOfPlane(corners[0], corners[1], corners[2], p) * side > 0;
  }
};

// Error of normal·(P - A) in doubles, u = 2^-53, by conditioning and |P - A|₁: the cross product
// carries three roundings per product and one for the difference, 4u·|AB||AC| per component, hence
// 7u·conditioning in the normal's direction; normalizing, P - A and the dot product add less than
// 8u. Together below 16u·conditioning·|P - A|₁, as conditioning >= 1.
inline constexpr double kSlackPerConditioning = 16 * 0x1p-53;

Plane MakePlane(const std::array<Vec3f, 3>& corners, int side);

struct Placement {
  Vec3d at;  // Where the point is, unrounded.
  uint32_t source = kNoTriangle;
  int side = 1;        // +1: it belongs in front of the source, -1: behind.
  TouchRadius radius;  // Others within it are touched.
  Vec3f reference;     // Decides on which side of unconnected triangles the point belongs.
};

// More touched triangles than this (the pole of a finely cut sphere may have that many) are not
// sorted out: which they are does not matter then.
inline constexpr size_t kMaxTouched = 1024;

struct PlacementScratch {
  std::vector<uint32_t> touched;
};

struct Placed {
  Vec3f position;
  // Strictly on the right side of everything it touched, and moved by no more than some radii.
  bool clear = true;
};

// How far from its plane a point P must be so that rounding P to floats leaves it on the same side:
// twice the most that rounding can move it along the unit normal n, plus `slack`, the error of the
// distance in doubles. Rounding moves a coordinate x by at most 2^-24·|x|, a subnormal one by
// 2^-150; together 2^-24·(|n.x P.x| + |n.y P.y| + |n.z P.z|) + √3·2^-150.
double PlacementOffset(Vec3d n, Vec3d p, double slack);

// Where `poll` (may be null) stops, it is of no use. REQUIRES: the source is not inert.
Placed Place(const IndexedGeometry& scene, const Placement& placement, PlacementScratch* scratch,
             PointPoll* poll = nullptr);

// The same, with `source` its source's plane and the touched triangles at hand: FindTouching's
// answer for placement.at without the source, for no more than kMaxTouched.
Placed PlaceTouching(const IndexedGeometry& scene, const Placement& placement, const Plane& source,
                     std::span<const uint32_t> touched, PointPoll* poll = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_PLACEMENT_H_
