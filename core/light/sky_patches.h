// SPDX-License-Identifier: Apache-2.0
//
// The sky cut into patches: Tregenza's 145 (P. R. Tregenza, "Subdivision of the sky hemisphere for
// luminance measurements", Lighting Research and Technology 19, 1987; CIE 108-1994), and their
// finer divisions by C. F. Reinhart, 577 and 2305, as Radiance lays them out (reinhart.cal).
//
// With M parts to a side, there are 7M rows of equal height around the zenith, and a cap of half
// that height (as an angle from the zenith): a row is 90° / (7M + ½) high. Tregenza's rows have 30,
// 30, 24, 24, 18, 12 and 6 patches; of his row k the M rows that replace it have M times as many.
// In each row the first patch is centred on north, and they go by way of east. The order is row by
// row from the horizon; the zenith is last.
//
// Uses libm: patches are prepared, and can be read back; no answer depends on how they were found.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(std::vector<SkyPatch> sky, SkyPatches(/*subdivision=*/1));
//   for (const SkyPatch& patch : sky) lights.push_back(Light::Directional(
//       frame.Toward(patch.altitude_degrees, patch.azimuth_degrees)));
#ifndef SIGHTLINE_CORE_LIGHT_SKY_PATCHES_H_
#define SIGHTLINE_CORE_LIGHT_SKY_PATCHES_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"

namespace sightline {

struct SkyPatch {
  // Of its centre: the middle of its range of altitudes, and of azimuths.
  double altitude_degrees = 0;
  double azimuth_degrees = 0;  // 0 .. 360, from north by way of east.
  double solid_angle = 0;      // Steradians; 2π over the whole sky.
  uint32_t row = 0;            // From the horizon, 0; the zenith's is 7M.
};

inline constexpr uint32_t kMaxSkySubdivision = 16;  // 36,865 patches.

// 144·M² + 1: 145, 577, 1297, 2305 for 1, 2, 3, 4.
constexpr uint32_t SkyPatchCount(uint32_t subdivision) {
  return 144 * subdivision * subdivision + 1;
}

// `subdivision`: M above, 1 .. kMaxSkySubdivision; others are InvalidArgument.
absl::StatusOr<std::vector<SkyPatch>> SkyPatches(uint32_t subdivision);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_LIGHT_SKY_PATCHES_H_
