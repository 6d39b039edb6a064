// SPDX-License-Identifier: Apache-2.0
#include "core/query/points.h"

#include <cmath>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/intersect/predicate.h"
#include "core/mesh/rebase.h"
#include "core/query/nearest_triangle.h"
#include "core/query/placement.h"

namespace sightline {
namespace {

// Points between two looks at the cancel token: some hundred microseconds of work.
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

// The side of the source that the stored point p is on (see points.h).
int SideOfSource(const IndexedGeometry& scene, uint32_t source, Vec3f p, TouchRadius radius,
                 const Vec3d* normal) {
  const auto [a, b, c] = scene.geometry.Corners(source);
  const double touch = radius.Of(a, b, c);
  const Vec3d ad = ToDouble(a);
  const Vec3d n = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
  const double height = Dot(n, ToDouble(p) - ad);
  if (height * height > (touch * touch) * Dot(n, n)) {
    const int side = SideOfPlane(a, b, c, p);
    if (side != 0) return side;
  }
  return normal != nullptr && Dot(n, *normal) < 0 ? -1 : 1;
}

class Preparer {
 public:
  Preparer(const IndexedGeometry& scene, const PointInput& input, const PointOptions& options)
      : scene_(scene), input_(input), options_(options) {
    const size_t n = input.positions.size();
    out_.positions.resize(n);
    out_.sources.assign(n, kNoTriangle);
    out_.valid.assign(n, 0);
  }

  void Prepare(size_t i) {
    Vec3d world = input_.positions[i];
    const bool placeable =
        options_.offset == 0 || MoveAlong(input_.normals[i], options_.offset, &world);
    if (!input_.source_triangles.empty()) out_.sources[i] = input_.source_triangles[i];
    if (!placeable || !Rebase(world, scene_.geometry.origin, &out_.positions[i])) {
      ++out_.invalid;
      return;
    }
    out_.valid[i] = 1;
    bool near = false, known = false;
    if (out_.sources[i] == kNoTriangle && options_.attach_distance > 0) known = Attach(i, &near);
    out_.attached += out_.sources[i] != kNoTriangle;
    if (!options_.count_near_surface) return;
    if (!known) {
      const Vec3d p = ToDouble(out_.positions[i]);
      near = TouchesAny(scene_, p, WorldTouchRadius(NormOne(p)), out_.sources[i]);
    }
    out_.near_surface += near;
  }

  PreparedPoints Take() { return std::move(out_); }

 private:
  // False if no triangle is near enough. Otherwise *near says whether some touched triangle could
  // not be cleared.
  bool Attach(size_t i, bool* near) {
    const Vec3d p = ToDouble(out_.positions[i]);
    const double limit = options_.attach_distance;
    const NearestTriangle nearest = FindNearest(scene_, p, limit * limit);
    if (nearest.triangle == kNoTriangle) return false;
    const TouchRadius radius = WorldTouchRadius(NormOne(p));
    const Vec3d* normal = input_.normals.empty() ? nullptr : &input_.normals[i];
    const int side = SideOfSource(scene_, nearest.triangle, out_.positions[i], radius, normal);
    const Placed placed = Place(scene_,
                                {.at = p,
                                 .source = nearest.triangle,
                                 .side = side,
                                 .radius = radius,
                                 .reference = out_.positions[i]},
                                &scratch_);
    out_.positions[i] = placed.position;
    out_.sources[i] = nearest.triangle;
    *near = !placed.clear;
    return true;
  }

  const IndexedGeometry& scene_;
  const PointInput& input_;
  const PointOptions& options_;
  PlacementScratch scratch_;
  PreparedPoints out_;
};

}  // namespace

absl::StatusOr<PreparedPoints> PreparePoints(const IndexedGeometry& scene, const PointInput& input,
                                             const PointOptions& options,
                                             const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckInput(scene, input, options));
  Preparer preparer(scene, input, options);
  for (size_t i = 0; i < input.positions.size(); ++i) {
    if (i % kCancelBlock == 0 && cancel != nullptr && cancel->cancelled())
      return cancel->ToStatus();
    preparer.Prepare(i);
  }
  return preparer.Take();
}

}  // namespace sightline
