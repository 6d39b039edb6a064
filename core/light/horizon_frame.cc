// SPDX-License-Identifier: Apache-2.0
#include "core/light/horizon_frame.h"

#include <cmath>
#include <numbers>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

// The least level share of a unit `north`: below it the direction is mostly what `up` left of it.
constexpr double kLeastLevelShare = 0x1p-10;

// Scaled by its largest component first, so that no square over- or underflows. Zero if there is
// no direction.
Vec3d Unit(Vec3d v) {
  const double size = MaxAbs(v);
  if (!(size > 0) || !std::isfinite(size)) return {};
  v = {v.x / size, v.y / size, v.z / size};
  return v * (1 / Length(v));
}

absl::Status NoDirection(const char* name, Vec3d v, const char* what) {
  return absl::InvalidArgumentError(
      absl::StrCat(name, " = (", v.x, ", ", v.y, ", ", v.z, ") ", what));
}

}  // namespace

Vec3d HorizonFrame::Toward(double altitude_degrees, double azimuth_degrees) const {
  constexpr double kDegree = std::numbers::pi / 180;
  const double altitude = altitude_degrees * kDegree, azimuth = azimuth_degrees * kDegree;
  return (north * std::cos(azimuth) + east * std::sin(azimuth)) * std::cos(altitude) +
         up * std::sin(altitude);
}

absl::StatusOr<HorizonFrame> MakeHorizonFrame(Vec3d up, Vec3d north) {
  HorizonFrame frame;
  frame.up = Unit(up);
  if (frame.up == Vec3d{}) {
    return NoDirection("up", up, "has no direction; give a finite vector that is not zero");
  }
  const Vec3d ahead = Unit(north);
  if (ahead == Vec3d{}) {
    return NoDirection("north", north, "has no direction; give a finite vector that is not zero");
  }
  const Vec3d level = ahead - frame.up * Dot(ahead, frame.up);
  if (!(Length(level) >= kLeastLevelShare)) {
    return NoDirection("north", north, "points up or down; give one that is level or nearly so");
  }
  frame.north = Unit(level);
  frame.east = Unit(Cross(frame.north, frame.up));
  return frame;
}

Vec3d DefaultNorth(Vec3d up) {
  return std::abs(up.y) == MaxAbs(up) ? Vec3d{0, 0, -1} : Vec3d{0, 1, 0};
}

}  // namespace sightline
