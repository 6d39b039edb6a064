// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/service_workload.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/byte_buffer.h>

#include <algorithm>
#include <array>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/light/light.h"
#include "core/light/sky_patches.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "server/base/limits.h"
#include "server/codec/result_codec.h"
#include "server/points/camera_points.h"
#include "sightline/v1/point_set_service.grpc.pb.h"
#include "sightline/v1/visibility_service.pb.h"
#include "tests/bench/answer_digest.h"
#include "tests/bench/point_sets.h"
#include "tests/bench/random.h"
#include "tests/bench/service_exchange.h"

namespace sightline::bench {
namespace {

constexpr uint64_t kPointsPerItem = 16'384;
constexpr uint64_t kSegmentsPerItem = 65'536;
constexpr uint32_t kTile = 128;
// Items unanswered at once: enough to keep two threads busy while others travel...
constexpr size_t kWindow = 8;
// ... as far as the stream's credit goes.
size_t WindowOf(uint64_t rays_per_item) {
  const uint64_t credit = Limits().stream_credit_rays;
  return std::clamp<size_t>((credit + rays_per_item - 1) / rays_per_item, 1, kWindow);
}

// The arrays of an answer, as digests tell them apart.
enum AnswerArray : uint64_t { kLit, kSums, kBlocked, kHits, kDepths, kObjects, kTriangles };

// Which elements of which item a piece of an answer holds.
struct Piece {
  uint64_t item = 0, offset = 0, count = 0;
};

template <typename Reply>
Piece PieceOf(const Reply& reply) {
  const v1::ReplyHeader& header = reply.header();
  return {header.item_id(), header.offset(), header.element_count()};
}

// `bytes` of every element, one behind the other.
void AddArray(AnswerArray array, const Piece& piece, size_t bytes, std::string_view values,
              Answer* answer) {
  answer->bytes += values.size();
  answer->digest +=
      DigestOfArray({.item = piece.item, .array = array}, piece.offset * bytes, values);
}
void AddBits(AnswerArray array, const Piece& piece, std::string_view rows, Answer* answer) {
  answer->bytes += rows.size();
  answer->digest +=
      DigestOfBitRows({.item = piece.item, .array = array}, piece.offset, piece.count, rows);
}
template <typename Array>
std::string_view Bytes(const Array& values) {
  return {reinterpret_cast<const char*>(values.data()),
          values.size() * sizeof(typename Array::value_type)};
}

v1::StreamHeader StreamHeaderOf(const ServiceSpec& spec) {
  v1::StreamHeader header;
  header.set_scene(absl::StrCat("scenes/", spec.scene_id));
  return header;
}

void EncodeVector(Vec3d v, v1::Vector3* out) {
  out->set_x(v.x);
  out->set_y(v.y);
  out->set_z(v.z);
}

absl::StatusOr<Camera> CameraOf(const BuiltinView& view, const ServiceSpec& spec) {
  return LookAt(view.eye, view.at, view.up, view.fov_y_degrees, spec.width, spec.height);
}

void EncodeLight(const Light& light, v1::Light* out) {
  if (light.kind == Light::Kind::kDirectional) {
    EncodeVector(light.direction, out->mutable_directional()->mutable_direction());
  } else {
    EncodeVector(light.position, out->mutable_point()->mutable_position());
  }
}

// Runs `item` for each of `count` on the pool and adds the answers up.
absl::StatusOr<Answer> RunItems(
    ThreadPool& pool, size_t count,
    const std::function<absl::Status(size_t item, Answer* answer)>& item) {
  std::vector<Answer> answers(count);
  Mutex mutex;
  absl::Status failure;
  pool.ParallelFor(count, 1, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      const absl::Status status = item(i, &answers[i]);
      if (status.ok()) continue;
      MutexLock lock(mutex);
      failure = status;
    }
  });
  if (!failure.ok()) return failure;
  Answer all;
  for (const Answer& answer : answers) {
    all.digest += answer.digest;
    all.bytes += answer.bytes;
  }
  return all;
}

