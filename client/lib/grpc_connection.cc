// SPDX-License-Identifier: Apache-2.0
//
// Connection over gRPC: the synchronous API, one call in the caller's thread, nothing repeated.
#include <google/protobuf/unknown_field_set.h>
#include <grpc/impl/codegen/grpc_types.h>
#include <grpcpp/client_context.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/proto_buffer_reader.h>
#include <grpcpp/support/sync_stream.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/lib/connection.h"
#include "client/lib/status.h"
#include "sightline/v1/capability_service.grpc.pb.h"
#include "sightline/v1/point_set_service.grpc.pb.h"
#include "sightline/v1/scene_service.grpc.pb.h"
#include "sightline/v1/visibility_service.grpc.pb.h"

namespace sightline::client {
namespace {

// Replies stay near Limits.target_reply_bytes; this only bounds what a broken server can make us
// hold.
constexpr int kMaxReceiveBytes = 256 << 20;
// While calls are under way. A server of ours sends away who pings more often than every 10 s
// (kLeastPingIntervalMs), and is asked as often as it asks by itself.
constexpr int kKeepaliveTimeMs = 30'000;
constexpr int kKeepaliveTimeoutMs = 20'000;

void Prepare(const CallOptions& options, grpc::ClientContext* context) {
  if (options.deadline != absl::InfiniteFuture()) {
    context->set_deadline(absl::ToChronoTime(options.deadline));
  }
}

// Ends the call when its cancellation comes. Lives as long as the call.
class CallScope {
 public:
  CallScope(const CallOptions& options, grpc::ClientContext* context)
      : registration_(options.cancellation, [context] { context->TryCancel(); }) {
    Prepare(options, context);
  }

 private:
  Cancellation::Registration registration_;
};

template <typename Request, typename Response>
class GrpcStream final : public BidiStream<Request, Response> {
 public:
  template <typename Open>
  GrpcStream(const CallOptions& options, const Open& open) : scope_(options, &context_) {
    stream_ = open(&context_);
  }
  bool Write(const Request& request) override { return stream_->Write(request); }
  bool WritesDone() override { return stream_->WritesDone(); }
  bool Read(Response* response) override { return stream_->Read(response); }
  void Cancel() override { context_.TryCancel(); }
  absl::Status Finish() override { return FromGrpc(stream_->Finish()); }

 private:
  grpc::ClientContext context_;
  CallScope scope_;
  std::unique_ptr<grpc::ClientReaderWriter<Request, Response>> stream_;
};

class GrpcConnection final : public Connection {
 public:
  explicit GrpcConnection(std::vector<std::shared_ptr<grpc::Channel>> channels)
      : channels_(std::move(channels)),
        scenes_(v1::SceneService::NewStub(channels_.front())),
        point_sets_(v1::PointSetService::NewStub(channels_.front())),
        capabilities_(v1::CapabilityService::NewStub(channels_.front())) {
    for (const auto& channel : channels_) {
      visibility_.push_back(v1::VisibilityService::NewStub(channel));
    }
  }

