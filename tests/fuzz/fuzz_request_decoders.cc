// SPDX-License-Identifier: Apache-2.0
//
// Any bytes as the messages of a call that streams (fuzz_plain_calls has the others): the decoders,
// the upload state machines, edits and the three query methods answer or refuse them, and never
// crash. The first byte chooses the call, '0' to '5' in the seed corpus; then each message follows
// its length, two bytes, the low one first. Of gRPC there are the buffers alone: messages of
// streams lie in slices of a few bytes, and are read with every array left where it is, which must
// make of them what protobuf does.
//
// Queries that are accepted are answered, and points are prepared, kept and lit, on a small scene
// and within small limits, so that whatever a decoder lets through meets the engine.
#include <google/protobuf/stubs/logging.h>
#include <grpcpp/support/byte_buffer.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/any_invocable.h"
#include "absl/strings/string_view.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "core/base/cancel.h"
#include "core/base/parallel.h"
#include "core/query/point_order.h"
#include "core/query/points.h"
#include "core/query/tile_result.h"
#include "server/admission/call_tracker.h"
#include "server/admission/ray_queue.h"
#include "server/admission/scheduler.h"
#include "server/base/limits.h"
#include "server/base/resource_name.h"
#include "server/codec/wire_request.h"
#include "server/points/camera_points.h"
#include "server/points/point_set_store.h"
#include "server/points/point_upload.h"
#include "server/scenes/scene_catalog.h"
#include "server/scenes/scene_upload.h"
#include "server/stream/item_reply.h"
#include "server/stream/query_environment.h"
#include "server/stream/segment_method.h"
#include "server/stream/shadow_method.h"
#include "server/stream/tile_method.h"

namespace sightline {
namespace {

constexpr char kSceneId[] = "box";
constexpr uint64_t kManyElements = 1 << 24;  // More than an input has bytes.

void Require(bool condition) {
  if (!condition) std::abort();
}

// Small enough that each input takes milliseconds, and that limits are reached.
Limits SmallLimits() {
  Limits limits;
  limits.max_item_rays = 4096;
  limits.max_image_width = limits.max_image_height = 64;
  limits.max_lights = 16;
  limits.max_samples_per_light = 64;
  limits.max_light_samples = 128;
  limits.max_objects_per_scene = 16;
  limits.max_triangles_per_scene = 1000;
  limits.max_vertices_per_scene = 3000;
  limits.max_points_per_set = 1000;
  return limits;
}

// What a server holds, without its network.
struct World {
  const Limits limits = SmallLimits();
  ThreadPool pool{1};
  CallQuota scenes_made{"scenes", CallQuota::Shares::kLast};
  SceneCatalog scenes{limits, pool};
  PointSetStore point_sets{limits, &absl::Now};
  RayQueue ray_queue{limits.max_queued_rays, limits.max_queued_rays_per_client};
  Scheduler scheduler{pool.threads(),
                      [this](absl::AnyInvocable<void()> work) { pool.Submit(std::move(work)); }};
  CallTracker calls;
  CallQuota streams{"streams"}, uploads{"uploads"}, upload_bytes{"upload-bytes"};
  QueryEnvironment environment{limits,  scenes,       point_sets, pool,  pool,
                               pool,    ray_queue,    scheduler,  calls, streams,
                               uploads, upload_bytes, scenes_made};

  World() {
    Make(kSceneId);
    // Points for items that ask about a range of a set.
    PreparedPoints points;
    points.positions = {{0.5F, 0.5F, 0.5F}, {0.25F, 0.25F, 2}, {3, 3, 3}};
    points.sources.assign(points.size(), kNoTriangle);
    points.valid.assign(points.size(), 1);
    const std::shared_ptr<const Scene> scene = *scenes.Pin(kSceneId, 0);
    Require(KeepPoints(scene, "p", std::move(points)).ok());
  }

