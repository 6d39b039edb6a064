// SPDX-License-Identifier: Apache-2.0
#include "core/query/mirrors.h"

#include <algorithm>
#include <cmath>

#include "absl/base/attributes.h"
#include "absl/strings/str_cat.h"
#include "core/base/float_environment.h"
#include "core/base/status_macros.h"
#include "core/query/tile_result.h"

namespace sightline {
namespace {

// Triangles or vertices between two looks at the cancel token: some dozen microseconds.
constexpr uint32_t kPollInterval = 4096;

absl::Status Poll(uint32_t i, const CancelToken* cancel) {
  return i % kPollInterval == 0 && cancel != nullptr ? cancel->ToStatus() : absl::OkStatus();
}

struct ScenePlane {
  Vec3d point, normal;
};

// Coordinates stay far from where their squares' squares overflow or vanish.
absl::Status CheckNormal(absl::string_view name, Vec3d normal) {
  const double square = Dot(normal, normal);
  if (std::isfinite(square) && std::isfinite(1 / square)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(name, " = (", normal.x, ", ", normal.y, ", ",
                                                 normal.z, ") is not the normal of a plane"));
}

// The plane of an object's largest triangle.
absl::StatusOr<ScenePlane> PlaneOf(const SceneGeometry& geometry, absl::string_view name,
                                   const ObjectRecord& object, const CancelToken* cancel) {
  ScenePlane plane;
  double largest = 0;
  for (uint32_t i = 0; i < object.triangle_count; ++i) {
    SL_RETURN_IF_ERROR(Poll(i, cancel));
    const uint32_t id = object.first_triangle + i;
    const auto [a, b, c] = geometry.Corners(id);
    const Vec3d normal = Cross(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a));
    const double square = Dot(normal, normal);
    // Inert triangles have no area, or none that is a number.
    if (!(square > largest) || !std::isfinite(square)) continue;
    largest = square;
    plane = {ToDouble(a), normal};
  }
  if (largest == 0) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ".object = \"", object.name, "\" has no triangle to be a mirror"));
  }
  SL_RETURN_IF_ERROR(CheckNormal(absl::StrCat(name, ".object's normal"), plane.normal));
  double farthest = 0, width = 0;
  for (uint32_t i = 0; i < object.vertex_count; ++i) {
    SL_RETURN_IF_ERROR(Poll(i, cancel));
    const Vec3f v = geometry.vertices[object.first_vertex + i];
    if (!IsFinite(v)) continue;
    const Vec3d from = ToDouble(v) - plane.point;
    farthest = std::max(farthest, std::abs(Dot(from, plane.normal)));
    width = std::max({width, std::abs(from.x), std::abs(from.y), std::abs(from.z)});
  }
  farthest /= std::sqrt(largest);
  if (farthest <= kMostBulge * width) return plane;
  return absl::InvalidArgumentError(absl::StrCat(
      name, ".object = \"", object.name, "\" is not flat: a vertex lies ", farthest,
      " off the plane of its largest triangle; give the mirror's plane, or an object of its own"));
}

}  // namespace

PreparedMirror::PreparedMirror(TriangleRange triangles, Vec3d point, Vec3d normal, Vec3f eye)
    : triangles_(triangles), normal_(normal), square_(Dot(normal, normal)) {
  eye_ = ToFloat(Mirrored(ToDouble(eye), 2 * Dot(ToDouble(eye) - point, normal)));
}

Vec3f PreparedMirror::Direction(Vec3f direction) const {
  const Vec3d d = ToDouble(direction);
  return ToFloat(Mirrored(d, 2 * Dot(d, normal_)));
}

Vec3d PreparedMirror::Mirrored(Vec3d v, double along) const {
  return v - normal_ * (along / square_);
}

absl::StatusOr<PreparedMirrors> PreparedMirrors::Prepare(const SceneGeometry& geometry,
                                                         std::span<const Mirror> mirrors, Vec3f eye,
                                                         const CancelToken* cancel) {
  if (mirrors.size() > kMaxMirrors) {
    return absl::InvalidArgumentError(absl::StrCat("mirrors: there are ", mirrors.size(),
                                                   ", and may be ", kMaxMirrors, " at most"));
  }
  PreparedMirrors prepared;
  for (size_t i = 0; i < mirrors.size(); ++i) {
    const Mirror& mirror = mirrors[i];
    const std::string name = absl::StrCat("mirrors[", i, "]");
    if (mirror.object >= geometry.objects.size()) {
      return absl::InvalidArgumentError(absl::StrCat(name, ".object = ", mirror.object,
                                                     ": the scene has ", geometry.objects.size(),
                                                     " objects"));
    }
    const ObjectRecord& object = geometry.objects[mirror.object];
    for (size_t k = 0; k < i; ++k) {
      if (mirrors[k].object != mirror.object) continue;
      return absl::InvalidArgumentError(absl::StrCat(
          name, ".object = \"", object.name, "\" is mirrors[", k, "]'s, too: name it once"));
    }
    ScenePlane plane;
    if (mirror.plane.has_value()) {
      if (!IsFinite(mirror.plane->point)) {
        return absl::InvalidArgumentError(absl::StrCat(name, ".plane.point is not finite"));
      }
      SL_RETURN_IF_ERROR(CheckNormal(absl::StrCat(name, ".plane.normal"), mirror.plane->normal));
      plane = {mirror.plane->point - geometry.origin, mirror.plane->normal};
    } else {
      SL_ASSIGN_OR_RETURN(plane, PlaneOf(geometry, name, object, cancel));
    }
    const PreparedMirror made({object.first_triangle, object.triangle_count}, plane.point,
                              plane.normal, eye);
    if (!(MaxAbs(made.eye()) <= static_cast<float>(kMaxCoordinate))) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, ": the eye's mirror image lies beyond 2^40 along an axis"));
    }
    prepared.mirrors_.push_back(made);
  }
  return prepared;
}

namespace {

// Not inlined: float_environment.h says why.
ABSL_ATTRIBUTE_NOINLINE
absl::StatusOr<PreparedMirrors> PrepareFor(const SceneGeometry& geometry,
                                           std::span<const Mirror> mirrors, const Camera& camera,
                                           const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(ValidateCamera(camera));
  SL_ASSIGN_OR_RETURN(const Vec3f eye, EyeInScene(camera, geometry.origin));
  return PreparedMirrors::Prepare(geometry, mirrors, eye, cancel);
}

}  // namespace

absl::StatusOr<PreparedMirrors> PrepareMirrors(const SceneGeometry& geometry,
                                               std::span<const Mirror> mirrors,
                                               const Camera& camera, const CancelToken* cancel) {
  const ScopedFloatEnvironment environment;
  return PrepareFor(geometry, mirrors, camera, cancel);
}

}  // namespace sightline
