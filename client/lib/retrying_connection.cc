// SPDX-License-Identifier: Apache-2.0
//
// Repeats what may be repeated. Reads change nothing; creations and edits carry a request_id, and
// their uploads can be played again; a deletion that finds nothing on a later attempt was done by
// an earlier one. A later attempt that finds the scene busy waits: what keeps it busy may be an
// earlier attempt, which the server has not heard of the end of. A watch begins anew where it was
// cut off, and each change that it sees counts as a success; a scene that it saw, and that is not
// there when it comes back, was deleted.
#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "client/lib/backoff.h"
#include "client/lib/connection.h"
#include "client/lib/status.h"

namespace sightline::client {
namespace {

const absl::Status& StatusOf(const absl::Status& status) { return status; }
template <typename T>
const absl::Status& StatusOf(const absl::StatusOr<T>& result) {
  return result.status();
}

// False when the wait was cut short by a cancellation.
bool Wait(absl::Duration duration, Cancellation* cancellation) {
  absl::Notification cancelled;
  Cancellation::Registration registration(cancellation, [&] { cancelled.Notify(); });
  return !cancelled.WaitForNotificationWithTimeout(duration);
}

class RetryingConnection final : public Connection {
 public:
  RetryingConnection(std::shared_ptr<Connection> inner, const RetryOptions& options)
      : inner_(std::move(inner)), options_(options) {}

