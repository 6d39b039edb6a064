// SPDX-License-Identifier: Apache-2.0
#include "server/server.h"

#include <grpc/compression.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/server_builder.h>

#include <algorithm>
#include <chrono>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/log.h"
#include "server/base/resource_name.h"
#include "server/codec/wire_request.h"
#include "server/net/socket_address.h"

namespace sightline {
namespace {

// Names that the health service may come to know, for each scene that there may be at once: enough
// for a few generations of names, and about a hundred bytes each.
constexpr size_t kHealthNamesPerScene = 4;
// Of those for scenes that are stored and not loaded at the start: the others are left for scenes
// that are made.
constexpr size_t kStoredNamesPerScene = 2;
constexpr absl::Duration kSweepPeriod = absl::Seconds(5);
// Uploads and streams are looked at so often within what they may wait: none waits much longer.
constexpr int kLooksWithinWait = 4;
// Below what a prober waits (a second in Kubernetes, unless told otherwise, so tell it).
constexpr absl::Duration kLivenessTimeout = absl::Seconds(2);
// A client that pings more often than this is told to go away; one that is gone is noticed within a
// minute.
constexpr int kLeastPingIntervalMs = 10'000;
constexpr int kKeepaliveTimeMs = 40'000;
constexpr int kKeepaliveTimeoutMs = 20'000;
// Until a connection has said that it speaks HTTP/2 (and TLS, if it must); gRPC itself would give
// it a slot for two minutes.
constexpr int kHandshakeTimeoutMs = 10'000;
// Once no call is left: for what was refused meanwhile to be told so. Clients that are there close
// their connections well before; those that watch their health or have gone away do not.
constexpr absl::Duration kLastRepliesTimeout = absl::Seconds(1);
// HTTP/2's own bound on what headers may take; ours carry nothing large.
constexpr int kMaxMetadataBytes = 16 << 10;

// Short tasks all: two, so that one that frees a large scene holds up no other.
constexpr int kCallThreads = 2;

// Queries have a thread for every core, so whatever builds take they take from queries: half the
// cores leave them two thirds of what they have without a build (server/DESIGN.md).
int BuildThreads(const ServerOptions& options) {
  if (options.build_threads > 0) return options.build_threads;
  return std::max(1, ThreadPool(0).threads() / 2);
}

}  // namespace

Server::Server(const ServerOptions& options, std::unique_ptr<SceneRepository> repository)
    : options_(options),
      ray_queue_(options.limits.max_queued_rays, options.limits.max_queued_rays_per_client),
      upload_slots_(options.limits.max_concurrent_uploads),
      streams_("streams", CallQuota::Shares::kPass,
               {"max_streams_per_client", options.limits.max_streams_per_client}),
      uploads_(
          "uploads", CallQuota::Shares::kPass,
          {"max_concurrent_uploads_per_client", options.limits.max_concurrent_uploads_per_client}),
      query_pool_(options.threads),
      build_pool_(BuildThreads(options)),
      call_pool_(kCallThreads),
      scheduler_(query_pool_.threads(),
                 [this](absl::AnyInvocable<void()> work) { query_pool_.Submit(std::move(work)); }),
      repository_(std::move(repository)),
      scenes_(options_.limits, build_pool_, repository_.get(), options.evict_least_used),
      health_names_(kHealthNamesPerScene * options.limits.max_scenes),
      point_sets_(options_.limits, [] { return absl::Now(); }),
      metrics_([this] { return StateNow(); }),
      slow_queries_(options.slow_query_log),
      env_{options_.limits, scenes_,    point_sets_, query_pool_,   build_pool_, call_pool_,
           ray_queue_,      scheduler_, calls_,      streams_,      uploads_,    upload_bytes_,
           scenes_made_,    &access_,   &metrics_,   &slow_queries_},
      scene_service_(env_, upload_slots_),
      point_set_service_(env_, upload_slots_),
      visibility_service_(env_),
      capability_service_(env_, DescribeServer(options_.limits, query_pool_.threads())) {}

absl::StatusOr<std::unique_ptr<Server>> Server::Start(const ServerOptions& options) {
  SL_RETURN_IF_ERROR(CheckOptions(options));
  std::unique_ptr<SceneRepository> repository;
  if (!options.repository.empty()) {
    SL_ASSIGN_OR_RETURN(
        repository, SceneRepository::Open(options.repository, *options.files, options.scene_files));
  }
  std::unique_ptr<Server> server(new Server(options, std::move(repository)));
  if (!options.access_file.empty()) {
    SL_RETURN_IF_ERROR(server->access_.Load(options.access_file));
  }
  // First of all, so that whoever starts the server sees it start.
  SL_RETURN_IF_ERROR(server->ServeHttp());
  SL_RETURN_IF_ERROR(server->MakeScenes());
  SL_RETURN_IF_ERROR(server->Listen());
  server->listening_ = true;
  server->serving_ = true;
  const absl::Duration wait = absl::Seconds(
      std::min(options.limits.max_upload_idle_seconds, options.limits.max_stream_stall_seconds));
  server->sweeper_ = std::make_unique<PeriodicTask>(
      std::min(kSweepPeriod, wait / kLooksWithinWait), [self = server.get()] {
        self->point_sets_.Sweep();
        self->EndIdleUploads(IdleClock::Now());
        self->EndStalledStreams(std::chrono::steady_clock::now());
      });
  if (!options.tls.certificate.empty() || !options.access_file.empty()) {
    server->reloader_ = std::make_unique<PeriodicTask>(
        options.reload_interval, [self = server.get()] { (void)self->ReloadSecurity(); });
  }
  return server;
}

Server::~Server() {
  Shutdown();
  http_.reset();
  scenes_.SetListener(nullptr);
  FlushLog();  // Whoever embeds a server may end soon.
}

absl::Status Server::MakeScenes() {
  if (repository_ != nullptr && options_.load_repository) {
    SL_RETURN_IF_ERROR(scenes_.LoadAll());
  }
  for (const std::string& option : options_.scenes) {
    SL_ASSIGN_OR_RETURN(const SceneOption scene, ParseSceneOption(option));
    const absl::StatusOr<SceneView> view = scenes_.CreateBuiltin(
        {.scene_id = scene.id, .temporary = true, .builtin = scene.spec}, nullptr);
    if (absl::IsAlreadyExists(view.status())) {
      // The names of the options differ, so the repository has it: somebody stored it since the
      // option was written, which should not keep a server from starting again.
      Log(LogLevel::kWarning, "scene_left_out",
          {{"option", absl::StrCat("--scene = ", option)},
           {"why", absl::StrCat(view.status().message(), "; the stored one stays")}});
      continue;
    }
    if (!view.ok()) {
      return absl::Status(view.status().code(),
                          absl::StrCat("--scene = \"", option, "\": ", view.status().message()));
    }
    Log(LogLevel::kInfo, "scene_created",
        {{"scene", scene.id},
         {"triangles", absl::StrCat(view->status.latest->geometry.triangles.size())}});
  }
  return absl::OkStatus();
}

absl::Status Server::ServeHttp() {
  if (options_.metrics_listen.empty()) return absl::OkStatus();
  HttpEndpoint::Handlers handlers = {
      {"/metrics", [this](const HttpRequest& request) { return MetricsPage(request); }},
      {"/livez", [this](const HttpRequest&) { return Livez(); }},
      {"/readyz", [this](const HttpRequest&) { return Readyz(); }},
  };
  SL_ASSIGN_OR_RETURN(const ListenAddress address, ParseListenAddress(options_.metrics_listen));
  SL_ASSIGN_OR_RETURN(http_, HttpEndpoint::Start(options_.metrics_listen, handlers));
  if (!address.IsLoopback()) {
    // This port has no TLS: with roles it is their tokens that whoever listens on the way gets.
    Log(LogLevel::kWarning,
        access_.active() ? "metrics_tokens_in_the_clear" : "metrics_without_roles",
        {{"address", options_.metrics_listen}});
  }
  return absl::OkStatus();
}

HttpReply Server::MetricsPage(const HttpRequest& request) {
  const absl::Status allowed =
      access_.CheckRoles("/metrics", kMetricsRole, {.authorizations = {request.authorization}});
  if (!allowed.ok()) {
    return {.code = absl::IsUnauthenticated(allowed) ? 401 : 403,
            .body = absl::StrCat(allowed.message(), "\n")};
  }
  return {.body = metrics_.Text(), .content_type = "text/plain; version=0.0.4; charset=utf-8"};
}

ServerState Server::StateNow() {
  ServerState state;
  for (const SceneView& view : scenes_.List("", options_.limits.max_scenes)) {
    ServerState::Scene& scene = state.scenes.emplace_back();
    scene.id = view.status.name;
    if (!view.status.keep_error.ok()) ++state.unstored_scenes;
    if (view.status.latest == nullptr) continue;
    scene.revision = view.status.latest->revision;
    scene.bytes = view.status.latest->report.memory_bytes;
    scene.triangles = view.status.latest->geometry.triangles.size();
  }
  state.failed_scene_stores = scenes_.failed_stores();
  state.scene_bytes = scenes_.MemoryBytes();
  state.max_scene_bytes = options_.limits.max_scene_bytes;
  state.point_set_bytes = point_sets_.memory_bytes();
  state.max_point_set_bytes = options_.limits.max_point_set_bytes;
  state.active_calls = calls_.active_calls();
  state.active_uploads = upload_slots_.taken();
  state.queued_rays = ray_queue_.queued_rays();
  state.max_queued_rays = options_.limits.max_queued_rays;
  const Scheduler::Load load = scheduler_.load();
  state.clients = load.clients;
  state.waiting_tasks = load.waiting_tasks;
  state.running_tasks = static_cast<uint64_t>(load.running_tasks);
  state.rays_per_second = load.rays_per_second;
  if (listening_) {
    const AcceptLoop::Counts connections = door_->counts();
    state.open_connections = connections.open;
    state.accepted_connections = connections.accepted;
    state.refused_connections = connections.refused;
    state.certificate_end = door_->CertificateEnd();
  }
  state.refused_calls = access_.refused();
  state.draining = leaving_;
  state.security_reloads = reloads_;
  state.failed_security_reloads = failed_reloads_;
  state.dropped_log_lines = DroppedLogLines();
  return state;
}

HttpReply Server::Livez() {
  // Before and after there is no port to try; the process itself is well.
  if (!serving_) return {.body = "not serving yet, or no longer\n"};
  const absl::Status alive = door_->CheckAlive(kLivenessTimeout);
  if (alive.ok()) return {.body = "alive\n"};
  Log(LogLevel::kError, "not_alive", {{"status", alive.ToString()}});
  return {.code = 503, .body = absl::StrCat("not alive: ", alive.ToString(), "\n")};
}

HttpReply Server::Readyz() const {
  if (leaving_) return {.code = 503, .body = "draining\n"};
  if (serving_) return {.body = "ready\n"};
  return {.code = 503, .body = "starting\n"};
}

absl::Status Server::Listen() {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  SL_ASSIGN_OR_RETURN(
      door_, FrontDoor::Open({.listen = options_.listen,
                              .unix_socket_mode = static_cast<mode_t>(options_.unix_socket_mode),
                              .connections = {options_.limits.max_connections,
                                              options_.limits.max_connections_per_address},
                              .tls = options_.tls,
                              .client_certificate_optional = options_.client_certificate_optional},
                             access_));
  door_->AddTo(&builder);
  builder.RegisterService(&scene_service_);
  builder.RegisterService(&point_set_service_);
  builder.RegisterService(&visibility_service_);
  builder.RegisterService(&capability_service_);
  const auto max_bytes = static_cast<int>(options_.limits.max_message_bytes);
  builder.SetMaxReceiveMessageSize(max_bytes);
  builder.SetMaxSendMessageSize(max_bytes);
  // What an array that stays in gRPC's slices may hold on to besides itself.
  builder.AddChannelArgument(GRPC_ARG_TCP_MAX_READ_CHUNK_SIZE, static_cast<int>(kMaxReadSlice));
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS,
                             static_cast<int>(options_.limits.max_concurrent_streams));
  // A compressed message is expanded whole before its length is checked: refuse compression.
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_GZIP, false);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_DEFLATE, false);
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, kMaxMetadataBytes);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS,
                             kLeastPingIntervalMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  if (options_.connection_idle_timeout < absl::InfiniteDuration()) {
    builder.AddChannelArgument(
        GRPC_ARG_MAX_CONNECTION_IDLE_MS,
        static_cast<int>(absl::ToInt64Milliseconds(options_.connection_idle_timeout)));
  }
  // gRPC orders all that was made so far before its first reaction. The thread sanitizer, for which
  // it is not built, sees that order by this lock, which every call takes first.
  (void)calls_.active_calls();
  server_ = builder.BuildAndStart();
  if (server_ == nullptr) return absl::InternalError("gRPC did not start");
  scenes_.SetListener([this](const SceneView& view) {
    if (view.deleted) point_sets_.RemoveScene(view.status.name, view.status.tag);
    ReportHealth(view);
  });
  for (const SceneView& view : scenes_.List("", options_.limits.max_scenes)) ReportHealth(view);
  if (repository_ != nullptr) ReportStoredHealth();
  door_->Start();
  return absl::OkStatus();
}

