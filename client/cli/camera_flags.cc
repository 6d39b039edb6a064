// SPDX-License-Identifier: Apache-2.0
#include "client/cli/camera_flags.h"

#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "client/cli/exit_code.h"
#include "core/geometry/camera.h"

namespace sightline::cli {
namespace {

absl::Status ParseSize(const std::string& text, CameraFlags* flags) {
  const std::vector<std::string> parts = absl::StrSplit(text, 'x');
  uint32_t w = 0, h = 0;
  if (parts.size() != 2 || !absl::SimpleAtoi(parts[0], &w) || !absl::SimpleAtoi(parts[1], &h) ||
      w == 0 || h == 0 || w > kMaxImageSide || h > kMaxImageSide) {
    return absl::InvalidArgumentError(
        absl::StrCat("wants WIDTHxHEIGHT in pixels, each from 1 to ", kMaxImageSide));
  }
  if (uint64_t{w} * h > kMaxPixels) {
    return absl::InvalidArgumentError(
        absl::StrCat("has ", uint64_t{w} * h, " pixels; at most ", kMaxPixels, " are allowed"));
  }
  flags->width = w;
  flags->height = h;
  return absl::OkStatus();
}

}  // namespace

void CameraFlags::Register(FlagSet* flags) {
  flags->Heading("Camera (what is not given is chosen by rule, see below)");
  flags->Point("eye", "where the camera is, scene units", &eye);
  flags->Point("at", "the point in the middle of the picture, scene units", &at);
  flags->Point("up", "upward direction in the picture, any length", &up);
  flags->Custom("fov", "DEGREES", "vertical field of view, above 0 and at most 179.9", "by rule",
                [this](const std::string& text) -> absl::Status {
                  double degrees = 0;
                  if (!absl::SimpleAtod(text, &degrees) || !(degrees > 0 && degrees <= 179.9)) {
                    return absl::InvalidArgumentError("wants degrees above 0 and at most 179.9");
                  }
                  fov_y_degrees = degrees;
                  return absl::OkStatus();
                });
  flags->Custom("size", "WIDTHxHEIGHT", "size of the picture in pixels",
                absl::StrCat(width, "x", height),
                [this](const std::string& text) { return ParseSize(text, this); });
}

absl::StatusOr<client::Camera> CameraFlags::CameraOf(const ViewChoice& view) const {
  const absl::StatusOr<Camera> camera =
      LookAt(view.eye, view.at, view.up, view.fov_y_degrees, width, height);
  if (!camera.ok()) return WithExitCode(camera.status(), kExitUsage);
  const auto point = [](Vec3d v) { return client::Point3{v.x, v.y, v.z}; };
  return client::Camera{.eye = point(camera->eye),
                        .right = point(camera->right),
                        .up = point(camera->up),
                        .forward = point(camera->forward),
                        .tan_half_fov_y = camera->tan_half_fov_y,
                        .width = camera->width,
                        .height = camera->height};
}

}  // namespace sightline::cli
