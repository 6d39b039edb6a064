// SPDX-License-Identifier: Apache-2.0
#include "core/query/points.h"

#include <array>
#include <cmath>
#include <utility>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/intersect/predicate.h"
#include "core/mesh/rebase.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement.h"
#include "core/query/point_poll.h"

namespace sightline {
namespace {

// Points between two looks at the cancel token: some hundred microseconds of work at most. Where
// many triangles lie about each, a PointPoll looks sooner.
constexpr size_t kCancelBlock = 256;

absl::Status CheckInput(const IndexedGeometry& scene, const PointInput& input,
                        const PointOptions& options) {
  const size_t n = input.positions.size();
  const auto check_length = [n](const char* name, size_t length) {
    if (length == 0 || length == n) return absl::OkStatus();
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", length, " entries for ", n,
                                                   " points; give one per point or none"));
  };
  SL_RETURN_IF_ERROR(check_length("normals", input.normals.size()));
  SL_RETURN_IF_ERROR(check_length("source_triangles", input.source_triangles.size()));
  if (!(options.attach_distance >= 0) || !std::isfinite(options.attach_distance)) {
    return absl::InvalidArgumentError(absl::StrCat("attach_distance = ", options.attach_distance,
                                                   " is not a finite number >= 0"));
  }
  if (!std::isfinite(options.offset)) {
    return absl::InvalidArgumentError(absl::StrCat("offset = ", options.offset, " is not finite"));
  }
  if (options.offset != 0 && input.normals.empty() && n > 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("offset = ", options.offset, " needs normals, one per point"));
  }
  const size_t triangles = scene.geometry.triangles.size();
  for (size_t i = 0; i < input.source_triangles.size(); ++i) {
    const uint32_t id = input.source_triangles[i];
    if (id != kNoTriangle && id >= triangles) {
      return absl::InvalidArgumentError(absl::StrCat(
          "source_triangles[", i, "] = ", id, ", but the scene has ", triangles, " triangles"));
    }
  }
  return absl::OkStatus();
}

// p + offset · n/|n|; false if n has no direction. Scaled first, so that no square over- or
// underflows.
bool MoveAlong(Vec3d normal, double offset, Vec3d* p) {
  const double size = MaxAbs(normal);
  if (!(size > 0) || !std::isfinite(size)) return false;
  const Vec3d n = {normal.x / size, normal.y / size, normal.z / size};
  *p = *p + n * (offset / Length(n));
  return true;
}

// SideOfSource for a sliver, whose normal in doubles may be wrong in all its bits, or zero: heights
// over its plane say nothing, so rounding is what is near the triangle itself, and signs are exact.
int SideOfSliver(const ClosestPoints& closest, const std::array<Vec3f, 3>& corners, Vec3f p,
                 double touch, const Vec3d* normal) {
  const auto& [a, b, c] = corners;
  const Vec3d at = ToDouble(p);
  if (DistanceSquared(at, closest.To(at)) > touch * touch) {
    const int side = SideOfPlane(a, b, c, p);
    if (side != 0) return side;
  }
  const double size = normal != nullptr ? MaxAbs(*normal) : 0;
  if (!(size > 0) || !std::isfinite(size)) return 1;
  const Vec3d n = {normal->x / size, normal->y / size, normal->z / size};
  return SideOfDirection(a, b, c, ToFloat(n)) < 0 ? -1 : 1;
}

// The side of the source that the stored point p is on (see points.h).
int SideOfSource(const IndexedGeometry& scene, uint32_t source, Vec3f p, TouchRadius radius,
                 const Vec3d* normal) {
  const auto [a, b, c] = scene.geometry.Corners(source);
  const double touch = radius.Of(a, b, c);
  const ClosestPoints closest(a, b, c);
  if (closest.sliver) return SideOfSliver(closest, {a, b, c}, p, touch, normal);
  const Vec3d ad = ToDouble(a);
  const Vec3d n = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
  const double height = Dot(n, ToDouble(p) - ad);
  if (height * height > (touch * touch) * Dot(n, n)) {
    const int side = SideOfPlane(a, b, c, p);
    if (side != 0) return side;
  }
  return normal != nullptr && Dot(n, *normal) < 0 ? -1 : 1;
}

class Placer {
 public:
  Placer(const IndexedGeometry& scene, std::span<const Vec3d> normals, const PointOptions& options,
         const CancelToken* cancel, PreparedPoints* points)
      : scene_(scene), normals_(normals), options_(options), poll_(cancel), points_(*points) {}