absl::Status Server::ReloadSecurity() {
  const absl::StatusOr<bool> certificates = door_->ReloadCertificates();
  if (certificates.ok() && *certificates) {
    Log(LogLevel::kInfo, "certificate_reloaded",
        {{"until",
          absl::FormatTime(absl::RFC3339_sec, door_->CertificateEnd(), absl::UTCTimeZone())}});
  }
  absl::Status status = certificates.status();
  const absl::Status access = access_.Reload();
  // Each is said: a status keeps only the first.
  for (const absl::Status& failed : {status, access}) {
    if (failed.ok()) continue;
    Log(LogLevel::kError, "reload_failed",
        {{"status", failed.ToString()}, {"kept", "the last good one"}});
  }
  status.Update(access);
  ++(status.ok() ? reloads_ : failed_reloads_);
  return status;
}

void Server::ReportHealth(const SceneView& view) {
  const std::string& name = view.status.name;
  // A deleted scene stays known as NOT_SERVING: the health service cannot forget a name.
  bool known = health_names_.Take(view);
  if (!known && view.status.state == SceneState::kFailed && repository_ != nullptr) {
    // A load that failed, of a file that came after the start, or of one that cannot even be looked
    // at; or else nothing was ever there.
    known = repository_->Has(name).value_or(true) && health_names_.TakeStored(name);
  }
  if (known) SetHealth(name);
}

