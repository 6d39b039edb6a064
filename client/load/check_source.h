// SPDX-License-Identifier: Apache-2.0
//
// What the answers of a run are compared with.
//
//   engine   the engine in this process, on the triangles of --check-scene; without that, on those
//            of --scene, or of the built-in scene that the server says its scene is
//   server   where nobody here has the triangles: the server's own answers by another strategy,
//            asked for before the clock starts (server_answers.h). Weaker: it finds answers that
//            strategies, batches or load make wrong, and none that are wrong each time
//
// Either is found before the run or the run does not begin: a check is never left out in silence.
//
// Thread safety: free functions.
//
//   SL_ASSIGN_OR_RETURN(CheckSource source, ChooseCheck(options, scene));
//   if (source.by == CheckSource::By::kEngine) {
//     SL_ASSIGN_OR_RETURN(auto triangles, OpenCheckScene(source.what, scene, pool));
//   }
#ifndef SIGHTLINE_CLIENT_LOAD_CHECK_SOURCE_H_
#define SIGHTLINE_CLIENT_LOAD_CHECK_SOURCE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "client/lib/types.h"
#include "client/load/options.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/scene/scene.h"

namespace sightline::load {

struct CheckSource {
  enum class By { kNothing, kEngine, kServer };
  By by = By::kNothing;
  std::string what;  // By::kEngine: SCENE of --help, of no server.
};

// `scene`: as the server describes it. A usage error, with the remedy, where the options want a
// check that cannot be made.
absl::StatusOr<CheckSource> ChooseCheck(const LoadOptions& options, const client::Scene& scene);

// The scene for the engine, relative to the origin of `served`: a native scene file is loaded,
// anything else read or made and built. InvalidArgument where it cannot be what `served` is made
// of: other numbers of objects, triangles or vertices, or another origin in the file. Cancelled
// from `cancel`.
absl::StatusOr<std::shared_ptr<const Scene>> OpenCheckScene(const std::string& argument,
                                                            const client::Scene& served,
                                                            ThreadPool& pool,
                                                            const CancelToken* cancel = nullptr);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_CHECK_SOURCE_H_
