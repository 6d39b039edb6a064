// SPDX-License-Identifier: Apache-2.0
//
// Planar mirrors of a camera's tiles: what is seen in them (paper 002, section 3.1: shafts stay
// convex while they are reflected at planes).
//
// A mirror is an object of the scene and a plane. A pixel whose ray first meets a triangle T of
// the object, at the parameter t, sees what its mirrored ray meets:
//  * Its origin is the eye mirrored at the plane, one for all pixels: mirrored tiles are tiles of
//    rays with one origin, and walk as such.
//  * Its direction is the pixel's stored direction mirrored. Both are computed in double, in the
//    order written below, and rounded once.
//  * It begins where it leaves the mirror: hits at parameters t' <= t, behind the mirror, do not
//    count; t is the float that the pixel's own hit has. Triangles of the mirror's object do not
//    block it.
//  * It is not mirrored again: mirrors seen in it are surfaces like any other.
// With n the plane's normal and A a point of it:
//     origin = fl(O - n·(2·((O-A)·n) / (n·n))), direction = fl(D - n·(2·(D·n) / (n·n))).
// These are stored floats, and the predicate and the distances are those of any ray: so the answer
// is one, bit for bit, for every strategy, structure and instruction set. Depths go on: t' is the
// depth along the camera's axis of the picture that the mirror shows.
//
// A plane that is not given is that of the object's largest triangle, by its stored corners; the
// object must then be flat (kMostBulge).
//
// Thread safety: immutable after Prepare.
//
//   const Mirror mirrors[] = {{.object = 3}};
//   SL_ASSIGN_OR_RETURN(PreparedMirrors prepared,
//                       PreparedMirrors::Prepare(geometry, mirrors, eye));
//   for (const PreparedMirror& mirror : prepared.all()) {
//     ... rays that hit one of mirror.triangles() go on from mirror.eye() along
//     mirror.Direction(direction).
//   }
#ifndef SIGHTLINE_CORE_QUERY_MIRRORS_H_
#define SIGHTLINE_CORE_QUERY_MIRRORS_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/geometry/camera.h"
#include "core/geometry/vec3.h"
#include "core/mesh/scene_geometry.h"
#include "core/traverse/trace_ray.h"

namespace sightline {

// Mirrors of one query at most: each pixel's hit is looked for among them.
inline constexpr size_t kMaxMirrors = 64;
// How far the vertices of an object without a plane may lie from its largest triangle's, in widths
// of the object: an import's rounding of a flat object, not a curved one.
inline constexpr double kMostBulge = 1.0 / (1 << 10);

struct MirrorPlane {
  Vec3d point;   // World coordinates.
  Vec3d normal;  // Of any length but zero; either way around.
};

struct Mirror {
  uint32_t object = 0;  // By its number in the scene.
  std::optional<MirrorPlane> plane;
};

class PreparedMirror {
 public:
  // `point`, `normal` in the scene's frame.
  PreparedMirror(TriangleRange triangles, Vec3d point, Vec3d normal, Vec3f eye);

  TriangleRange triangles() const { return triangles_; }
  Vec3f eye() const { return eye_; }  // Mirrored.
  Vec3f Direction(Vec3f direction) const;

 private:
  Vec3d Mirrored(Vec3d v, double along) const;  // along = 2·(v·n).

  TriangleRange triangles_;
  Vec3d normal_;
  double square_;  // n·n.
  Vec3f eye_;
};

class PreparedMirrors {
 public:
  PreparedMirrors() = default;

  // `eye` in the scene's frame. InvalidArgument: no such object, named twice, a plane that is not
  // finite or has no normal, an object that is not flat or has no triangle that could be seen, or
  // too many; each is named. A mirrored eye beyond kMaxCoordinate is one, too. Cancelled /
  // DeadlineExceeded from `cancel`, which may be null: whoever gives no plane has all of the
  // object's triangles and vertices looked at.
  static absl::StatusOr<PreparedMirrors> Prepare(const SceneGeometry& geometry,
                                                 std::span<const Mirror> mirrors, Vec3f eye,
                                                 const CancelToken* cancel = nullptr);

  bool empty() const { return mirrors_.empty(); }
  std::span<const PreparedMirror> all() const { return mirrors_; }

 private:
  std::vector<PreparedMirror> mirrors_;
};

// Those of a camera's tiles, for whoever traces many of them (TraceTile in tiles.h): the same with
// its eye, and with the camera's own errors.
absl::StatusOr<PreparedMirrors> PrepareMirrors(const SceneGeometry& geometry,
                                               std::span<const Mirror> mirrors,
                                               const Camera& camera,
                                               const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_MIRRORS_H_