  absl::StatusOr<v1::Scene> CreateScene(const Upload<v1::CreateSceneRequest>& upload,
                                        const CallOptions& options) override {
    return CallUpload<v1::CreateSceneRequest, v1::Scene>(
        options, upload, [this](grpc::ClientContext* context, v1::Scene* scene) {
          return scenes_->CreateScene(context, scene);
        });
  }
  absl::StatusOr<v1::Scene> UpdateScene(const Upload<v1::UpdateSceneRequest>& upload,
                                        const CallOptions& options) override {
    return CallUpload<v1::UpdateSceneRequest, v1::Scene>(
        options, upload, [this](grpc::ClientContext* context, v1::Scene* scene) {
          return scenes_->UpdateScene(context, scene);
        });
  }
  absl::StatusOr<v1::Scene> GetScene(const v1::GetSceneRequest& request,
                                     const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::GetScene, request, options);
  }
  absl::StatusOr<v1::ListScenesResponse> ListScenes(const v1::ListScenesRequest& request,
                                                    const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::ListScenes, request, options);
  }
  absl::StatusOr<v1::ListSceneObjectsResponse> ListSceneObjects(
      const v1::ListSceneObjectsRequest& request, const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::ListSceneObjects, request, options);
  }
  absl::Status DeleteScene(const v1::DeleteSceneRequest& request,
                           const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::DeleteScene, request, options).status();
  }
  absl::Status WatchScene(const v1::WatchSceneRequest& request,
                          const std::function<bool(const v1::WatchSceneResponse&)>& on_change,
                          const CallOptions& options) override {
    grpc::ClientContext context;
    CallScope scope(options, &context);
    std::unique_ptr<grpc::ClientReader<v1::WatchSceneResponse>> reader =
        scenes_->WatchScene(&context, request);
    v1::WatchSceneResponse response;
    bool stopped = false;
    while (reader->Read(&response)) {
      if (stopped) continue;
      stopped = !on_change(response);
      if (stopped) context.TryCancel();
    }
    const grpc::Status status = reader->Finish();
    return stopped ? absl::OkStatus() : FromGrpc(status);
  }

  absl::StatusOr<v1::Scene> LoadScene(const v1::LoadSceneRequest& request,
                                      const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::LoadScene, request, options);
  }
  absl::StatusOr<v1::Scene> ReloadScene(const v1::ReloadSceneRequest& request,
                                        const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::ReloadScene, request, options);
  }
  absl::Status UnloadScene(const v1::UnloadSceneRequest& request,
                           const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::UnloadScene, request, options).status();
  }
  absl::StatusOr<v1::ListStoredScenesResponse> ListStoredScenes(
      const v1::ListStoredScenesRequest& request, const CallOptions& options) override {
    return Call(*scenes_, &v1::SceneService::Stub::ListStoredScenes, request, options);
  }

  absl::StatusOr<v1::PointSet> CreatePointSet(const Upload<v1::CreatePointSetRequest>& upload,
                                              const CallOptions& options) override {
    return CallUpload<v1::CreatePointSetRequest, v1::PointSet>(
        options, upload, [this](grpc::ClientContext* context, v1::PointSet* set) {
          return point_sets_->CreatePointSet(context, set);
        });
  }
  absl::StatusOr<v1::PointSet> GetPointSet(const v1::GetPointSetRequest& request,
                                           const CallOptions& options) override {
    return Call(*point_sets_, &v1::PointSetService::Stub::GetPointSet, request, options);
  }
  absl::StatusOr<v1::ListPointSetsResponse> ListPointSets(const v1::ListPointSetsRequest& request,
                                                          const CallOptions& options) override {
    return Call(*point_sets_, &v1::PointSetService::Stub::ListPointSets, request, options);
  }
  absl::Status DeletePointSet(const v1::DeletePointSetRequest& request,
                              const CallOptions& options) override {
    return Call(*point_sets_, &v1::PointSetService::Stub::DeletePointSet, request, options)
        .status();
  }
  absl::StatusOr<v1::PointSet> RenewLease(const v1::RenewLeaseRequest& request,
                                          const CallOptions& options) override {
    return Call(*point_sets_, &v1::PointSetService::Stub::RenewLease, request, options);
  }

  absl::StatusOr<v1::Capabilities> GetCapabilities(const CallOptions& options) override {
    return Call(*capabilities_, &v1::CapabilityService::Stub::GetCapabilities,
                v1::GetCapabilitiesRequest(), options);
  }
  absl::StatusOr<Health> CheckHealth(const std::string& service,
                                     const CallOptions& options) override;

  int channel_count() const override { return static_cast<int>(channels_.size()); }
  std::unique_ptr<TileStream> OpenTiles(int channel, const CallOptions& options) override {
    return std::make_unique<GrpcStream<v1::TraceTilesRequest, v1::TraceTilesResponse>>(
        options, [&](grpc::ClientContext* context) { return Stub(channel).TraceTiles(context); });
  }
  std::unique_ptr<ShadowStream> OpenShadows(int channel, const CallOptions& options) override {
    return std::make_unique<GrpcStream<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse>>(
        options,
        [&](grpc::ClientContext* context) { return Stub(channel).ComputeShadows(context); });
  }
  std::unique_ptr<SegmentStream> OpenSegments(int channel, const CallOptions& options) override {
    return std::make_unique<GrpcStream<v1::TestSegmentsRequest, v1::TestSegmentsResponse>>(
        options, [&](grpc::ClientContext* context) { return Stub(channel).TestSegments(context); });
  }

 private:
  v1::VisibilityService::Stub& Stub(int channel) {
    return *visibility_[static_cast<size_t>(channel) % visibility_.size()];
  }

  template <typename S, typename Request, typename Response>
  static absl::StatusOr<Response> Call(S& stub,
                                       grpc::Status (S::*method)(grpc::ClientContext*,
                                                                 const Request&, Response*),
                                       const Request& request, const CallOptions& options) {
    grpc::ClientContext context;
    CallScope scope(options, &context);
    Response response;
    const grpc::Status status = (stub.*method)(&context, request, &response);
    if (!status.ok()) return FromGrpc(status);
    return response;
  }

  template <typename Request, typename Response, typename Open>
  static absl::StatusOr<Response> CallUpload(const CallOptions& options,
                                             const Upload<Request>& upload, const Open& open) {
    grpc::ClientContext context;
    CallScope scope(options, &context);
    Response response;
    std::unique_ptr<grpc::ClientWriter<Request>> writer = open(&context, &response);
    upload([&](const Request& request) { return writer->Write(request); });
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    if (!status.ok()) return FromGrpc(status);
    return response;
  }

  const std::vector<std::shared_ptr<grpc::Channel>> channels_;
  const std::unique_ptr<v1::SceneService::Stub> scenes_;
  const std::unique_ptr<v1::PointSetService::Stub> point_sets_;
  const std::unique_ptr<v1::CapabilityService::Stub> capabilities_;
  std::vector<std::unique_ptr<v1::VisibilityService::Stub>> visibility_;
};