template <typename Request, typename Response>
absl::StatusOr<Answer> RunStream(const std::shared_ptr<grpc::Channel>& channel,
                                 const std::string& method, const Request& header, size_t items,
                                 uint64_t rays_per_item,
                                 const std::function<Request(size_t item)>& make,
                                 const std::function<void(const Response&, Answer*)>& take) {
  Answer answer;
  absl::Status failure;
  Exchange<Request, Response> exchange(
      {.method = absl::StrCat("/sightline.v1.VisibilityService/", method),
       .header = header,
       .items = items,
       .window = WindowOf(rays_per_item),
       .make = make,
       .take = [&](Response* response) {
         const v1::ReplyHeader& reply = response->reply().header();
         if (reply.status().code() != 0) failure = absl::InternalError(reply.status().message());
         ++answer.replies;
         take(*response, &answer);
         return reply.last();
       }});
  SL_RETURN_IF_ERROR(exchange.Run(channel));
  SL_RETURN_IF_ERROR(failure);
  return answer;
}

// Points × lights: bits, or sums.
ServiceWorkload Shadows(const std::string& name, std::shared_ptr<const Scene> scene,
                        std::shared_ptr<const PreparedPoints> points,
                        const std::vector<Light>& lights, const ServiceSpec& spec, bool sums) {
  v1::ComputeShadowsRequest header;
  *header.mutable_header()->mutable_stream() = StreamHeaderOf(spec);
  header.mutable_header()->mutable_outputs()->set_lit_bits(!sums);
  header.mutable_header()->mutable_outputs()->set_weighted_sums(sums);
  auto samples = std::make_shared<std::vector<LightSample>>();
  for (uint32_t i = 0; i < lights.size(); ++i) {
    EncodeLight(lights[i], header.mutable_header()->add_lights());
    if (!AppendSamples(lights[i], i, scene->geometry.origin, samples.get()).ok()) return {};
  }
  ServiceWorkload workload{.name = name, .rays = points->size() * samples->size()};
  workload.items = (points->size() + kPointsPerItem - 1) / kPointsPerItem;
  const auto range = [points](size_t item) {
    const uint64_t begin = item * kPointsPerItem;
    return std::pair(begin, std::min<uint64_t>(kPointsPerItem, points->size() - begin));
  };
  workload.run_engine = [=, items = workload.items](ThreadPool& pool) {
    const std::vector<double> weights(sums ? samples->size() : 0, 1.0);
    return RunItems(pool, items, [&](size_t item, Answer* answer) -> absl::Status {
      const auto [begin, count] = range(item);
      ShadowResult result;
      SL_RETURN_IF_ERROR(ComputeShadows(*scene, PointRange::Slice(*points, begin, count), *samples,
                                        weights, {}, {.bits = !sums, .weighted_sums = sums}, {},
                                        &result));
      const Piece piece{item, 0, count};
      AddBits(kLit, piece, Bytes(result.lit_bits), answer);
      AddArray(kSums, piece, sizeof(double), Bytes(result.weighted_sums), answer);
      return absl::OkStatus();
    });
  };
  const auto make = [=](size_t item) {
    v1::ComputeShadowsRequest request;
    request.mutable_item()->mutable_item()->set_item_id(item);
    v1::PointSetRange* set = request.mutable_item()->mutable_point_set_range();
    set->set_point_set(absl::StrCat("scenes/", spec.scene_id, "/pointSets/", spec.point_set_id));
    set->set_offset(range(item).first);
    set->set_count(range(item).second);
    return request;
  };
  workload.request_bytes = make(0).ByteSizeLong();
  workload.run_service = [=, items = workload.items](const std::shared_ptr<grpc::Channel>& to) {
    return RunStream<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse>(
        to, "ComputeShadows", header, items, kPointsPerItem * samples->size(), make,
        [](const v1::ComputeShadowsResponse& response, Answer* answer) {
          const v1::ShadowResult& result = response.reply().shadows();
          const Piece piece = PieceOf(response.reply());
          AddBits(kLit, piece, result.lit_bits(), answer);
          AddArray(kSums, piece, sizeof(double), result.weighted_sums(), answer);
        });
  };
  return workload;
}

grpc::ByteBuffer Serialized(const google::protobuf::MessageLite& message) {
  const grpc::Slice slice(message.SerializeAsString());
  return grpc::ByteBuffer(&slice, 1);
}