  // As "scenes/box/pointSets/{id}".
  absl::Status KeepPoints(const std::shared_ptr<const Scene>& scene, const std::string& id,
                          PreparedPoints points) {
    PointSet set;
    set.scene_id = kSceneId;
    set.point_set_id = id;
    set.revision = scene->revision;
    set.scene = scene;
    set.orders = PointOrders(points.positions, points.valid, pool);
    set.points = std::move(points);
    return point_sets.Add(std::move(set), absl::Hours(24)).status();
  }

  // Another scene like it.
  std::string MakeEditable() {
    Make("editable");
    return "editable";
  }

  // A floor and a triangle above it, "o", that may be moved.
  void Make(const std::string& scene_id) {
    const ObjectInput floor{.name = "floor",
                            .vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}},
                            .indices = {0, 1, 2, 0, 2, 3}};
    const ObjectInput blocker{.name = "o",
                              .vertices = {{0, 0, 1}, {1, 0, 1}, {0, 1, 1}},
                              .indices = {0, 1, 2},
                              .dynamic = true};
    const std::vector<ObjectInput> objects = {floor, blocker};
    Require(scenes.Create({.scene_id = scene_id}, objects, nullptr).ok());
  }
};

World& TheWorld() {
  static World* const world = new World;
  return *world;
}

// The messages of an input, in order.
std::vector<absl::string_view> Bodies(absl::string_view bytes) {
  std::vector<absl::string_view> bodies;
  while (bytes.size() >= 2) {
    const size_t announced = static_cast<uint8_t>(bytes[0]) + 256 * static_cast<uint8_t>(bytes[1]);
    bytes.remove_prefix(2);
    bodies.push_back(bytes.substr(0, announced));
    bytes.remove_prefix(bodies.back().size());
  }
  return bodies;
}

// Those that parse.
template <typename Message>
std::vector<Message> Messages(absl::string_view bytes) {
  std::vector<Message> messages;
  for (const absl::string_view body : Bodies(bytes)) {
    Message message;
    if (message.ParseFromArray(body.data(), static_cast<int>(body.size()))) {
      messages.push_back(std::move(message));
    }
  }
  return messages;
}

void FuzzCreateScene(absl::string_view bytes) {
  World& world = TheWorld();
  SceneUpload upload(world.limits);
  for (const auto& message : Messages<v1::CreateSceneRequest>(bytes)) {
    if (!upload.Add(message).ok()) {
      // After an error nothing more is accepted.
      Require(!upload.Add(message).ok());
      Require(!upload.Finish().ok());
      return;
    }
  }
  const absl::StatusOr<std::vector<ObjectInput>> objects = upload.Finish();
  if (!objects.ok() || objects->empty()) return;
  SceneCatalog::CreateOptions options = upload.header()->create;
  options.scene_id = "uploaded";
  if (world.scenes.Create(options, *objects, nullptr).ok()) {
    Require(world.scenes.Delete(options.scene_id).ok());
  }
}

void FuzzUpdateScene(absl::string_view bytes) {
  World& world = TheWorld();
  SceneEditUpload upload(world.limits);
  for (const auto& message : Messages<v1::UpdateSceneRequest>(bytes)) {
    if (!upload.Add(message).ok()) {
      Require(!upload.Finish().ok());
      return;
    }
  }
  const absl::StatusOr<std::vector<SceneEdit>> edits = upload.Finish();
  if (!edits.ok()) return;
  // On a scene of its own: other inputs find theirs as it was.
  SceneCatalog::EditOptions options = upload.header()->edit;
  options.scene_id = world.MakeEditable();
  const absl::StatusOr<SceneView> edited = world.scenes.Edit(options, *edits, nullptr);
  const absl::StatusOr<SceneView> now = world.scenes.Get(options.scene_id);
  Require(now.ok() && now->status.latest != nullptr);
  Require(now->status.latest->revision == (edited.ok() ? edited->status.latest->revision : 1));
  Require(world.scenes.Delete(options.scene_id).ok());
}

