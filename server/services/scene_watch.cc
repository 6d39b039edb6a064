// SPDX-License-Identifier: Apache-2.0
#include "server/services/scene_watch.h"

#include <utility>

#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/scene_codec.h"
#include "server/stream/stream_method.h"

namespace sightline {

SceneWatch* SceneWatch::Start(grpc::CallbackServerContext* context,
                              const v1::WatchSceneRequest& request, const QueryEnvironment& env) {
  auto watch = std::shared_ptr<SceneWatch>(new SceneWatch(context, env));
  watch->Begin(ClientOf(*context, env.access), request);
  watch->begun_.Release();
  return watch.get();
}

void SceneWatch::Begin(const Client& client, const v1::WatchSceneRequest& request) {
  absl::StatusOr<std::string> scene_id = ParseSceneName("name", request.name());
  const absl::Status admitted = Enter(client);
  // Before the first look, so that no change falls in between.
  if (admitted.ok() && scene_id.ok()) env_.scenes.AddWatcher(*scene_id, weak_from_this());
  absl::StatusOr<SceneView> view = scene_id.ok() ? env_.scenes.Get(*scene_id) : scene_id.status();
  MutexLock lock(mutex_);
  self_ = shared_from_this();
  if (!admitted.ok()) {
    EndWith(admitted);
  } else {
    if (scene_id.ok()) scene_id_ = *scene_id;
    // A change that came first is newer than the look.
    if (view.ok() && !next_.has_value() && !writing_) {
      Push(*view);
    } else if (!view.ok() && !(request.wait_for_scene() && absl::IsNotFound(view.status())) &&
               !next_.has_value() && !writing_) {
      EndWith(view.status());
    }
  }
  Advance();
}

absl::Status SceneWatch::Enter(const Client& client) {
  MutexLock lock(mutex_);
  SL_ASSIGN_OR_RETURN(call_, env_.calls.Admit(weak_from_this()));
  SL_ASSIGN_OR_RETURN(share_, env_.streams.Take(client.name, client.limits.streams));
  return absl::OkStatus();
}

void SceneWatch::OnScene(const SceneView& view) {
  MutexLock lock(mutex_);
  if (finished_ || end_.has_value() || view.status.creation < creation_) return;
  Push(view);
  if (view.deleted) EndWith(absl::OkStatus());
  Advance();
}

void SceneWatch::Push(const SceneView& view) {
  creation_ = view.status.creation;
  v1::WatchSceneResponse& response = next_.emplace();
  EncodeScene(view, response.mutable_scene());
  const bool building = !view.deleted && view.status.state == SceneState::kBuilding;
  if (building) response.set_stage("building");
  response.set_progress(building ? view.status.progress : 1.0);
}

void SceneWatch::EndWith(absl::Status status) {
  if (!end_.has_value()) end_ = std::move(status);
}

void SceneWatch::OnWriteDone(bool ok) {
  MutexLock lock(mutex_);
  writing_ = false;
  if (!ok) {
    next_.reset();
    EndWith(deadline_.Ends() ? CallExpiredError() : CallCancelledError());
  }
  Advance();
}

void SceneWatch::OnCancel() {
  begun_.Acquire();
  MutexLock lock(mutex_);
  next_.reset();
  EndWith(deadline_.Ends() ? CallExpiredError() : CallCancelledError());
  Advance();
}

void SceneWatch::OnDrain() {
  MutexLock lock(mutex_);
  EndWith(DrainingError());
  Advance();
}

// A client that does not take what it is told would hold up a drain for as long as that may take.
void SceneWatch::EndIfStalled(std::chrono::steady_clock::time_point now) {
  MutexLock lock(mutex_);
  const std::chrono::seconds most(env_.limits.max_stream_stall_seconds);
  if (finished_ || !writing_ || now - write_start_ < most) return;
  next_.reset();
  const absl::Status stalled = WatchStallError(env_.limits);
  EndWith(stalled);
  CutOff(context_, stalled);
}

void SceneWatch::OnDone() {
  std::string scene_id;
  {
    MutexLock lock(mutex_);
    scene_id = scene_id_;
  }
  env_.scenes.RemoveWatcher(scene_id, this);
  std::shared_ptr<SceneWatch> self;  // Goes after the lock has.
  MutexLock lock(mutex_);
  self.swap(self_);
  call_.Release();
}

void SceneWatch::Advance() {
  // Begin() has not come to its end: self_ is what keeps this alive.
  if (finished_ || writing_ || self_ == nullptr) return;
  if (next_.has_value()) {
    writing_response_ = *std::move(next_);
    next_.reset();
    writing_ = true;
    write_start_ = std::chrono::steady_clock::now();
    StartWrite(&writing_response_);
  } else if (end_.has_value()) {
    finished_ = true;
    timer_.Record(end_->code());
    share_.Release();  // Before the client hears of it, who may watch the next at once.
    Finish(ToGrpcStatus(*end_));
  }
}

}  // namespace sightline
