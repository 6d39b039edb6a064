// SPDX-License-Identifier: Apache-2.0
//
// A server of its own for each test, on a free loopback port, and blocking client streams to it.
//
// Thread safety: one thread, except that a stream may be written and read by two.
#ifndef SIGHTLINE_TESTS_INTEGRATION_SERVER_HARNESS_H_
#define SIGHTLINE_TESTS_INTEGRATION_SERVER_HARNESS_H_

#include <grpcpp/grpcpp.h>

#include <initializer_list>
#include <iterator>
#include <map>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/geometry/camera.h"
#include "core/mesh/builtin/builtin.h"
#include "gtest/gtest.h"
#include "server/base/error.h"
#include "server/server.h"
#include "sightline/v1/capability_service.grpc.pb.h"
#include "sightline/v1/point_set_service.grpc.pb.h"
#include "sightline/v1/scene_service.grpc.pb.h"
#include "sightline/v1/visibility_service.grpc.pb.h"

namespace sightline {

// The reason in a call's status, without its prefix.
inline std::string ReasonIn(const grpc::Status& status) {
  v1::Status details;
  v1::ErrorInfo info;
  if (!details.ParseFromString(status.error_details()) || details.details().empty()) return "";
  if (!info.ParseFromString(details.details(0).value())) return "";
  return info.reason();
}

class ServerHarness {
 public:
  explicit ServerHarness(ServerOptions options = {}) {
    options.log_level = LogLevel::kOff;
    SetLogLevel(LogLevel::kOff);
    absl::StatusOr<std::unique_ptr<Server>> started = Server::Start(options);
    if (!started.ok()) {
      ADD_FAILURE() << started.status();
      std::abort();
    }
    server = *std::move(started);
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(-1);
    channel = grpc::CreateCustomChannel("127.0.0.1:" + std::to_string(server->port()),
                                        grpc::InsecureChannelCredentials(), arguments);
    scenes = v1::SceneService::NewStub(channel);
    point_sets = v1::PointSetService::NewStub(channel);
    visibility = v1::VisibilityService::NewStub(channel);
    capabilities = v1::CapabilityService::NewStub(channel);
  }

  grpc::Status CreateBuiltin(const std::string& id, const std::string& spec, v1::Scene* scene,
                             const std::string& request_id = "") const {
    v1::CreateSceneRequest request;
    request.mutable_header()->set_scene_id(id);
    request.mutable_header()->set_request_id(request_id);
    request.mutable_header()->mutable_builtin()->set_spec(spec);
    return CreateScene({request}, scene);
  }
  grpc::Status CreateScene(const std::vector<v1::CreateSceneRequest>& messages,
                           v1::Scene* scene) const {
    grpc::ClientContext context;
    auto writer = scenes->CreateScene(&context, scene);
    for (const auto& message : messages) {
      if (!writer->Write(message)) break;
    }
    writer->WritesDone();
    return writer->Finish();
  }
  grpc::Status UpdateScene(const std::vector<v1::UpdateSceneRequest>& messages,
                           v1::Scene* scene) const {
    grpc::ClientContext context;
    auto writer = scenes->UpdateScene(&context, scene);
    for (const auto& message : messages) {
      if (!writer->Write(message)) break;
    }
    writer->WritesDone();
    return writer->Finish();
  }
  grpc::Status CreatePointSet(const std::vector<v1::CreatePointSetRequest>& messages,
                              v1::PointSet* set) const {
    grpc::ClientContext context;
    auto writer = point_sets->CreatePointSet(&context, set);
    for (const auto& message : messages) {
      if (!writer->Write(message)) break;
    }
    writer->WritesDone();
    return writer->Finish();
  }

