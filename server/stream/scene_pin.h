// SPDX-License-Identifier: Apache-2.0
//
// Which revision each item of a stream sees: the current one at its start, or an exact one that is
// kept in memory for a while.
//
// Invariants: an exact revision is let go when its time is up, whether items come or not; it is
// never that of another scene, which has come to its name and number since.
//
// Thread safety: every method from any thread.
//
//   SL_ASSIGN_OR_RETURN(std::unique_ptr<ScenePin> pin, ScenePin::Open(header.stream(), env));
//   SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, pin->ForItem());
#ifndef SIGHTLINE_SERVER_STREAM_SCENE_PIN_H_
#define SIGHTLINE_SERVER_STREAM_SCENE_PIN_H_

#include <grpcpp/alarm.h>

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "core/scene/scene.h"
#include "server/stream/query_environment.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

class ScenePin {
 public:
  static absl::StatusOr<std::unique_ptr<ScenePin>> Open(const v1::StreamHeader& header,
                                                        const QueryEnvironment& env);

  absl::StatusOr<std::shared_ptr<const Scene>> ForItem() const;
  const std::string& scene_id() const { return scene_id_; }
  // The current revision when the stream was opened.
  const std::shared_ptr<const Scene>& opened() const { return opened_; }
  // Lets go of `opened`, once the stream has looked at it.
  void ReleaseOpened() { opened_.reset(); }

 private:
  // Outlives the pin if the alarm is just going off.
  struct Held {
    Mutex mutex;
    std::shared_ptr<const Scene> scene ABSL_GUARDED_BY(mutex);
  };

  ScenePin(SceneCatalog& scenes, std::string scene_id, uint64_t revision)
      : scenes_(scenes), scene_id_(std::move(scene_id)), revision_(revision) {}

  SceneCatalog& scenes_;
  const std::string scene_id_;
  const uint64_t revision_;  // 0: the current one.
  uint64_t tag_ = 0;         // Of the scene that was opened; see SceneCatalog::PinOf.
  std::shared_ptr<const Scene> opened_;
  const std::shared_ptr<Held> held_ = std::make_shared<Held>();
  grpc::Alarm expiry_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_SCENE_PIN_H_
