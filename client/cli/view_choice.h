// SPDX-License-Identifier: Apache-2.0
//
// Where the camera and the lights stand when the command line does not say.
//
// Built-in scenes: their own first view with its three lights.
//
// Files and servers' scenes: what --eye, --at and --up leave open is chosen by rule. The whole
// scene is seen from outside, 35 degrees off the front and 25 from above (flat ones 40); or, when
// it is a room (most points in it see fronts of triangles all around; told of files alone, whose
// triangles are at hand), from the place inside that sees farthest. Three lights stand about the
// view, inside a room within free sight.
//
// "Up" of a file is z when it says so (.stl, or a scene three times wider than high along z), else
// y. The rules ask the server about a few thousand segments; the same scene gives the same choice.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_CLI_VIEW_CHOICE_H_
#define SIGHTLINE_CLIENT_CLI_VIEW_CHOICE_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/light_flags.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "core/geometry/box3.h"
#include "core/geometry/vec3.h"

namespace sightline::cli {

struct ViewFlags {
  std::optional<Vec3d> eye, at, up;
  std::optional<double> fov_y_degrees;
};

struct ViewChoice {
  Vec3d eye, at, up;
  double fov_y_degrees = 50;
  std::vector<Vec3d> lights;  // Three, by rule or of the built-in scene.
  std::string how;            // "given", "built-in", "outside" or "inside".
};

// z or y, as said above. `format` as ImportReport has it; may be empty.
Vec3d GuessUp(const Box3d& bounds, const std::string& format);

// `flag` if it was given, a built-in scene's own, else by the rule above. A flag is scaled by a
// power of two, so that its largest component is from 1 to 2. A usage error of one without a
// direction.
absl::StatusOr<Vec3d> SceneUp(const OpenedScene& scene, const std::optional<Vec3d>& flag);

// The nearest eye along `toward_eye` from which the whole box is within the field of view, with a
// margin.
Vec3d FitBox(const Box3d& bounds, Vec3d toward_eye, Vec3d up, double fov_y_degrees, double aspect);

// `aspect`: width / height. INVALID_ARGUMENT for a scene without anything to see; errors of SceneUp
// and of queries.
absl::StatusOr<ViewChoice> ChooseView(const Session& session, const OpenedScene& scene,
                                      const std::string& name, const ViewFlags& flags,
                                      double aspect);

// The lights that the flags name, else the first `chosen` of the view's. Usage errors of the flags.
absl::StatusOr<std::vector<client::Light>> LightsOf(const LightFlags& flags, const ViewChoice& view,
                                                    uint64_t chosen);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_VIEW_CHOICE_H_