  std::unique_ptr<Server> server;
  std::shared_ptr<grpc::Channel> channel;
  std::unique_ptr<v1::SceneService::Stub> scenes;
  std::unique_ptr<v1::PointSetService::Stub> point_sets;
  std::unique_ptr<v1::VisibilityService::Stub> visibility;
  std::unique_ptr<v1::CapabilityService::Stub> capabilities;
};

// A square of two triangles in the plane y = 0, |x|, |z| <= 1, uploaded as scene `id`.
inline std::vector<v1::CreateSceneRequest> WallUpload(const std::string& id) {
  const double v[] = {-1, 0, -1, 1, 0, -1, 1, 0, 1, -1, 0, 1};
  const uint32_t t[] = {0, 1, 2, 0, 2, 3};
  std::vector<v1::CreateSceneRequest> messages(3);
  v1::CreateSceneHeader* header = messages[0].mutable_header();
  header->set_scene_id(id);
  header->mutable_upload()->set_object_count(1);
  header->mutable_upload()->set_triangle_count(2);
  header->mutable_upload()->set_vertex_count(4);
  messages[1].mutable_object()->set_object_name("wall");
  messages[1].mutable_object()->set_dynamic(true);
  messages[1].mutable_object()->set_triangle_count(2);
  messages[1].mutable_object()->set_vertex_count(4);
  messages[2].mutable_chunk()->set_vertices_f64(
      std::string(reinterpret_cast<const char*>(v), sizeof(v)));
  messages[2].mutable_chunk()->set_indices(
      std::string(reinterpret_cast<const char*>(t), sizeof(t)));
  return messages;
}

inline void EncodeTestVector(Vec3d v, v1::Vector3* out) {
  out->set_x(v.x);
  out->set_y(v.y);
  out->set_z(v.z);
}

inline void EncodeTestCamera(const Camera& camera, v1::Camera* out) {
  EncodeTestVector(camera.eye, out->mutable_eye());
  EncodeTestVector(camera.right, out->mutable_right());
  EncodeTestVector(camera.up, out->mutable_up());
  EncodeTestVector(camera.forward, out->mutable_forward());
  out->set_tan_half_fov_y(camera.tan_half_fov_y);
  out->set_width(camera.width);
  out->set_height(camera.height);
}

// The first view of a built-in scene.
inline BuiltinView FirstView(const std::string& spec) {
  return MakeBuiltin(*ParseBuiltin(spec))->views[0];
}
inline Camera ViewCamera(const BuiltinView& view, uint32_t width, uint32_t height) {
  return *LookAt(view.eye, view.at, view.up, view.fov_y_degrees, width, height);
}

// One open stream of any of the three methods.
template <typename Request, typename Response>
class TestStream {
 public:
  using Opener = std::unique_ptr<grpc::ClientReaderWriter<Request, Response>> (
      v1::VisibilityService::Stub::*)(grpc::ClientContext*);

  TestStream(ServerHarness& harness, Opener opener, const Request& header)
      : stream_(((*harness.visibility).*opener)(&context)) {
    stream_->Write(header);
  }
  ~TestStream() {
    if (!finished_) {
      context.TryCancel();
      stream_->Finish();
    }
  }

  bool Write(const Request& request) { return stream_->Write(request); }
  void HalfClose() { stream_->WritesDone(); }
  bool Read(Response* response) { return stream_->Read(response); }
  grpc::Status Finish() {
    finished_ = true;
    return stream_->Finish();
  }
  // Half-closes, reads to the end, and returns the replies of each item by id.
  std::map<uint64_t, std::vector<Response>> ReadAll() {
    HalfClose();
    std::map<uint64_t, std::vector<Response>> replies;
    Response response;
    while (Read(&response)) {
      if (response.has_reply()) replies[response.reply().header().item_id()].push_back(response);
    }
    return replies;
  }

  grpc::ClientContext context;

 private:
  std::unique_ptr<grpc::ClientReaderWriter<Request, Response>> stream_;
  bool finished_ = false;
};

struct TileStream : TestStream<v1::TraceTilesRequest, v1::TraceTilesResponse> {
  TileStream(ServerHarness& harness, const v1::TraceTilesRequest& header)
      : TestStream(harness, static_cast<Opener>(&v1::VisibilityService::Stub::TraceTiles), header) {
  }
};
struct ShadowStream : TestStream<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse> {
  ShadowStream(ServerHarness& harness, const v1::ComputeShadowsRequest& header)
      : TestStream(harness, static_cast<Opener>(&v1::VisibilityService::Stub::ComputeShadows),
                   header) {}
};
struct SegmentStream : TestStream<v1::TestSegmentsRequest, v1::TestSegmentsResponse> {
  SegmentStream(ServerHarness& harness, const v1::TestSegmentsRequest& header)
      : TestStream(harness, static_cast<Opener>(&v1::VisibilityService::Stub::TestSegments),
                   header) {}
};

// Opens a stream of tiles of scenes/box, made of box:1000, in a picture of 64×64.
inline v1::TraceTilesRequest BoxHeader() {
  v1::TraceTilesRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/box");
  EncodeTestCamera(ViewCamera(FirstView("box:1000"), 64, 64),
                   request.mutable_header()->mutable_camera());
  return request;
}

inline v1::TraceTilesRequest TileRequest(uint64_t id, uint32_t x, uint32_t y, uint32_t width,
                                         uint32_t height) {
  v1::TraceTilesRequest request;
  request.mutable_item()->mutable_item()->set_item_id(id);
  request.mutable_item()->set_x(x);
  request.mutable_item()->set_y(y);
  request.mutable_item()->set_width(width);
  request.mutable_item()->set_height(height);
  return request;
}

template <typename T>
std::vector<T> UnpackArray(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  if (!bytes.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  return values;
}

template <typename Array>
requires std::is_class_v<Array> std::string PackArray(const Array& values) {
  return std::string(reinterpret_cast<const char*>(std::data(values)),
                     std::size(values) * sizeof(*std::data(values)));
}
template <typename T>
std::string PackArray(std::initializer_list<T> values) {
  return PackArray<std::initializer_list<T>>(values);
}

}  // namespace sightline

#endif  // SIGHTLINE_TESTS_INTEGRATION_SERVER_HARNESS_H_