// An item's message whose `field` refers to `segments`, which outlive the call, as a client sends
// it that keeps its arrays: they are copied once, into the socket.
template <typename Segment>
grpc::ByteBuffer SegmentsMessage(uint64_t item_id, int field, std::span<const Segment> segments) {
  using google::protobuf::internal::WireFormatLite;
  using Item = v1::SegmentItem;
  const auto head = [](int field, uint64_t length, std::string* out) {
    google::protobuf::io::StringOutputStream stream(out);
    google::protobuf::io::CodedOutputStream coded(&stream);
    coded.WriteTag(WireFormatLite::MakeTag(field, WireFormatLite::WIRETYPE_LENGTH_DELIMITED));
    coded.WriteVarint64(length);
  };
  Item item;
  item.mutable_item()->set_item_id(item_id);
  std::string inner = item.SerializeAsString();
  head(field, segments.size_bytes(), &inner);
  std::string outer;
  head(v1::TestSegmentsRequest::kItemFieldNumber, inner.size() + segments.size_bytes(), &outer);
  const grpc::Slice slices[] = {
      grpc::Slice(outer + inner),
      grpc::Slice(segments.data(), segments.size_bytes(), grpc::Slice::STATIC_SLICE)};
  return grpc::ByteBuffer(slices, 2);
}

using WorldSegment = std::array<Vec3d, 2>;
using StoredSegment = std::array<Vec3f, 2>;  // SegmentItem.segments_f32.

absl::Status PrepareEnds(const Scene& scene, std::span<const WorldSegment> ends,
                         PreparedSegments* prepared) {
  return PrepareSegments(scene, ends, {}, {}, prepared);
}
absl::Status PrepareEnds(const Scene& scene, std::span<const StoredSegment> ends,
                         PreparedSegments* prepared) {
  return PrepareStoredSegments(scene, ends, {}, {}, prepared);
}

// Segments between random points of the scene's box, a third of it long.
std::vector<WorldSegment> RandomSegments(const Scene& scene, uint64_t count) {
  const Box3f box = scene.geometry.bounds;
  const Vec3d origin = scene.geometry.origin;
  std::vector<WorldSegment> ends(count);
  Random random(7);
  for (WorldSegment& segment : ends) {
    for (int axis = 0; axis < 3; ++axis) {
      const double low = box.lo[axis], size = box.hi[axis] - low;
      const double from = low + random.Uniform(0, size);
      const double to = from + random.Uniform(-size, size) / 6;
      segment[0][axis] = origin[axis] + from;
      segment[1][axis] = origin[axis] + to;
    }
  }
  return ends;
}

// The same in their stored form.
std::vector<StoredSegment> Stored(std::span<const WorldSegment> segments, Vec3d origin) {
  std::vector<StoredSegment> stored;
  stored.reserve(segments.size());
  for (const auto& [from, to] : segments) {
    stored.push_back({ToFloat(from - origin), ToFloat(to - origin)});
  }
  return stored;
}

// Bits of segments in either form, which is what the engine gets as well.
template <typename Segment>
ServiceWorkload Segments(const std::string& name, int field, std::shared_ptr<const Scene> scene,
                         std::vector<Segment> segments, const ServiceSpec& spec) {
  const auto ends = std::make_shared<const std::vector<Segment>>(std::move(segments));
  v1::TestSegmentsRequest header;
  EncodeVector(scene->geometry.origin, header.mutable_header()->mutable_origin());
  *header.mutable_header()->mutable_stream() = StreamHeaderOf(spec);
  ServiceWorkload workload{.name = name, .rays = spec.segments};
  workload.items = (spec.segments + kSegmentsPerItem - 1) / kSegmentsPerItem;
  const auto slice = [ends](size_t item) {
    const std::span<const Segment> all(*ends);
    const size_t begin = item * kSegmentsPerItem;
    return all.subspan(begin, std::min<size_t>(kSegmentsPerItem, all.size() - begin));
  };
  workload.run_engine = [=, items = workload.items](ThreadPool& pool) {
    return RunItems(pool, items, [&](size_t item, Answer* answer) -> absl::Status {
      PreparedSegments prepared;
      SL_RETURN_IF_ERROR(PrepareEnds(*scene, slice(item), &prepared));
      SegmentResult result;
      SL_RETURN_IF_ERROR(TestSegments(*scene, prepared, {.bits = true}, {}, &result));
      AddBits(kBlocked, {item, 0, prepared.size()}, Bytes(result.blocked_bits), answer);
      return absl::OkStatus();
    });
  };
  const auto make = [=](size_t item) { return SegmentsMessage(item, field, slice(item)); };
  workload.request_bytes = make(0).Length();
  workload.run_service = [=, items = workload.items](const std::shared_ptr<grpc::Channel>& to) {
    return RunStream<grpc::ByteBuffer, v1::TestSegmentsResponse>(
        to, "TestSegments", Serialized(header), items, kSegmentsPerItem, make,
        [](const v1::TestSegmentsResponse& response, Answer* answer) {
          AddBits(kBlocked, PieceOf(response.reply()), response.reply().segments().blocked_bits(),
                  answer);
        });
  };
  return workload;
}