// The message as it may arrive, in slices whose lengths follow from its own bytes.
grpc::ByteBuffer InSlices(absl::string_view bytes) {
  std::vector<grpc::Slice> slices;
  while (!bytes.empty()) {
    const size_t length = std::min(bytes.size(), 1 + static_cast<size_t>(bytes[0] & 31));
    slices.emplace_back(bytes.data(), length);
    bytes.remove_prefix(length);
  }
  return {slices.data(), slices.size()};
}

// The same message with its arrays lifted out and put back, or nothing.
template <typename Method>
void RequireSameAsProtobuf(absl::string_view body) {
  typename Method::Request whole, scanned;
  const bool parses = whole.ParseFromArray(body.data(), static_cast<int>(body.size()));
  whole.DiscardUnknownFields();
  std::vector<WireArray> arrays(Method::ArrayPaths().size());
  grpc::ByteBuffer buffer = InSlices(body);
  const bool read =
      ReadRequest(&buffer, Method::ArrayPaths(), {kManyElements}, &scanned, arrays, 0).ok();
  Require(read == parses);
  if (!parses) return;
  for (size_t i = 0; i < arrays.size(); ++i) {
    if (arrays[i].empty()) continue;
    std::string held(arrays[i].size(), '\0');
    CopyBytes(arrays[i], held.data());
    google::protobuf::Message* message = &scanned;
    const WirePath& path = Method::ArrayPaths()[i];
    size_t depth = 0;
    for (; depth + 1 < path.size() && path[depth + 1] != 0; ++depth) {
      message = message->GetReflection()->MutableMessage(
          message, message->GetDescriptor()->FindFieldByNumber(path[depth]));
    }
    message->GetReflection()->SetString(
        message, message->GetDescriptor()->FindFieldByNumber(path[depth]), held);
  }
  Require(scanned.SerializeAsString() == whole.SerializeAsString());
}

// Answers an item as a visibility stream does, or says why not.
template <typename Method>
absl::Status Answer(const Method& method, typename Method::Item item) {
  const CancelToken cancel;
  auto work = method.Prepare(std::move(item), cancel, Scheduler::kLeastPartRays);
  if (!work.ok()) return work.status();
  QueryStats stats;
  ItemReply reply;
  size_t replies = 0;
  for (size_t part = 0; part < (*work)->parts().size(); ++part) {
    reply = ItemReply();
    const absl::StatusOr<PartRange> answered = (*work)->RunPart(part, cancel, &reply, &stats);
    if (!answered.ok()) return answered.status();
    if (answered->count > 0) ++replies;
  }
  Require(replies == (*work)->replies());
  (*work)->Complete(&reply);
  typename Method::Response response;
  grpc::ByteBuffer answer = ReplyBytes({}, std::move(reply));
  Require(ReadRequest(&answer, {}, {kManyElements}, &response, {}).ok() && response.has_reply());
  return absl::OkStatus();
}

// A header, then items, as a visibility stream takes them.
template <typename Method>
void FuzzStream(absl::string_view bytes) {
  World& world = TheWorld();
  std::unique_ptr<Method> method;
  for (const absl::string_view body : Bodies(bytes)) {
    RequireSameAsProtobuf<Method>(body);
    typename Method::Request message;
    typename Method::Item item;
    grpc::ByteBuffer buffer = InSlices(body);
    if (!Method::Read(&buffer, {kManyElements}, &message, &item).ok()) continue;
    if (message.has_header()) {
      auto opened = Method::Open(message.header(), world.environment);
      if (!opened.ok()) return;
      method = *std::move(opened);
    }
    if (!message.has_item() || method == nullptr) continue;
    if (method->Rays(item) > world.limits.max_item_rays) continue;
    (void)Answer(*method, std::move(item));
  }
}

