// SPDX-License-Identifier: Apache-2.0
//
// The reactor behind WatchScene: sends a scene's state at once and after every change.
//
// Invariants: at most one change waits while another is written, a newer one takes its place; what
// is told late of a scene that had the name before is not passed on; the stream ends with OK after
// the deletion was sent, with UNAVAILABLE when the server drains, with DEADLINE_EXCEEDED where its
// client takes nothing for max_stream_stall.
//
// Thread safety: as visibility_stream.h.
#ifndef SIGHTLINE_SERVER_SERVICES_SCENE_WATCH_H_
#define SIGHTLINE_SERVER_SERVICES_SCENE_WATCH_H_

#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "core/base/hand_over.h"
#include "core/base/mutex.h"
#include "server/admission/call_deadline.h"
#include "server/admission/call_quota.h"
#include "server/admission/client_name.h"
#include "server/metrics/metrics.h"
#include "server/scenes/scene_catalog.h"
#include "server/stream/query_environment.h"
#include "sightline/v1/scene_service.pb.h"

namespace sightline {

class SceneWatch final : public grpc::ServerWriteReactor<v1::WatchSceneResponse>,
                         public SceneWatcher,
                         public DrainListener,
                         public std::enable_shared_from_this<SceneWatch> {
 public:
  static SceneWatch* Start(grpc::CallbackServerContext* context,
                           const v1::WatchSceneRequest& request, const QueryEnvironment& env);

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  void OnScene(const SceneView& view) override;
  void OnDrain() override;
  void EndIfStalled(std::chrono::steady_clock::time_point now) override;

 private:
  SceneWatch(grpc::CallbackServerContext* context, const QueryEnvironment& env)
      : context_(context),
        deadline_(*context),
        env_(env),
        timer_(env.metrics, Operation::kWatchScene) {}

  void Begin(const Client& client, const v1::WatchSceneRequest& request);
  absl::Status Enter(const Client& client);
  void Push(const SceneView& view) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EndWith(absl::Status status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Advance() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  grpc::CallbackServerContext* const context_;
  const CallDeadline deadline_;
  const QueryEnvironment env_;
  const CallTimer timer_;
  HandOver begun_;  // gRPC knows the call before it says that it was cancelled.
  Mutex mutex_;
  std::shared_ptr<SceneWatch> self_ ABSL_GUARDED_BY(mutex_);
  ActiveCall call_ ABSL_GUARDED_BY(mutex_);
  CallShare share_ ABSL_GUARDED_BY(mutex_);
  std::string scene_id_ ABSL_GUARDED_BY(mutex_);
  uint64_t creation_ ABSL_GUARDED_BY(mutex_) = 0;  // Of the scene that was told of last.
  std::optional<v1::WatchSceneResponse> next_ ABSL_GUARDED_BY(mutex_);
  v1::WatchSceneResponse writing_response_;  // gRPC's while `writing_`.
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  std::chrono::steady_clock::time_point write_start_ ABSL_GUARDED_BY(mutex_);  // Of the last one.
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);  // What to finish with after `next_`.
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_SCENE_WATCH_H_
