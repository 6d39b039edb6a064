// SPDX-License-Identifier: Apache-2.0
#include "core/light/sun_position.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

double Sine(double degrees) { return std::sin(degrees * kDegree); }
double Cosine(double degrees) { return std::cos(degrees * kDegree); }

// Days since 2000 January 1, 12h (JD 2451545.0). Dynamical time is up to some minutes ahead of UTC;
// the sun moves 0.0007° a minute among the stars, and it is left out.
double DaysSince2000(absl::Time time) {
  static const absl::Time kEpoch = absl::FromUnixSeconds(946'728'000);
  return absl::ToDoubleSeconds(time - kEpoch) / 86'400;
}

// Coordinates of the sky that turns, in degrees.
struct Equatorial {
  double right_ascension = 0, declination = 0;
};

// Meeus, chapter 25. `t` in Julian centuries since 2000; numbers are degrees unless said otherwise.
Equatorial ApparentSun(double t) {
  const double mean_longitude = 280.46646 + t * (36000.76983 + t * 0.0003032);
  const double anomaly = 357.52911 + t * (35999.05029 - t * 0.0001537);
  const double centre = (1.914602 - t * (0.004817 + t * 0.000014)) * Sine(anomaly) +
                        (0.019993 - t * 0.000101) * Sine(2 * anomaly) +
                        0.000289 * Sine(3 * anomaly);
  const double node = 125.04 - 1934.136 * t;
  // Aberration and the main term of nutation (25.8).
  const double longitude = mean_longitude + centre - 0.00569 - 0.00478 * Sine(node);
  // The mean obliquity in arc seconds (22.2), and its nutation (25.8).
  const double mean_obliquity = 84381.448 - t * (46.8150 + t * (0.00059 - t * 0.001813));
  const double obliquity = mean_obliquity / 3600 + 0.00256 * Cosine(node);
  return {
      .right_ascension =
          std::atan2(Cosine(obliquity) * Sine(longitude), Cosine(longitude)) / kDegree,
      .declination = std::asin(std::clamp(Sine(obliquity) * Sine(longitude), -1.0, 1.0)) / kDegree};
}

// Apparent sidereal time at Greenwich (12.4, chapter 12; nutation as at the head of chapter 22).
double SiderealTime(double days, double t) {
  const double mean =
      280.46061837 + 360.98564736629 * days + t * t * (0.000387933 - t / 38'710'000);
  const double node = 125.04 - 1934.136 * t;
  const double sun = 280.4665 + 36000.7698 * t, moon = 218.3165 + 481267.8813 * t;
  const double nutation = -17.20 * Sine(node) - 1.32 * Sine(2 * sun) - 0.23 * Sine(2 * moon) +
                          0.21 * Sine(2 * node);  // Arc seconds.
  constexpr double kObliquity = 23.44;  // Good to 0.03° here, which the term does not see.
  return mean + nutation / 3600 * Cosine(kObliquity);
}

absl::Status CheckRange(const char* name, double value, double limit) {
  if (value >= -limit && value <= limit) return absl::OkStatus();  // NaN is outside.
  return absl::InvalidArgumentError(
      absl::StrCat(name, " = ", value, " degrees is outside -", limit, " .. ", limit));
}

}  // namespace

absl::StatusOr<SunPosition> FindSun(absl::Time time, const EarthSite& site) {
  const int64_t year = absl::ToCivilYear(time, absl::UTCTimeZone()).year();
  if (year < kFirstSunYear || year > kLastSunYear) {
    return absl::InvalidArgumentError(
        absl::StrCat("the sun's place is known for the years ", kFirstSunYear, " .. ", kLastSunYear,
                     ", not for ", absl::FormatTime(absl::RFC3339_sec, time, absl::UTCTimeZone())));
  }
  SL_RETURN_IF_ERROR(CheckRange("latitude", site.latitude_degrees, 90));
  SL_RETURN_IF_ERROR(CheckRange("longitude", site.longitude_degrees, 180));
  const double days = DaysSince2000(time), t = days / 36'525;
  const Equatorial sun = ApparentSun(t);
  const double hour = SiderealTime(days, t) + site.longitude_degrees - sun.right_ascension;
  const double latitude = site.latitude_degrees, declination = sun.declination;
  // The sun's direction by way of east, north and up (chapter 13).
  const double level = Cosine(declination) * Cosine(hour);
  const double east = -Cosine(declination) * Sine(hour);
  const double north = Sine(declination) * Cosine(latitude) - level * Sine(latitude);
  const double up = Sine(declination) * Sine(latitude) + level * Cosine(latitude);
  const double azimuth = std::atan2(east, north) / kDegree;
  return SunPosition{.altitude_degrees = std::atan2(up, std::hypot(east, north)) / kDegree,
                     .azimuth_degrees = azimuth < 0 ? azimuth + 360 : azimuth};
}

}  // namespace sightline