// What a set is made of, as PointSetService does it.
absl::StatusOr<PreparedPoints> MakePoints(const PointSetHeader& header,
                                          const DecodedPoints& uploaded,
                                          const std::shared_ptr<const Scene>& scene) {
  const CancelToken cancel;
  if (header.camera.has_value()) {
    absl::StatusOr<std::unique_ptr<CameraPoints>> points =
        CameraPoints::Make(scene, *header.camera, header.camera_options);
    if (!points.ok()) return points.status();
    TileResult scratch;
    for (size_t tile = 0; tile < (*points)->tiles(); ++tile) {
      Require((*points)->Trace(tile, &cancel, &scratch).ok());
    }
    return (*points)->Take();
  }
  const absl::StatusOr<std::vector<uint32_t>> sources = uploaded.Sources(scene->geometry);
  if (!sources.ok()) return sources.status();
  return PreparePoints(*scene, {uploaded.positions, uploaded.normals, *sources}, header.options,
                       &cancel);
}

// The points are kept, and lit by one light.
void FuzzCreatePointSet(absl::string_view bytes) {
  World& world = TheWorld();
  PointUpload upload(world.limits);
  for (const auto& message : Messages<v1::CreatePointSetRequest>(bytes)) {
    if (!upload.Add(message).ok()) {
      Require(!upload.Finish().ok());
      return;
    }
  }
  const absl::StatusOr<DecodedPoints> uploaded = upload.Finish();
  if (!uploaded.ok()) return;
  const PointSetHeader& header = *upload.header();
  const absl::StatusOr<std::shared_ptr<const Scene>> scene =
      world.scenes.Pin(header.scene_id, header.revision);
  if (!scene.ok()) return;
  absl::StatusOr<PreparedPoints> points = MakePoints(header, *uploaded, *scene);
  if (!points.ok()) return;
  const size_t count = points->size();
  Require(count == header.point_count);
  Require(points->valid.size() == count && points->sources.size() == count);
  const auto valid =
      static_cast<size_t>(std::count(points->valid.begin(), points->valid.end(), uint8_t{1}));
  Require(valid + points->invalid == count);
  Require(points->attached <= valid && points->near_surface <= valid);
  for (const uint32_t source : points->sources) {
    Require(source == kNoTriangle || source < (*scene)->geometry.triangles.size());
  }
  constexpr char kMade[] = "made";
  Require(world.KeepPoints(*scene, kMade, *std::move(points)).ok());
  v1::ComputeShadowsRequest request;
  request.mutable_header()->mutable_stream()->set_scene(SceneName(kSceneId));
  v1::Vector3* const light =
      request.mutable_header()->add_lights()->mutable_point()->mutable_position();
  light->set_x(0.25);
  light->set_y(0.25);
  light->set_z(1.5);
  const auto opened = ShadowMethod::Open(request.header(), world.environment);
  Require(opened.ok());
  ShadowMethod::Item item;
  v1::PointSetRange* const range = item.message.mutable_point_set_range();
  range->set_point_set(PointSetNameOf(kSceneId, kMade));
  range->set_count(count);
  Require(Answer(**opened, std::move(item)).ok());
  Require(world.point_sets.Remove(kSceneId, kMade).ok());
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  // Protobuf says on stderr whatever does not parse.
  [[maybe_unused]] static const auto old_handler = google::protobuf::SetLogHandler(nullptr);
  if (size == 0) return 0;
  const absl::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0]) {
    case '0':
      FuzzCreateScene(bytes);
      break;
    case '1':
      FuzzUpdateScene(bytes);
      break;
    case '2':
      FuzzCreatePointSet(bytes);
      break;
    case '3':
      FuzzStream<TileMethod>(bytes);
      break;
    case '4':
      FuzzStream<ShadowMethod>(bytes);
      break;
    case '5':
      FuzzStream<SegmentMethod>(bytes);
      break;
    default:
      return -1;  // Not worth keeping.
  }
  return 0;
}

}  // namespace sightline
