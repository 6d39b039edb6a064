// SPDX-License-Identifier: Apache-2.0
//
// Native scene files by their path, as the command line names them: links are followed, and stay
// links.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(SceneBytes file, OpenSceneFile("city.slscene"));
//   SL_RETURN_IF_ERROR(SaveSceneFile(*scene, "copy.slscene", pool));
#ifndef SIGHTLINE_CLIENT_CLI_NATIVE_SCENE_H_
#define SIGHTLINE_CLIENT_CLI_NATIVE_SCENE_H_

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/scene/scene_file.h"

namespace sightline::cli {

// By its ending, in either case.
bool IsSceneFileName(const std::string& path);

// Maps the file; nothing of it is checked.
absl::StatusOr<SceneBytes> OpenSceneFile(const std::string& path);

// Whether a file could be written there; makes none.
absl::Status CheckSceneFileWritable(const std::string& path);

// Whole or not at all; cancelled from `cancel`, and `progress` hears the share that is done (both
// may be null).
absl::Status SaveSceneFile(const Scene& scene, const std::string& path, ThreadPool& pool,
                           const CancelToken* cancel = nullptr,
                           const std::function<void(double)>& progress = nullptr);

}  // namespace sightline::cli

#endif  // SIGHTLINE_CLIENT_CLI_NATIVE_SCENE_H_