// Camera tiles: with depth and ids, or with the bits of hits and lights alone.
ServiceWorkload Tiles(const std::string& name, std::shared_ptr<const Scene> scene,
                      const Camera& camera, const std::vector<Light>& lights,
                      const ServiceSpec& spec, bool arrays) {
  v1::TraceTilesRequest header;
  *header.mutable_header()->mutable_stream() = StreamHeaderOf(spec);
  EncodeBenchCamera(camera, header.mutable_header()->mutable_camera());
  header.mutable_header()->mutable_outputs()->set_hit_bits(!arrays);
  header.mutable_header()->mutable_outputs()->set_depths(arrays);
  header.mutable_header()->mutable_outputs()->set_object_ids(arrays);
  header.mutable_header()->mutable_outputs()->set_triangle_ids(arrays);
  auto samples = std::make_shared<std::vector<LightSample>>();
  for (uint32_t i = 0; i < lights.size(); ++i) {
    EncodeLight(lights[i], header.mutable_header()->add_lights());
    if (!AppendSamples(lights[i], i, scene->geometry.origin, samples.get()).ok()) return {};
  }
  const uint32_t across = (camera.width + kTile - 1) / kTile;
  const uint32_t down = (camera.height + kTile - 1) / kTile;
  ServiceWorkload workload{.name = name,
                           .rays = uint64_t{camera.width} * camera.height * (1 + samples->size()),
                           .items = size_t{across} * down,
                           .moves_arrays = arrays};
  const auto rect = [=](size_t item) {
    const auto x = static_cast<uint32_t>(item % across) * kTile;
    const auto y = static_cast<uint32_t>(item / across) * kTile;
    return TileRect{x, y, std::min(kTile, camera.width - x), std::min(kTile, camera.height - y)};
  };
  workload.run_engine = [=, items = workload.items](ThreadPool& pool) {
    return RunItems(pool, items, [&](size_t item, Answer* answer) -> absl::Status {
      TileResult result;
      SL_RETURN_IF_ERROR(TraceTile(
          *scene, camera, rect(item), *samples,
          {.hits = true, .ids = arrays, .depth = arrays, .lit = !samples->empty()}, {}, &result));
      const TileRect tile = rect(item);
      const Piece piece{item, 0, uint64_t{tile.width} * tile.height};
      if (!arrays) AddBits(kHits, piece, Bytes(result.hit_bits), answer);
      AddBits(kLit, piece, Bytes(result.lit_bits), answer);
      AddArray(kDepths, piece, sizeof(float), Bytes(result.depth), answer);
      std::string objects, triangles;
      if (arrays) EncodeTriangles(scene->geometry, result.triangle, &objects, &triangles);
      AddArray(kObjects, piece, sizeof(uint32_t), objects, answer);
      AddArray(kTriangles, piece, sizeof(uint32_t), triangles, answer);
      return absl::OkStatus();
    });
  };
  const auto make = [=](size_t item) {
    const TileRect tile = rect(item);
    v1::TraceTilesRequest request;
    request.mutable_item()->mutable_item()->set_item_id(item);
    request.mutable_item()->set_x(tile.x);
    request.mutable_item()->set_y(tile.y);
    request.mutable_item()->set_width(tile.width);
    request.mutable_item()->set_height(tile.height);
    return request;
  };
  workload.request_bytes = make(0).ByteSizeLong();
  workload.run_service = [=, items = workload.items](const std::shared_ptr<grpc::Channel>& to) {
    return RunStream<v1::TraceTilesRequest, v1::TraceTilesResponse>(
        to, "TraceTiles", header, items, uint64_t{kTile} * kTile * (1 + samples->size()), make,
        [](const v1::TraceTilesResponse& response, Answer* answer) {
          const v1::TileResult& tile = response.reply().tile();
          const Piece piece = PieceOf(response.reply());
          AddBits(kHits, piece, tile.hit_bits(), answer);
          AddBits(kLit, piece, response.reply().shadows().lit_bits(), answer);
          AddArray(kDepths, piece, sizeof(float), tile.depths(), answer);
          AddArray(kObjects, piece, sizeof(uint32_t), tile.object_ids(), answer);
          AddArray(kTriangles, piece, sizeof(uint32_t), tile.triangle_ids(), answer);
        });
  };
  return workload;
}

