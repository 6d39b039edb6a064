// SPDX-License-Identifier: Apache-2.0
#include "core/light/sun_position.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "core/light/horizon_frame.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

// What the header promises, in degrees.
constexpr double kAccuracy = 0.0127;

absl::Time Utc(const char* text) {
  absl::Time time;
  std::string error;
  EXPECT_TRUE(absl::ParseTime("%Y-%m-%dT%H:%M:%E*S", text, &time, &error)) << text << error;
  return time;
}

SunPosition Sun(const char* utc, double latitude, double longitude) {
  const absl::StatusOr<SunPosition> sun = FindSun(Utc(utc), {latitude, longitude});
  EXPECT_TRUE(sun.ok()) << sun.status();
  return sun.value_or(SunPosition{});
}

// The angle between two directions given by altitude and azimuth, all in degrees.
double Apart(const SunPosition& a, const SunPosition& b) {
  const HorizonFrame frame = *MakeHorizonFrame({0, 0, 1}, {0, 1, 0});
  const Vec3d p = frame.Toward(a.altitude_degrees, a.azimuth_degrees);
  const Vec3d q = frame.Toward(b.altitude_degrees, b.azimuth_degrees);
  return std::atan2(Length(Cross(p, q)), Dot(p, q)) * 180 / std::numbers::pi;
}

// Meeus, example 25.a. At the pole the altitude is the declination. His figure comes from the same
// formulas, the true one beside it from VSOP87.
TEST(SunPositionTest, MeeusExample) {
  const SunPosition sun = Sun("1992-10-13T00:00:00", 90, 0);
  EXPECT_NEAR(sun.altitude_degrees, -7.78507, 1e-5);
  EXPECT_NEAR(sun.altitude_degrees, -7.783871, kAccuracy);
}

// Reda and Andreas, "Solar position algorithm for solar radiation applications" (NREL/TP-560-34302,
// 2008), table A5.1: 2003 October 17, 12:30:30 at UTC-7, without their correction for air.
TEST(SunPositionTest, NrelExample) {
  const SunPosition sun = Sun("2003-10-17T19:30:30", 39.742476, -105.1786);
  EXPECT_LE(Apart(sun, {39.872046, 194.34024}), kAccuracy);
}

// The declination passes zero at equinoxes, and is the obliquity at solstices (times of 2020 and
// 2026 as almanacs print them, to the minute).
TEST(SunPositionTest, EquinoxesAndSolstices) {
  constexpr double kObliquity = 23.4365;
  for (const char* equinox :
       {"2020-03-20T03:50:00", "2020-09-22T13:31:00", "2026-03-20T14:46:00"}) {
    EXPECT_NEAR(Sun(equinox, 90, 0).altitude_degrees, 0, kAccuracy) << equinox;
  }
  EXPECT_NEAR(Sun("2020-06-20T21:44:00", 90, 0).altitude_degrees, kObliquity, kAccuracy);
  EXPECT_NEAR(Sun("2020-12-21T10:02:00", 90, 0).altitude_degrees, -kObliquity, kAccuracy);
  // Seen from the other pole it stands on its head.
  EXPECT_NEAR(Sun("2020-12-21T10:02:00", -90, 0).altitude_degrees, kObliquity, kAccuracy);
}

// Altitude and azimuth by XEphem's library (VSOP87, topocentric, without air).
TEST(SunPositionTest, AgreesWithAnEphemeris) {
  const struct {
    const char* utc;
    double latitude, longitude;
    SunPosition sun;
  } rows[] = {
      {"2026-06-21T12:00:00", 52.52, 13.405, {59.2843, 203.7395}},
      {"2026-12-21T09:30:00", -33.8688, 151.2093, {-5.2065, 237.1714}},
      {"2000-03-20T07:35:00", 0, 0, {21.8895, 90.0}},
      {"2024-02-29T23:59:30", 64.1466, -21.9426, {-30.5719, 330.7089}},
      {"1950-01-01T00:00:00", 35.6762, 139.6503, {19.5174, 140.0256}},
      {"2050-10-05T17:20:00", 40.7128, -74.0060, {43.5543, 192.3089}},
  };
  for (const auto& row : rows) {
    EXPECT_LE(Apart(Sun(row.utc, row.latitude, row.longitude), row.sun), kAccuracy) << row.utc;
  }
}

TEST(SunPositionTest, RisesInTheEastAndStandsOppositeThePole) {
  EXPECT_NEAR(Sun("2026-03-20T06:08:00", 0, 0).azimuth_degrees, 90, 0.2);
  EXPECT_NEAR(Sun("2026-03-20T18:00:00", 0, 0).azimuth_degrees, 270, 0.2);
  EXPECT_NEAR(Sun("2026-06-21T12:02:00", 50, 0).azimuth_degrees, 180, 0.5);
  const double north = Sun("2026-06-21T12:02:00", -50, 0).azimuth_degrees;
  EXPECT_NEAR(std::remainder(north, 360), 0, 0.5);
  EXPECT_LT(Sun("2026-06-21T00:00:00", 50, 0).altitude_degrees, 0);
}

TEST(SunPositionTest, BadArgumentsAreNamed) {
  const auto message = [](const char* utc, const EarthSite& site) {
    const absl::Status s = FindSun(Utc(utc), site).status();
    EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
    return std::string(s.message());
  };
  EXPECT_THAT(message("2026-06-21T12:00:00", {91, 0}), HasSubstr("latitude = 91"));
  EXPECT_THAT(message("2026-06-21T12:00:00", {0, -180.5}),
              HasSubstr("longitude = -180.5 degrees is outside -180 .. 180"));
  EXPECT_THAT(message("2026-06-21T12:00:00", {std::numeric_limits<double>::quiet_NaN(), 0}),
              HasSubstr("latitude = nan"));
  EXPECT_THAT(message("1799-12-31T23:59:59", {}), HasSubstr("1800 .. 2200, not for 1799-12-31"));
  EXPECT_THAT(message("2201-01-01T00:00:00", {}), HasSubstr("2201-01-01"));
  EXPECT_EQ(FindSun(absl::InfiniteFuture(), {}).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(FindSun(Utc("1800-01-01T00:00:00"), {-90, 180}).ok());
  EXPECT_TRUE(FindSun(Utc("2200-12-31T23:59:59"), {90, -180}).ok());
}

}  // namespace
}  // namespace sightline