  absl::StatusOr<v1::Scene> CreateScene(const Upload<v1::CreateSceneRequest>& upload,
                                        const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->CreateScene(upload, options); });
  }
  absl::StatusOr<v1::Scene> UpdateScene(const Upload<v1::UpdateSceneRequest>& upload,
                                        const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->UpdateScene(upload, options); });
  }
  absl::StatusOr<v1::Scene> GetScene(const v1::GetSceneRequest& request,
                                     const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->GetScene(request, options); });
  }
  absl::StatusOr<v1::ListScenesResponse> ListScenes(const v1::ListScenesRequest& request,
                                                    const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->ListScenes(request, options); });
  }
  absl::StatusOr<v1::ListSceneObjectsResponse> ListSceneObjects(
      const v1::ListSceneObjectsRequest& request, const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->ListSceneObjects(request, options); });
  }
  absl::Status DeleteScene(const v1::DeleteSceneRequest& request,
                           const CallOptions& options) override {
    return Retry(options, [&](int attempt) {
      return GoneIsDone(attempt, inner_->DeleteScene(request, options));
    });
  }
  absl::Status WatchScene(const v1::WatchSceneRequest& request,
                          const std::function<bool(const v1::WatchSceneResponse&)>& on_change,
                          const CallOptions& options) override {
    v1::WatchSceneRequest asked = request;
    bool seen = false, progress = false;
    const auto watch = [&](int) -> absl::Status {
      // What was there once and is not is deleted; it would be waited for without end.
      if (seen) asked.set_wait_for_scene(false);
      const absl::Status status = inner_->WatchScene(
          asked,
          [&](const v1::WatchSceneResponse& response) {
            seen = progress = true;
            return on_change(response);
          },
          options);
      return seen && absl::IsNotFound(status) ? absl::OkStatus() : status;
    };
    return Retry(options, watch, &progress);
  }
  absl::StatusOr<v1::Scene> LoadScene(const v1::LoadSceneRequest& request,
                                      const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->LoadScene(request, options); });
  }
  // Once more than asked for makes one more revision of the same file.
  absl::StatusOr<v1::Scene> ReloadScene(const v1::ReloadSceneRequest& request,
                                        const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->ReloadScene(request, options); });
  }
  absl::Status UnloadScene(const v1::UnloadSceneRequest& request,
                           const CallOptions& options) override {
    return Retry(options, [&](int attempt) {
      const absl::Status status = inner_->UnloadScene(request, options);
      const std::optional<ErrorDetail> detail = GetErrorDetail(status);
      const bool unloaded = attempt > 0 && detail && detail->reason == "SCENE_NOT_READY";
      return unloaded ? absl::OkStatus() : status;
    });
  }
  absl::StatusOr<v1::ListStoredScenesResponse> ListStoredScenes(
      const v1::ListStoredScenesRequest& request, const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->ListStoredScenes(request, options); });
  }
  absl::StatusOr<v1::PointSet> CreatePointSet(const Upload<v1::CreatePointSetRequest>& upload,
                                              const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->CreatePointSet(upload, options); });
  }
  absl::StatusOr<v1::PointSet> GetPointSet(const v1::GetPointSetRequest& request,
                                           const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->GetPointSet(request, options); });
  }
  absl::StatusOr<v1::ListPointSetsResponse> ListPointSets(const v1::ListPointSetsRequest& request,
                                                          const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->ListPointSets(request, options); });
  }
  absl::Status DeletePointSet(const v1::DeletePointSetRequest& request,
                              const CallOptions& options) override {
    return Retry(options, [&](int attempt) {
      return GoneIsDone(attempt, inner_->DeletePointSet(request, options));
    });
  }
  absl::StatusOr<v1::PointSet> RenewLease(const v1::RenewLeaseRequest& request,
                                          const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->RenewLease(request, options); });
  }
  absl::StatusOr<v1::Capabilities> GetCapabilities(const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->GetCapabilities(options); });
  }
  absl::StatusOr<Health> CheckHealth(const std::string& service,
                                     const CallOptions& options) override {
    return Retry(options, [&](int) { return inner_->CheckHealth(service, options); });
  }

  int channel_count() const override { return inner_->channel_count(); }
  std::unique_ptr<TileStream> OpenTiles(int channel, const CallOptions& options) override {
    return inner_->OpenTiles(channel, options);
  }
  std::unique_ptr<ShadowStream> OpenShadows(int channel, const CallOptions& options) override {
    return inner_->OpenShadows(channel, options);
  }
  std::unique_ptr<SegmentStream> OpenSegments(int channel, const CallOptions& options) override {
    return inner_->OpenSegments(channel, options);
  }

 private:
  static absl::Status GoneIsDone(int attempt, const absl::Status& status) {
    return attempt > 0 && absl::IsNotFound(status) ? absl::OkStatus() : status;
  }

  static bool IsSceneBusy(const absl::Status& status) {
    const std::optional<ErrorDetail> detail = GetErrorDetail(status);
    return detail && detail->reason == "SCENE_BUSY";
  }

  // `progress`, if any, is set by a call that gets somewhere before it fails.
  template <typename Function>
  auto Retry(const CallOptions& options, const Function& call, bool* progress = nullptr)
      -> decltype(call(0)) {
    Backoff backoff(options_);
    absl::Time give_up = absl::InfiniteFuture();
    for (int attempt = 0;; ++attempt) {
      auto result = call(attempt);
      const absl::Status& status = StatusOf(result);
      if (!IsRetryable(status) && !(attempt > 0 && IsSceneBusy(status))) return result;
      const absl::Time now = absl::Now();
      if (progress != nullptr && std::exchange(*progress, false)) {
        give_up = absl::InfiniteFuture();
        backoff.Reset();
      }
      give_up = std::min(give_up, now + options_.give_up_after);
      const absl::Duration wait = backoff.Next(status);
      if (now + wait >= std::min(give_up, options.deadline)) return result;
      if (!Wait(wait, options.cancellation)) return absl::CancelledError("cancelled by the caller");
    }
  }

  const std::shared_ptr<Connection> inner_;
  const RetryOptions options_;
};

}  // namespace

std::shared_ptr<Connection> MakeRetryingConnection(std::shared_ptr<Connection> inner,
                                                   const RetryOptions& options) {
  return std::make_shared<RetryingConnection>(std::move(inner), options);
}

}  // namespace sightline::client
