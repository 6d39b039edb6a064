// SPDX-License-Identifier: Apache-2.0
#include "client/cli/light_flags.h"

#include <cstdint>
#include <numbers>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"
#include "client/cli/exit_code.h"
#include "core/base/status_macros.h"
#include "core/light/horizon_frame.h"
#include "core/light/sky_patches.h"

namespace sightline::cli {
namespace {

// The skies that go by their number of patches, as parts to a side of Tregenza's.
constexpr uint32_t kSkySubdivisions[] = {1, 2, 4};

bool ParseTime(absl::string_view text, absl::Time* time) {
  // absl::ParseTime also knows blanks and "infinite-future", which are no time of day.
  if (text.empty() || text.find_first_not_of("0123456789-+:.TZ") != absl::string_view::npos) {
    return false;
  }
  for (const char* format : {"%Y-%m-%dT%H:%M%Ez", "%Y-%m-%dT%H:%M:%E*S%Ez"}) {
    if (absl::ParseTime(format, text, time, nullptr)) return true;
  }
  return false;
}

client::Light Directional(Vec3d d) { return client::Light::Directional({d.x, d.y, d.z}); }

}  // namespace

absl::StatusOr<TimedSun> ParseTimedSun(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ',');
  absl::Time time;
  EarthSite site;
  if (parts.size() != 3 || !ParseTime(parts[0], &time) ||
      !absl::SimpleAtod(parts[1], &site.latitude_degrees) ||
      !absl::SimpleAtod(parts[2], &site.longitude_degrees)) {
    return absl::InvalidArgumentError(
        "wants TIME,LATITUDE,LONGITUDE like 2026-06-21T12:00Z,52.5,13.4, the time with Z or an "
        "offset like +02:00, degrees north and east positive");
  }
  TimedSun sun{.text = std::string(text)};
  SL_ASSIGN_OR_RETURN(sun.position, FindSun(time, site));
  if (!(sun.position.altitude_degrees > 0)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "names a sun that stands %.2f degrees below the horizon; give a time between sunrise and "
        "sunset",
        -sun.position.altitude_degrees));
  }
  return sun;
}

void LightFlags::Register(FlagSet* flags) {
  flags->Points("light", "a point light, scene units", &points_);
  flags->Points("sun", "a light infinitely far away: the direction toward it, any length", &suns_);
  flags->Custom("sun-at", "TIME,LATITUDE,LONGITUDE",
                "the sun at a time and a place, as 2026-06-21T12:00Z,52.5,13.4 (+02:00 and the "
                "like instead of Z; degrees, north and east positive), to 0.013 degrees, without "
                "the air's refraction; may be repeated",
                "", [this](const std::string& text) -> absl::Status {
                  SL_ASSIGN_OR_RETURN(TimedSun sun, ParseTimedSun(text));
                  timed_suns_.push_back(std::move(sun));
                  return absl::OkStatus();
                });
  std::vector<std::string> skies = {"none"};
  for (const uint32_t m : kSkySubdivisions) skies.push_back(absl::StrCat(SkyPatchCount(m)));
  flags->Choice("sky", std::move(skies),
                "a light for each patch of the sky: Tregenza's 145, or Reinhart's finer divisions; "
                "row by row from the horizon, each from north by way of east, the zenith last",
                &sky_);
  flags->Point("north",
               "north for --sun-at and --sky, of which the level part counts (default: +y, or -z "
               "where y is up)",
               &north_);
}

bool LightFlags::given() const {
  return !points_.empty() || !suns_.empty() || !timed_suns_.empty() || sky_ != "none";
}

absl::StatusOr<std::vector<client::Light>> LightFlags::Lights(Vec3d up) const {
  std::vector<client::Light> lights;
  for (const Vec3d& p : points_) lights.push_back(client::Light::Point({p.x, p.y, p.z}));
  for (const Vec3d& d : suns_) lights.push_back(Directional(d));
  if (timed_suns_.empty() && sky_ == "none") return lights;
  const absl::StatusOr<HorizonFrame> frame =
      MakeHorizonFrame(up, north_.value_or(DefaultNorth(up)));
  if (!frame.ok())
    return UsageError(absl::StrCat("--sun-at and --sky: ", frame.status().message()));
  for (const TimedSun& sun : timed_suns_) {
    lights.push_back(
        Directional(frame->Toward(sun.position.altitude_degrees, sun.position.azimuth_degrees)));
  }
  for (const uint32_t m : kSkySubdivisions) {
    if (sky_ != absl::StrCat(SkyPatchCount(m))) continue;
    SL_ASSIGN_OR_RETURN(const std::vector<SkyPatch> sky, SkyPatches(m));
    for (const SkyPatch& patch : sky) {
      lights.push_back(Directional(frame->Toward(patch.altitude_degrees, patch.azimuth_degrees)));
      lights.back().weight = patch.solid_angle / std::numbers::pi;
    }
  }
  return lights;
}

}  // namespace sightline::cli
