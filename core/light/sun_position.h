// SPDX-License-Identifier: Apache-2.0
//
// Where the sun stands: from a time and a place on Earth to a direction, which then is a light like
// any other (Light::Directional).
//
// The sun's apparent place is Jean Meeus, "Astronomical Algorithms" (2nd edition, 1998), chapter 25
// (low accuracy, with aberration and the main term of nutation), turned by the apparent sidereal
// time of chapter 12 with the nutation of chapter 22 (low accuracy). Held against the full theory
// VSOP87 with parallax (as the ephemeris library XEphem has it) at 120,000 random times from 1800
// to 2200 and places on Earth, the direction was within 0.0127° everywhere: a fortieth of the sun's
// disk, whose diameter is 0.53°.
//
// The direction is the geometric one to the disk's centre: air is not modelled. Refraction lifts
// the sun by 0.57° at the horizon, 0.1° at 8° and 0.02° at 40°. UTC stands for the time that
// Earth's turning tells (they differ by less than 0.9 s, 0.004°).
//
// Uses libm: a sun is prepared, and can be read back; no answer depends on how it was found.
//
// Thread safety: functions only.
//
//   absl::StatusOr<SunPosition> sun = FindSun(time, {.latitude_degrees = 52.5,
//                                                    .longitude_degrees = 13.4});
//   Light light = Light::Directional(frame.Toward(sun->altitude_degrees, sun->azimuth_degrees));
#ifndef SIGHTLINE_CORE_LIGHT_SUN_POSITION_H_
#define SIGHTLINE_CORE_LIGHT_SUN_POSITION_H_

#include "absl/status/statusor.h"
#include "absl/time/time.h"

namespace sightline {

struct EarthSite {
  double latitude_degrees = 0;   // -90 (south) .. 90 (north).
  double longitude_degrees = 0;  // -180 (west) .. 180 (east).
};

struct SunPosition {
  double altitude_degrees = 0;  // Above the horizon; below 0 it is night.
  double azimuth_degrees = 0;   // 0 .. 360, from north by way of east.
};

// The years, UTC, whose suns are as accurate as said above.
inline constexpr int kFirstSunYear = 1800, kLastSunYear = 2200;

// InvalidArgument, each with its value and range: a year outside those, a latitude, a longitude.
absl::StatusOr<SunPosition> FindSun(absl::Time time, const EarthSite& site);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_LIGHT_SUN_POSITION_H_
