// SPDX-License-Identifier: Apache-2.0
//
// The lights that a command line names: points, directions, suns by time and place, a sky of
// patches. They become lights of the service, which knows points and directions alone.
//
// Thread safety: none; belongs to one command, like its FlagSet.
//
//   LightFlags lights;
//   lights.Register(&flags);
//   ... parse ...
//   SL_ASSIGN_OR_RETURN(query.lights, lights.Lights(up));
#ifndef SIGHTLINE_CLIENT_CLI_LIGHT_FLAGS_H_
#define SIGHTLINE_CLIENT_CLI_LIGHT_FLAGS_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/cli/flags.h"
#include "client/lib/types.h"
#include "core/geometry/vec3.h"
#include "core/light/sun_position.h"

namespace sightline::cli {

// A sun as --sun-at names it, above the horizon.
struct TimedSun {
  std::string text;  // TIME,LATITUDE,LONGITUDE as given.
  SunPosition position;
};

// TIME,LATITUDE,LONGITUDE; TIME as RFC 3339 has it, with Z or an offset from UTC, seconds optional.
// InvalidArgument: anything else, a value out of range, or a sun that has set.
absl::StatusOr<TimedSun> ParseTimedSun(absl::string_view text);

class LightFlags {
 public:
  // --light, --sun, --sun-at, --sky, --north. What --up says is the command's.
  void Register(FlagSet* flags);

  // Whether any flag names a light.
  bool given() const;
  const std::vector<TimedSun>& timed_suns() const { return timed_suns_; }

  // All of them, in the order of the flags above, in a scene with this upward direction. A patch of
  // the sky weighs its solid angle over π: an even sky then gives level ground as much as one light
  // overhead of weight 1. Usage errors: an `up` or a --north without a direction.
  absl::StatusOr<std::vector<client::Light>> Lights(Vec3d up) const;

 private:
  std::vector<Vec3d> points_, suns_;
  std::vector<TimedSun> timed_suns_;
  std::string sky_ = "none";
  std::optional<Vec3d> north_;
};

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_LIGHT_FLAGS_H_