// Those that were not loaded, or could not be, are as much as those that fail later.
void Server::ReportStoredHealth() {
  const absl::StatusOr<std::vector<StoredScene>> stored =
      scenes_.ListStored("", kStoredNamesPerScene * options_.limits.max_scenes);
  if (!stored.ok()) {
    Log(LogLevel::kWarning, "stored_scenes_without_health",
        {{"status", stored.status().ToString()}});
    return;
  }
  for (const StoredScene& scene : *stored) {
    if (health_names_.TakeStored(scene.file.scene_id)) SetHealth(scene.file.scene_id);
  }
}

void Server::SetHealth(const std::string& scene_id) {
  // As it is now: of changes that several threads tell of at once, the last to be heard need not be
  // the latest.
  MutexLock lock(health_mutex_);
  const absl::StatusOr<SceneView> now = scenes_.Get(scene_id);
  const bool serving = now.ok() && now->status.latest != nullptr && !calls_.draining();
  server_->GetHealthCheckService()->SetServingStatus(SceneName(scene_id), serving);
}

std::shared_ptr<grpc::Channel> Server::InProcessChannel(const grpc::ChannelArguments& arguments) {
  return server_->InProcessChannel(arguments);
}

void Server::Leave() {
  leaving_ = true;
  // For good: what becomes of scenes from now on changes no health.
  server_->GetHealthCheckService()->Shutdown();
}