// What the camera sees, as a point set of it has it.
absl::StatusOr<PreparedPoints> HitsOf(const std::shared_ptr<const Scene>& scene,
                                      const Camera& camera, ThreadPool& pool) {
  SL_ASSIGN_OR_RETURN(const std::unique_ptr<CameraPoints> points,
                      CameraPoints::Make(scene, camera, {}));
  Mutex mutex;
  absl::Status status;  // Under `mutex`.
  pool.ParallelFor(points->tiles(), 1, [&](size_t begin, size_t end) {
    TileResult scratch;
    for (size_t tile = begin; tile < end; ++tile) {
      const absl::Status traced = points->Trace(tile, nullptr, &scratch);
      MutexLock lock(mutex);
      status.Update(traced);
    }
  });
  SL_RETURN_IF_ERROR(status);
  return points->Take();
}

}  // namespace

void EncodeBenchCamera(const Camera& camera, v1::Camera* out) {
  EncodeVector(camera.eye, out->mutable_eye());
  EncodeVector(camera.right, out->mutable_right());
  EncodeVector(camera.up, out->mutable_up());
  EncodeVector(camera.forward, out->mutable_forward());
  out->set_tan_half_fov_y(camera.tan_half_fov_y);
  out->set_width(camera.width);
  out->set_height(camera.height);
}

absl::StatusOr<std::vector<ServiceWorkload>> MakeServiceWorkloads(
    std::shared_ptr<const Scene> scene, const BuiltinView& view, const ServiceSpec& spec,
    ThreadPool& pool) {
  SL_ASSIGN_OR_RETURN(const Camera camera, CameraOf(view, spec));
  SL_ASSIGN_OR_RETURN(PreparedPoints hits, HitsOf(scene, camera, pool));
  const auto points = std::make_shared<const PreparedPoints>(std::move(hits));
  std::vector<Light> lights;
  for (const Vec3d& position : view.lights) lights.push_back(Light::Point(position));
  for (const Vec3d& sun : view.suns) lights.push_back(Light::Directional(sun));
  SL_ASSIGN_OR_RETURN(const std::vector<Light> sky, SkyLights(view.up));
  std::vector<ServiceWorkload> workloads;
  workloads.push_back(Shadows("points-bits", scene, points, lights, spec, /*sums=*/false));
  workloads.push_back(Shadows("sky-sums", scene, points, sky, spec, /*sums=*/true));
  std::vector<WorldSegment> segments = RandomSegments(*scene, spec.segments);
  std::vector<StoredSegment> stored = Stored(segments, scene->geometry.origin);
  workloads.push_back(Segments("segments-bits", v1::SegmentItem::kSegmentsFieldNumber, scene,
                               std::move(segments), spec));
  workloads.push_back(Segments("segments-f32-bits", v1::SegmentItem::kSegmentsF32FieldNumber, scene,
                               std::move(stored), spec));
  workloads.push_back(Tiles("tiles-bits", scene, camera, lights, spec, /*arrays=*/false));
  workloads.push_back(Tiles("tiles-depth-ids", scene, camera, {}, spec, /*arrays=*/true));
  return workloads;
}

absl::Status MakePointSet(const std::shared_ptr<grpc::Channel>& channel, const BuiltinView& view,
                          const ServiceSpec& spec) {
  SL_ASSIGN_OR_RETURN(const Camera camera, CameraOf(view, spec));
  v1::CreatePointSetRequest request;
  request.mutable_header()->set_parent(absl::StrCat("scenes/", spec.scene_id));
  request.mutable_header()->set_point_set_id(spec.point_set_id);
  EncodeBenchCamera(camera, request.mutable_header()->mutable_camera()->mutable_camera());
  request.mutable_header()->mutable_lease_duration()->set_seconds(24 * 3600);
  const auto stub = v1::PointSetService::NewStub(channel);
  grpc::ClientContext context;
  v1::PointSet set;
  const auto writer = stub->CreatePointSet(&context, &set);
  writer->Write(request);
  writer->WritesDone();
  const grpc::Status status = writer->Finish();
  if (status.ok()) return absl::OkStatus();
  return absl::Status(static_cast<absl::StatusCode>(status.error_code()), status.error_message());
}

}  // namespace sightline::bench
