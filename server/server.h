// SPDX-License-Identifier: Apache-2.0
//
// A whole Sightline server in one object: sightlined runs one, the command line embeds one, tests
// start as many as they like.
//
// Life: Start, then any number of calls, then Drain (optional), then Shutdown or destruction.
// Threads and scenes live as long as the object.
//
// Thread safety: every method from any thread but gRPC's own and the pools'. Drain and Shutdown may
// be called at once; each returns when its part is done.
//
//   absl::StatusOr<std::unique_ptr<Server>> server = Server::Start({.listen = {"127.0.0.1:0"}});
//   auto channel = grpc::CreateChannel(absl::StrCat("127.0.0.1:", (*server)->port()), ...);
//   ...
//   (*server)->Drain(absl::Seconds(30));
#ifndef SIGHTLINE_SERVER_SERVER_H_
#define SIGHTLINE_SERVER_SERVER_H_

#include <grpcpp/channel.h>
#include <grpcpp/server.h>
#include <grpcpp/support/channel_arguments.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "server/admission/call_quota.h"
#include "server/admission/call_tracker.h"
#include "server/admission/idle_clock.h"
#include "server/admission/ray_queue.h"
#include "server/admission/scheduler.h"
#include "server/admission/upload_slots.h"
#include "server/auth/access_control.h"
#include "server/base/periodic_task.h"
#include "server/metrics/http_endpoint.h"
#include "server/metrics/metrics.h"
#include "server/metrics/slow_query_log.h"
#include "server/net/front_door.h"
#include "server/options.h"
#include "server/points/point_set_store.h"
#include "server/scenes/health_names.h"
#include "server/scenes/scene_catalog.h"
#include "server/services/capability_service.h"
#include "server/services/point_set_service.h"
#include "server/services/scene_service.h"
#include "server/services/visibility_service.h"
#include "server/stream/query_environment.h"

namespace sightline {

class Server {
 public:
  // Loads the repository and makes the scenes of the options, binds, and serves. A stored scene
  // that cannot be loaded keeps nothing from being served, and one with the name of an option's
  // stays in its place. InvalidArgument (options), Unavailable (the address cannot be bound), and
  // what opening the repository or making a scene returns.
  static absl::StatusOr<std::unique_ptr<Server>> Start(const ServerOptions& options);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  // The bound port; 0 without a socket.
  int port() const { return door_ == nullptr ? 0 : door_->port(); }
  // That of probes and metrics; 0 without.
  int metrics_port() const { return http_ == nullptr ? 0 : http_->port(); }
  // A channel that needs no socket. It must be gone before the server is.
  std::shared_ptr<grpc::Channel> InProcessChannel(const grpc::ChannelArguments& arguments);

  // Reads certificates and the access file again, as happens every reload_interval. What was wrong
  // with the first of them that was, in which case the last good one stays; the log names each.
  absl::Status ReloadSecurity();

  // Health goes to NOT_SERVING and /readyz to 503 at once; everything else goes on for the option
  // drain_delay. Then new calls are refused, streams are told, and what is under way may finish,
  // for `timeout`. Then shuts down. DeadlineExceeded if calls had to be cut off after `timeout`.
  absl::Status Drain(absl::Duration timeout);
  // Cuts everything off, and returns when it has ended.
  void Shutdown();

  // Ends the uploads that have waited for their clients for too long by `now`. The server does so
  // itself, every few seconds.
  void EndIdleUploads(IdleClock::Time now) { upload_slots_.Sweep(now); }

  // The same for the visibility streams whose clients take nothing.
  void EndStalledStreams(std::chrono::steady_clock::time_point now) { calls_.Sweep(now); }

  SceneCatalog& scenes() { return scenes_; }
  size_t active_calls() const { return calls_.active_calls(); }
  uint64_t queued_rays() const { return ray_queue_.queued_rays(); }

 private:
  Server(const ServerOptions& options, std::unique_ptr<SceneRepository> repository);

  absl::Status MakeScenes();
  absl::Status ServeHttp();
  absl::Status Listen();
  ServerState StateNow();
  HttpReply MetricsPage(const HttpRequest& request);
  HttpReply Livez();
  HttpReply Readyz() const;
  void ReportHealth(const SceneView& view) ABSL_LOCKS_EXCLUDED(health_mutex_);
  void ReportStoredHealth() ABSL_LOCKS_EXCLUDED(health_mutex_);
  void SetHealth(const std::string& scene_id) ABSL_LOCKS_EXCLUDED(health_mutex_);
  void Leave();
  void ShutdownWithin(absl::Duration timeout);

  const ServerOptions options_;
  AccessControl access_;
  CallTracker calls_;
  RayQueue ray_queue_;
  UploadSlots upload_slots_;
  CallQuota streams_, uploads_, upload_bytes_{"upload-bytes"};
  CallQuota scenes_made_{"scenes", CallQuota::Shares::kLast};
  ThreadPool query_pool_, build_pool_, call_pool_;
  Scheduler scheduler_;
  const std::unique_ptr<SceneRepository> repository_;  // Null without one.
  SceneCatalog scenes_;
  HealthNames health_names_;
  Mutex health_mutex_;  // One scene's health is looked at and told at a time.
  PointSetStore point_sets_;
  Metrics metrics_;
  const SlowQueryLog slow_queries_;
  const QueryEnvironment env_;
  SceneService scene_service_;
  PointSetService point_set_service_;
  VisibilityService visibility_service_;
  CapabilityService capability_service_;
  std::unique_ptr<FrontDoor> door_;  // Outlives the gRPC server.
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<PeriodicTask> sweeper_, reloader_;
  std::atomic<bool> listening_ = false;  // From the bound port on, for good: what door_ counted.
  std::atomic<bool> serving_ = false;    // From the bound port until new calls are refused.
  std::atomic<bool> leaving_ = false;    // From the beginning of a drain.
  std::atomic<uint64_t> reloads_ = 0, failed_reloads_ = 0;
  std::unique_ptr<HttpEndpoint> http_;
  Mutex shutdown_mutex_;
  bool shut_down_ ABSL_GUARDED_BY(shutdown_mutex_) = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVER_H_