absl::Status Server::Drain(absl::Duration timeout) {
  Leave();
  if (options_.drain_delay > absl::ZeroDuration()) {
    Log(LogLevel::kInfo, "leaving", {{"delay", absl::FormatDuration(options_.drain_delay)}});
    // Shutdown ends this, too.
    calls_.WaitUntilDraining(std::chrono::steady_clock::now() +
                             absl::ToChronoNanoseconds(options_.drain_delay));
  }
  serving_ = false;
  const absl::Time deadline = absl::Now() + timeout;
  calls_.StartDrain();
  Log(LogLevel::kInfo, "draining", {{"calls", absl::StrCat(calls_.active_calls())}});
  const bool idle =
      calls_.WaitUntilIdle(std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(timeout));
  const size_t cut_off = calls_.active_calls();
  ShutdownWithin(std::min(kLastRepliesTimeout, deadline - absl::Now()));
  if (idle) return absl::OkStatus();
  return absl::DeadlineExceededError(
      absl::StrCat(cut_off, " calls were cut off after ", absl::FormatDuration(timeout)));
}

void Server::Shutdown() { ShutdownWithin(absl::ZeroDuration()); }

void Server::ShutdownWithin(absl::Duration timeout) {
  MutexLock lock(shutdown_mutex_);
  // None of their tasks takes the lock.
  sweeper_.reset();
  reloader_.reset();
  if (server_ == nullptr) return;
  if (shut_down_) return;
  leaving_ = true;
  serving_ = false;
  calls_.StartDrain();
  door_->Stop();
  // Calls whose time is over; where it is not, none is left that stores anything.
  scenes_.StopStoring();
  // Without a deadline a stalled call could hold this up for ever.
  server_->Shutdown(absl::ToChronoTime(absl::Now() + std::max(timeout, absl::ZeroDuration())));
  server_->Wait();
  calls_.WaitUntilIdle(std::chrono::steady_clock::time_point::max());
  shut_down_ = true;
}

}  // namespace sightline
