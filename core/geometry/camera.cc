// SPDX-License-Identifier: Apache-2.0
#include "core/geometry/camera.h"

#include <cmath>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace sightline {
namespace {

std::string Describe(Vec3d v) { return absl::StrFormat("(%.17g, %.17g, %.17g)", v.x, v.y, v.z); }

absl::Status CheckUnit(const char* name, Vec3d v) {
  if (!IsFinite(v) || !(std::abs(Dot(v, v) - 1.0) <= kBasisTolerance)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera.", name, " = ", Describe(v), " is not a unit vector"));
  }
  return absl::OkStatus();
}

absl::Status CheckOrthogonal(const char* names, Vec3d a, Vec3d b) {
  const double dot = Dot(a, b);
  if (!(std::abs(dot) <= kBasisTolerance)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera.", names, " are not orthogonal: their dot product is ", dot));
  }
  return absl::OkStatus();
}

absl::Status CheckSide(const char* name, uint32_t side) {
  if (side == 0 || side > kMaxImageSide) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera.", name, " = ", side, " is outside 1 .. ", kMaxImageSide));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ValidateCamera(const Camera& camera) {
  if (absl::Status s = CheckSide("width", camera.width); !s.ok()) return s;
  if (absl::Status s = CheckSide("height", camera.height); !s.ok()) return s;
  if (!IsFinite(camera.eye)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera.eye = ", Describe(camera.eye), " is not finite"));
  }
  if (absl::Status s = CheckUnit("right", camera.right); !s.ok()) return s;
  if (absl::Status s = CheckUnit("up", camera.up); !s.ok()) return s;
  if (absl::Status s = CheckUnit("forward", camera.forward); !s.ok()) return s;
  if (absl::Status s = CheckOrthogonal("right and up", camera.right, camera.up); !s.ok()) return s;
  if (absl::Status s = CheckOrthogonal("right and forward", camera.right, camera.forward);
      !s.ok()) {
    return s;
  }
  if (absl::Status s = CheckOrthogonal("up and forward", camera.up, camera.forward); !s.ok())
    return s;
  if (!(camera.tan_half_fov_y >= kMinTanHalfFov && camera.tan_half_fov_y <= kMaxTanHalfFov)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera.tan_half_fov_y = ", camera.tan_half_fov_y, " is outside ",
                     kMinTanHalfFov, " .. ", kMaxTanHalfFov));
  }
  return absl::OkStatus();
}

absl::StatusOr<Camera> LookAt(Vec3d eye, Vec3d at, Vec3d up, double fov_y_degrees, uint32_t width,
                              uint32_t height) {
  if (!IsFinite(eye) || !IsFinite(at) || !IsFinite(up)) {
    return absl::InvalidArgumentError(absl::StrCat("camera eye ", Describe(eye), ", at ",
                                                   Describe(at), ", up ", Describe(up),
                                                   ": not finite"));
  }
  const Vec3d view = at - eye;
  const double distance = Length(view);
  if (!(distance > 0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera eye = at = ", Describe(eye), ": there is no direction to look in"));
  }
  if (!(fov_y_degrees > 0 && fov_y_degrees < 180)) {
    return absl::InvalidArgumentError(
        absl::StrCat("camera fov = ", fov_y_degrees, " degrees is outside (0, 180)"));
  }
  Camera camera;
  camera.eye = eye;
  camera.forward = view * (1.0 / distance);
  const Vec3d side = Cross(camera.forward, up);
  const double side_length = Length(side);
  if (!(side_length > kBasisTolerance * Length(up))) {
    return absl::InvalidArgumentError(absl::StrCat(
        "camera up = ", Describe(up), " is along the view direction ", Describe(camera.forward)));
  }
  camera.right = side * (1.0 / side_length);
  camera.up = Cross(camera.right, camera.forward);
  camera.tan_half_fov_y = std::tan(fov_y_degrees * (std::numbers::pi / 360.0));
  camera.width = width;
  camera.height = height;
  if (absl::Status s = ValidateCamera(camera); !s.ok()) return s;
  return camera;
}

Vec3d PixelColumn(const Camera& camera, uint32_t x) {
  const double w = camera.width, h = camera.height;
  const double sx = ((2.0 * (x + 0.5)) / w - 1.0) * (camera.tan_half_fov_y * (w / h));
  return camera.forward + camera.right * sx;
}

Vec3d PixelRow(const Camera& camera, uint32_t y) {
  const double h = camera.height;
  const double sy = (1.0 - (2.0 * (y + 0.5)) / h) * camera.tan_half_fov_y;
  return camera.up * sy;
}

Vec3f PixelDirection(const Camera& camera, uint32_t x, uint32_t y) {
  return ToFloat(PixelColumn(camera, x) + PixelRow(camera, y));
}

}  // namespace sightline