// Debian packages no generated code for grpc.health.v1. Its request is one string and its response
// one enum, both in field 1, so the call is made with raw bytes.
absl::StatusOr<Health> GrpcConnection::CheckHealth(const std::string& service,
                                                   const CallOptions& options) {
  google::protobuf::UnknownFieldSet request;
  if (!service.empty()) request.AddLengthDelimited(1, service);
  std::string bytes;
  request.SerializeToString(&bytes);
  const grpc::Slice slice(bytes);

  grpc::ClientContext context;
  CallScope scope(options, &context);
  grpc::CompletionQueue queue;
  grpc::GenericStub stub(channels_.front());
  std::unique_ptr<grpc::GenericClientAsyncResponseReader> call = stub.PrepareUnaryCall(
      &context, "/grpc.health.v1.Health/Check", grpc::ByteBuffer(&slice, 1), &queue);
  call->StartCall();
  grpc::ByteBuffer reply;
  grpc::Status status;
  call->Finish(&reply, &status, nullptr);
  void* tag = nullptr;
  bool ok = false;
  queue.Next(&tag, &ok);
  if (status.error_code() == grpc::StatusCode::NOT_FOUND) return Health::kServiceUnknown;
  if (!status.ok()) return FromGrpc(status);

  grpc::Slice single;
  google::protobuf::UnknownFieldSet fields;
  if (!reply.DumpToSingleSlice(&single).ok() ||
      !fields.ParseFromArray(single.begin(), static_cast<int>(single.size()))) {
    return absl::InternalError("the server's health reply cannot be read");
  }
  uint64_t value = 0;
  for (int i = 0; i < fields.field_count(); ++i) {
    const google::protobuf::UnknownField& field = fields.field(i);
    if (field.number() == 1 && field.type() == google::protobuf::UnknownField::TYPE_VARINT) {
      value = field.varint();
    }
  }
  switch (value) {
    case 1:
      return Health::kServing;
    case 2:
      return Health::kNotServing;
    case 3:
      return Health::kServiceUnknown;
    default:
      return Health::kUnknown;
  }
}

}  // namespace

grpc::ChannelArguments DefaultChannelArguments() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxReceiveBytes);
  arguments.SetMaxSendMessageSize(-1);
  // gRPC shares one connection between channels of equal target and arguments unless told
  // otherwise.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  // Reconnects are timed by our own back-off; gRPC's must not stand in its way. Its least back-off
  // is left alone: in spite of its name it is the time that a connection may take to come about.
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  // A machine that is gone, or a process that is stopped, does not say so.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  // A call that waits for its answer sends nothing else; after two gRPC would ask no more.
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  return arguments;
}

std::shared_ptr<Connection> MakeGrpcConnection(
    std::vector<std::shared_ptr<grpc::Channel>> channels) {
  return std::make_shared<GrpcConnection>(std::move(channels));
}

std::shared_ptr<Connection> MakeConnection(std::vector<std::shared_ptr<grpc::Channel>> channels,
                                           const ConnectionOptions& options) {
  return MakeRetryingConnection(MakeGrpcConnection(std::move(channels)), options.retry);
}

std::shared_ptr<Connection> MakeConnection(const std::string& target,
                                           const ConnectionOptions& options) {
  const int count = std::max(1, options.channels);
  std::vector<std::shared_ptr<grpc::Channel>> channels;
  channels.reserve(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i) {
    channels.push_back(MakeChannel(target, options.security, DefaultChannelArguments()));
  }
  return MakeConnection(std::move(channels), options);
}

}  // namespace sightline::client