  // False: the token has fired.
  bool Place(size_t i) {
    if (!points_.valid[i]) return true;
    bool near = false, known = false;
    if (points_.sources[i] == kNoTriangle && options_.attach_distance > 0) known = Attach(i, &near);
    points_.attached += points_.sources[i] != kNoTriangle;
    if (options_.count_near_surface && !known) {
      const Vec3d p = ToDouble(points_.positions[i]);
      near = TouchesAny(scene_, p, WorldTouchRadius(NormOne(p)), points_.sources[i], &poll_);
    }
    points_.near_surface += options_.count_near_surface && near;
    return !poll_.stopped();
  }

 private:
  // False if no triangle is near enough. Otherwise *near says whether some touched triangle could
  // not be cleared.
  bool Attach(size_t i, bool* near) {
    const Vec3d p = ToDouble(points_.positions[i]);
    const double limit = options_.attach_distance;
    const NearestTriangle nearest = FindNearest(scene_, p, limit * limit, &poll_);
    if (nearest.triangle == kNoTriangle) return false;
    const TouchRadius radius = WorldTouchRadius(NormOne(p));
    const Vec3d* normal = normals_.empty() ? nullptr : &normals_[i];
    const int side = SideOfSource(scene_, nearest.triangle, points_.positions[i], radius, normal);
    const Placed placed = sightline::Place(scene_,
                                           {.at = p,
                                            .source = nearest.triangle,
                                            .side = side,
                                            .radius = radius,
                                            .reference = points_.positions[i]},
                                           &scratch_, &poll_);
    points_.positions[i] = placed.position;
    points_.sources[i] = nearest.triangle;
    *near = !placed.clear;
    return true;
  }

  const IndexedGeometry& scene_;
  const std::span<const Vec3d> normals_;
  const PointOptions& options_;
  PlacementScratch scratch_;
  PointPoll poll_;
  PreparedPoints& points_;
};

// Not inlined: float_environment.h says why.
ABSL_ATTRIBUTE_NOINLINE
absl::StatusOr<PreparedPoints> Rebased(const IndexedGeometry& scene, const PointInput& input,
                                       const PointOptions& options, const CancelToken* cancel) {
  const size_t n = input.positions.size();
  PreparedPoints points;
  points.positions.resize(n);
  points.valid.assign(n, 0);
  points.sources.assign(input.source_triangles.begin(), input.source_triangles.end());
  points.sources.resize(n, kNoTriangle);
  for (size_t i = 0; i < n; ++i) {
    if (i % kCancelBlock == 0 && cancel != nullptr && cancel->cancelled())
      return cancel->ToStatus();
    Vec3d world = input.positions[i];
    const bool placeable =
        options.offset == 0 || MoveAlong(input.normals[i], options.offset, &world);
    points.valid[i] = placeable && Rebase(world, scene.geometry.origin, &points.positions[i]);
    points.invalid += points.valid[i] == 0;
    points.attached += points.valid[i] != 0 && points.sources[i] != kNoTriangle;
  }
  return points;
}

// Nor this.
ABSL_ATTRIBUTE_NOINLINE
absl::Status PlaceAll(const IndexedGeometry& scene, std::span<const Vec3d> normals,
                      const PointOptions& options, const CancelToken* cancel,
                      PreparedPoints* points) {
  points->attached = points->near_surface = 0;
  Placer placer(scene, normals, options, cancel, points);
  for (size_t i = 0; i < points->size(); ++i) {
    if (i % kCancelBlock == 0 && cancel != nullptr && cancel->cancelled())
      return cancel->ToStatus();
    if (!placer.Place(i)) return cancel->ToStatus();
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<PreparedPoints> RebasePoints(const IndexedGeometry& scene, const PointInput& input,
                                            const PointOptions& options,
                                            const CancelToken* cancel) {
  const ScopedFloatEnvironment environment;
  SL_RETURN_IF_ERROR(CheckInput(scene, input, options));
  return Rebased(scene, input, options, cancel);
}

absl::Status PlacePoints(const IndexedGeometry& scene, std::span<const Vec3d> normals,
                         const PointOptions& options, const CancelToken* cancel,
                         PreparedPoints* points) {
  SIGHTLINE_DCHECK(normals.empty() || normals.size() == points->size());
  if (!WantsPlacing(options)) return absl::OkStatus();
  const ScopedFloatEnvironment environment;
  return PlaceAll(scene, normals, options, cancel, points);
}

absl::StatusOr<PreparedPoints> PreparePoints(const IndexedGeometry& scene, const PointInput& input,
                                             const PointOptions& options,
                                             const CancelToken* cancel) {
  SL_ASSIGN_OR_RETURN(PreparedPoints points, RebasePoints(scene, input, options, cancel));
  SL_RETURN_IF_ERROR(PlacePoints(scene, input.normals, options, cancel, &points));
  return points;
}

}  // namespace sightline
