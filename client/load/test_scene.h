// SPDX-License-Identifier: Apache-2.0
//
// The scene of a load test and the places it is asked about: a path of cameras, lights, and points
// on the surfaces that the cameras see, as the server itself finds them.
//
// Thread safety: one thread.
//
//   SL_ASSIGN_OR_RETURN(auto scene, OpenTestScene(*session, options, err));
#ifndef SIGHTLINE_CLIENT_LOAD_TEST_SCENE_H_
#define SIGHTLINE_CLIENT_LOAD_TEST_SCENE_H_

#include <memory>
#include <ostream>
#include <vector>

#include "absl/status/statusor.h"
#include "client/cli/scene_argument.h"
#include "client/cli/session.h"
#include "client/lib/types.h"
#include "client/load/options.h"
#include "core/mesh/object.h"

namespace sightline::load {

struct TestScene {
  std::unique_ptr<cli::OpenedScene> opened;
  std::vector<client::Camera> cameras;
  std::vector<client::Light> lights;
  std::vector<double> surface;  // [n, 3], world coordinates.
  // A small box in the middle of the view, for edits; not part of the scene.
  ObjectInput extra;
};

absl::StatusOr<TestScene> OpenTestScene(const cli::Session& session, const LoadOptions& options,
                                        std::ostream& err);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_TEST_SCENE_H_
