// SPDX-License-Identifier: Apache-2.0
//
// Points to be shaded, made ready: rebased to the scene's origin in double, rounded once, and
// placed. What comes out are stored floats; every answer is about them, and they can be read back.
//
// Placement: ends are exact, and there is no epsilon to choose. How it is done is told in
// placement.h.
//  * A camera hit lies on its source triangle only up to rounding. It
//    is moved along the triangle's normal to the eye's side by
//    PlacementOffset, a bound on that rounding, and further until the
//    exact predicate says that the stored point is strictly on that
//    side, and on the right side of the triangles it touches there.
//  * `attach_distance`: the nearest triangle within it becomes the source (the
//    lowest id among equals) of a point that names none, and the point is
//    placed likewise, clear of every other triangle it touches within rounding
//    where one direction does that for all. Its side is the one it is on
//    already; in the plane within rounding (of a sliver: within rounding of the
//    triangle itself), where the side would be chance, the one that its normal
//    points to if it has one, else the front. So sensors on
//    the inside of a room whose fronts face outward need normals or an offset.
//  * `offset`: the point is moved by that much along its given normal first, in world coordinates.
//  * `t_min`: a segment ends at that share of its length before the point: see ShadowOptions.
// A point that names its source stays where it is.
// A point within rounding of a triangle that is not its source is counted in near_surface, unless
// it was placed strictly on the right side of everything it touched.
//
// Thread safety: functions only; PreparedPoints is a plain value.
//
//   absl::StatusOr<PreparedPoints> points = PreparePoints(*scene, input, PointOptions{});
#ifndef SIGHTLINE_CORE_QUERY_POINTS_H_
#define SIGHTLINE_CORE_QUERY_POINTS_H_

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/accel/indexed_geometry.h"
#include "core/geometry/vec3.h"
#include "core/query/options.h"

namespace sightline {

struct PointInput {
  std::span<const Vec3d> positions;  // World coordinates.
  // Empty, or one per point: for `offset` (a point whose normal is zero or not finite is invalid
  // then), and for the side of attached points. Any length.
  std::span<const Vec3d> normals;
  std::span<const uint32_t> source_triangles;  // Empty, or one per point: global id or kNoTriangle.
};

struct PointOptions {
  double attach_distance = 0;  // >= 0, world units; 0: do not attach.
  double offset = 0;           // World units along the normal, any sign; not 0 requires normals.
  bool count_near_surface = true;
};

struct PreparedPoints {
  std::vector<Vec3f> positions;   // Relative to the scene's origin; zero where invalid.
  std::vector<uint32_t> sources;  // Global triangle id or kNoTriangle, one per point.
  std::vector<uint8_t> valid;     // 1, or 0: not finite or beyond kMaxCoordinate.
  uint64_t invalid = 0;
  uint64_t attached = 0;      // Valid, with a source: given or found.
  uint64_t near_surface = 0;  // Valid, within rounding of a triangle that is not their source.

  size_t size() const { return positions.size(); }
};

// InvalidArgument: arrays of different lengths, a source id out of range, a negative or non-finite
// attach_distance, a non-finite offset or one without normals (each named with its value).
// Cancelled / DeadlineExceeded from `cancel`.
absl::StatusOr<PreparedPoints> PreparePoints(const IndexedGeometry& scene, const PointInput& input,
                                             const PointOptions& options,
                                             const CancelToken* cancel = nullptr);

// PreparePoints in two steps, for whoever shares out the second one, which is nearly all of the
// work, or orders the points before it. The first: moved by `offset`, rebased and rounded, with the
// sources that were given. Errors as above.
absl::StatusOr<PreparedPoints> RebasePoints(const IndexedGeometry& scene, const PointInput& input,
                                            const PointOptions& options,
                                            const CancelToken* cancel = nullptr);
// Whether the options leave the second one anything to do.
inline bool WantsPlacing(const PointOptions& options) {
  return options.attach_distance > 0 || options.count_near_surface;
}
// The second: attaches, and counts `attached` and `near_surface`. Each point by itself, so that any
// of those that were rebased may come, in any order. Cancelled / DeadlineExceeded from `cancel`:
// some points are placed by then, and counts are of these, so that all have to be rebased again.
// REQUIRES: `normals` is empty, or has one per point.
absl::Status PlacePoints(const IndexedGeometry& scene, std::span<const Vec3d> normals,
                         const PointOptions& options, const CancelToken* cancel,
                         PreparedPoints* points);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_POINTS_H_
