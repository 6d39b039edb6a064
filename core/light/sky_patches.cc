// SPDX-License-Identifier: Apache-2.0
#include "core/light/sky_patches.h"

#include <cmath>
#include <iterator>
#include <numbers>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

constexpr uint32_t kTregenzaRows[] = {30, 30, 24, 24, 18, 12, 6};
constexpr uint32_t kRows = std::size(kTregenzaRows);

double Sine(double degrees) { return std::sin(degrees * (std::numbers::pi / 180)); }

}  // namespace

absl::StatusOr<std::vector<SkyPatch>> SkyPatches(uint32_t subdivision) {
  if (subdivision == 0 || subdivision > kMaxSkySubdivision) {
    return absl::InvalidArgumentError(
        absl::StrCat("sky subdivision = ", subdivision, " is outside 1 .. ", kMaxSkySubdivision));
  }
  std::vector<SkyPatch> patches;
  patches.reserve(SkyPatchCount(subdivision));
  const uint32_t rows = kRows * subdivision;
  const double height = 90 / (rows + 0.5);
  for (uint32_t row = 0; row < rows; ++row) {
    const uint32_t count = subdivision * kTregenzaRows[row / subdivision];
    const double around = 2 * std::numbers::pi / count;
    const double solid_angle = around * (Sine((row + 1) * height) - Sine(row * height));
    for (uint32_t i = 0; i < count; ++i) {
      patches.push_back({.altitude_degrees = (row + 0.5) * height,
                         .azimuth_degrees = 360.0 * i / count,
                         .solid_angle = solid_angle,
                         .row = row});
    }
  }
  patches.push_back({.altitude_degrees = 90,
                     .azimuth_degrees = 0,
                     .solid_angle = 2 * std::numbers::pi * (1 - Sine(rows * height)),
                     .row = rows});
  return patches;
}

}  // namespace sightline
