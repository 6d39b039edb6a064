// SPDX-License-Identifier: Apache-2.0
//
// Any bytes as the request of a plain call, through gRPC, to a whole server: whatever is decoded is
// answered or refused with a reason, in bounded words, and the server goes on. The first byte
// chooses the method, 'a' and on in the seed corpus, in the order of kMethods; the rest is the
// request. Calls that stream are for fuzz_request_decoders; WatchScene and health checks, whose
// requests are single messages, are here.
//
// The server has one stored scene of two triangles and one point set, which are made anew where a
// call took them away.
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <google/protobuf/stubs/logging.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "server/server.h"
#include "sightline/v1/capability_service.pb.h"
#include "sightline/v1/point_set_service.grpc.pb.h"
#include "sightline/v1/scene_service.grpc.pb.h"
#include "sightline/v1/status.pb.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {
namespace {

// New ones go to the end: the seeds name them by their place.
constexpr absl::string_view kMethods[] = {
    "sightline.v1.SceneService.GetScene",
    "sightline.v1.SceneService.ListScenes",
    "sightline.v1.SceneService.ListSceneObjects",
    "sightline.v1.SceneService.DeleteScene",
    "sightline.v1.SceneService.LoadScene",
    "sightline.v1.SceneService.UnloadScene",
    "sightline.v1.SceneService.ReloadScene",
    "sightline.v1.SceneService.ListStoredScenes",
    "sightline.v1.SceneService.WatchScene",
    "sightline.v1.PointSetService.GetPointSet",
    "sightline.v1.PointSetService.ListPointSets",
    "sightline.v1.PointSetService.DeletePointSet",
    "sightline.v1.PointSetService.RenewLease",
    "sightline.v1.CapabilityService.GetCapabilities",
    "grpc.health.v1.Health.Check",
};
// What a client's gRPC takes of trailers, beside which there is little else: 8 KiB; the text is in
// them twice, once in base64.
constexpr size_t kMostWords = 3000;

constexpr std::chrono::milliseconds kWatchTime(20);

bool IsWatch(absl::string_view method) { return absl::EndsWith(method, ".WatchScene"); }

void Require(bool condition) {
  if (!condition) std::abort();
}

const google::protobuf::MethodDescriptor* Describe(absl::string_view method) {
  return google::protobuf::DescriptorPool::generated_pool()->FindMethodByName(std::string(method));
}

// Every method of ours whose request is one message is among kMethods.
void RequireAllMethods() {
  const std::set<absl::string_view> known(std::begin(kMethods), std::end(kMethods));
  for (const google::protobuf::Descriptor* descriptor :
       {v1::Scene::descriptor(), v1::PointSet::descriptor(), v1::Capabilities::descriptor(),
        v1::TraceTilesRequest::descriptor()}) {
    const google::protobuf::FileDescriptor* const file = descriptor->file();
    Require(file->service_count() > 0);
    for (int s = 0; s < file->service_count(); ++s) {
      for (int m = 0; m < file->service(s)->method_count(); ++m) {
        const google::protobuf::MethodDescriptor* const method = file->service(s)->method(m);
        Require(method->client_streaming() || known.contains(method->full_name()));
      }
    }
  }
}

class World {
 public:
  World() {
    RequireAllMethods();
    SetLogLevel(LogLevel::kOff);
    std::string pattern = (std::filesystem::temp_directory_path() / "fuzz-XXXXXX").string();
    Require(mkdtemp(pattern.data()) != nullptr);
    folder_ = pattern;
    ServerOptions options;
    options.listen.clear();
    options.threads = options.build_threads = 1;
    options.repository = folder_;
    absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
    Require(server.ok());
    server_ = *std::move(server);
    channel_ = server_->InProcessChannel(grpc::ChannelArguments());
    stub_ = std::make_unique<grpc::GenericStub>(channel_);
    point_sets_ = v1::PointSetService::NewStub(channel_);
    Restore();
  }
  ~World() {
    point_sets_.reset();
    stub_.reset();
    channel_.reset();
    server_.reset();
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }

  // The first response, if there was one, and how it ended.
  grpc::Status Call(absl::string_view method, absl::string_view request,
                    grpc::ByteBuffer* response) {
    const size_t dot = method.rfind('.');
    grpc::ClientContext context;
    // A watch goes on until somebody ends it, and may wait for a scene that never comes.
    const bool watch = IsWatch(method);
    if (watch) context.set_deadline(std::chrono::system_clock::now() + kWatchTime);
    const auto call = stub_->PrepareCall(
        &context, absl::StrCat("/", method.substr(0, dot), "/", method.substr(dot + 1)), &queue_);
    call->StartCall(this);
    Next();
    const grpc::Slice slice(request.data(), request.size());
    call->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), this);
    Next();
    call->Read(response, this);
    if (Next() && watch) context.TryCancel();
    grpc::Status status;
    call->Finish(&status, this);
    Next();
    return status;
  }

  void Restore() {
    if (!server_->scenes().Get(kScene).ok() && !server_->scenes().Load(kScene, nullptr).ok()) {
      const ObjectInput floor{.name = "floor",
                              .vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
                              .indices = {0, 1, 2, 0, 2, 3}};
      Require(server_->scenes().Create({.scene_id = kScene}, std::vector{floor}, nullptr).ok());
    }
    grpc::ClientContext context, again;
    v1::GetPointSetRequest get;
    v1::PointSet set;
    get.set_name(absl::StrCat("scenes/", kScene, "/pointSets/points"));
    if (point_sets_->GetPointSet(&context, get, &set).ok()) return;
    const auto writer = point_sets_->CreatePointSet(&again, &set);
    v1::CreatePointSetRequest request;
    request.mutable_header()->set_parent(absl::StrCat("scenes/", kScene));
    request.mutable_header()->set_point_set_id("points");
    request.mutable_header()->mutable_upload()->set_point_count(1);
    writer->Write(request);
    request.mutable_chunk()->set_points(std::string(3 * sizeof(double), '\0'));
    writer->Write(request);
    writer->WritesDone();
    Require(writer->Finish().ok());
  }

 private:
  static constexpr char kScene[] = "box";

  bool Next() {
    void* tag = nullptr;
    bool ok = false;
    Require(queue_.Next(&tag, &ok));
    return ok;
  }

  std::string folder_;
  std::unique_ptr<Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<grpc::GenericStub> stub_;
  std::unique_ptr<v1::PointSetService::Stub> point_sets_;
  grpc::CompletionQueue queue_;
};

// Whether protobuf reads the request; what it does not, gRPC refuses before we see it. Health
// checks are gRPC's own throughout.
bool Parses(absl::string_view method, absl::string_view request) {
  const google::protobuf::MethodDescriptor* const described = Describe(method);
  if (described == nullptr) return false;
  const std::unique_ptr<google::protobuf::Message> message(
      google::protobuf::MessageFactory::generated_factory()
          ->GetPrototype(described->input_type())
          ->New());
  return message->ParseFromArray(request.data(), static_cast<int>(request.size()));
}

void CheckRefusal(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::NOT_FOUND:
    case grpc::StatusCode::FAILED_PRECONDITION:
    case grpc::StatusCode::RESOURCE_EXHAUSTED:
      break;
    default:
      Require(false);
  }
  v1::Status details;
  v1::ErrorInfo info;
  Require(details.ParseFromString(status.error_details()) && details.details_size() > 0);
  Require(info.ParseFromString(details.details(0).value()) && !info.reason().empty());
  Require(!status.error_message().empty());
  Require(status.error_message().size() + status.error_details().size() < kMostWords);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  [[maybe_unused]] static const auto old_handler = google::protobuf::SetLogHandler(nullptr);
  static World world;
  if (size == 0 || data[0] < 'a' || data[0] - 'a' >= static_cast<int>(std::size(kMethods))) {
    return -1;  // Not worth keeping.
  }
  const absl::string_view method = kMethods[data[0] - 'a'];
  const absl::string_view request(reinterpret_cast<const char*>(data) + 1, size - 1);
  grpc::ByteBuffer response;
  const grpc::Status status = world.Call(method, request, &response);
  const bool ended =
      IsWatch(method) && (status.error_code() == grpc::StatusCode::CANCELLED ||
                          status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED);
  if (Parses(method, request)) {
    if (!status.ok() && !ended) CheckRefusal(status);
  } else if (Describe(method) != nullptr) {
    Require(!status.ok());
  }
  world.Restore();
  return 0;
}

}  // namespace sightline
