// SPDX-License-Identifier: Apache-2.0
//
// The way of an item through the server, without the server: the wire's messages are decoded by its
// codec, answered by core, encoded again and read as any client reads them.
#include "client/load/reference.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/lib/query_wire.h"
#include "core/base/status_macros.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "server/base/limits.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/query_codec.h"
#include "server/codec/result_codec.h"
#include "server/codec/wire_message.h"

namespace sightline::load {
namespace {

QueryOptions Options(const CancelToken* cancel) {
  return {.strategy = Strategy::kSingle, .cancel = cancel};
}

absl::Status Read(const WireMessage& encoded, google::protobuf::MessageLite* message) {
  if (message->ParseFromString(encoded.ToString())) return absl::OkStatus();
  return absl::InternalError(absl::StrCat("what was encoded is no ", message->GetTypeName()));
}

template <typename Reply>
std::vector<Reply> Whole(Reply reply, uint64_t elements) {
  reply.mutable_header()->set_element_count(elements);
  reply.mutable_header()->set_last(true);
  return {std::move(reply)};
}

absl::StatusOr<Answer> TileAnswer(const Scene& scene, const client::TileQuery& query,
                                  const client::TileRect& rect, const CancelToken* cancel) {
  const v1::TraceTilesHeader header = client::TilesHeader(query, 0);
  SL_ASSIGN_OR_RETURN(const Camera camera, DecodeCamera(header.camera(), Limits()));
  SL_ASSIGN_OR_RETURN(const SampleSet lights, DecodeLights(header.lights(), scene.geometry));
  TileResult result;
  SL_RETURN_IF_ERROR(TraceTile(
      scene, camera, {rect.x, rect.y, rect.width, rect.height}, lights.samples,
      {.ids = true, .depth = true, .lit = !lights.samples.empty()}, Options(cancel), &result));
  v1::TileReply reply;
  SL_RETURN_IF_ERROR(
      Read(EncodeTile(scene.geometry, result, header.outputs()), reply.mutable_tile()));
  const uint64_t pixels = uint64_t{rect.width} * rect.height;
  std::vector<uint8_t> hit(pixels);
  for (uint64_t i = 0; i < pixels; ++i) hit[i] = (result.hit_bits[i / 8] >> (i % 8)) & 1;
  ShadowResult shadows;
  shadows.lit_bits = std::move(result.lit_bits);
  SL_RETURN_IF_ERROR(Read(EncodeShadows(scene.geometry, std::move(shadows), hit, lights.samples,
                                        header.shadow_outputs()),
                          reply.mutable_shadows()));
  SL_ASSIGN_OR_RETURN(client::Tile tile,
                      client::DecodeTile(query, 0, rect, Whole(std::move(reply), pixels)));
  return ToAnswer(std::move(tile));
}

absl::StatusOr<Answer> PointsAnswer(const Scene& scene, client::ShadowQuery query, ItemRange range,
                                    const CancelToken* cancel) {
  // The points themselves, whether the server is asked by a set or not.
  query.point_set.clear();
  const v1::ComputeShadowsHeader header = client::ShadowsHeader(query, 0);
  v1::ShadowItem item;
  client::FillShadowItem(query, range.begin, range.count, &item);
  DecodedPoints decoded;
  SL_RETURN_IF_ERROR(AppendPoints("points", item.points(), &decoded));
  SL_ASSIGN_OR_RETURN(const PointOptions options, DecodePointOptions(header.point_options()));
  SL_ASSIGN_OR_RETURN(const std::vector<uint32_t> sources, decoded.Sources(scene.geometry));
  SL_ASSIGN_OR_RETURN(const PreparedPoints points,
                      PreparePoints(scene, {decoded.positions, decoded.normals, sources}, options));
  SL_ASSIGN_OR_RETURN(const SampleSet lights, DecodeLights(header.lights(), scene.geometry));
  ShadowResult result;
  SL_RETURN_IF_ERROR(ComputeShadows(scene, PointRange::All(points), lights.samples, {}, {},
                                    DecodeShadowOutputs(header.outputs()), Options(cancel),
                                    &result));
  v1::ShadowReply reply;
  SL_RETURN_IF_ERROR(Read(EncodeShadows(scene.geometry, std::move(result), points.valid,
                                        lights.samples, header.outputs()),
                          reply.mutable_shadows()));
  SL_ASSIGN_OR_RETURN(
      client::Shadows shadows,
      client::DecodeShadows(query, range.begin, range.count, Whole(std::move(reply), range.count)));
  return ToAnswer(std::move(shadows));
}

absl::StatusOr<Answer> SegmentsAnswer(const Scene& scene, const client::SegmentQuery& query,
                                      ItemRange range, const CancelToken* cancel) {
  const v1::TestSegmentsHeader header = client::SegmentsHeader(query, 0);
  v1::SegmentItem item;
  client::FillSegmentItem(query, range.begin, range.count, &item);
  std::vector<std::array<Vec3d, 2>> ends;
  SL_RETURN_IF_ERROR(DecodeSegments(item.segments(), &ends));
  PreparedSegments prepared;
  SL_RETURN_IF_ERROR(PrepareSegments(scene, ends, {}, {}, &prepared));
  SegmentResult result;
  SL_RETURN_IF_ERROR(
      TestSegments(scene, prepared, {.bits = true, .first_hits = true}, Options(cancel), &result));
  v1::SegmentReply reply;
  SL_RETURN_IF_ERROR(
      Read(EncodeSegments(scene.geometry, std::move(result), prepared.valid, header.outputs()),
           reply.mutable_segments()));
  SL_ASSIGN_OR_RETURN(client::Segments segments,
                      client::DecodeSegments(query, range.begin, range.count,
                                             Whole(std::move(reply), range.count)));
  return ToAnswer(std::move(segments));
}

}  // namespace

absl::StatusOr<Answer> EngineAnswer(const Scene& scene, const Workload& workload, const Work& work,
                                    const CancelToken* cancel) {
  switch (work.kind) {
    case Kind::kTiles: {
      const TileWork& tile = workload.tile(work.item);
      return TileAnswer(scene, workload.tile_queries()[tile.camera], tile.rect, cancel);
    }
    case Kind::kPoints:
      return PointsAnswer(scene, workload.shadow_query(), workload.points(work.item), cancel);
    case Kind::kSegments:
      break;
  }
  return SegmentsAnswer(scene, workload.segment_query(), workload.segments(work.item), cancel);
}

absl::StatusOr<std::unique_ptr<Reference>> Reference::Make(
    const std::shared_ptr<const Scene>& scene, const std::optional<ObjectInput>& extra,
    const Workload& workload, size_t stride, ThreadPool& pool, const CancelToken* cancel) {
  std::unique_ptr<Reference> reference(new Reference(std::max<size_t>(1, stride)));
  reference->states_.resize(extra ? 2 : 1);
  SL_RETURN_IF_ERROR(reference->Find(*scene, workload, pool, cancel, reference->states_.data()));
  if (extra) {
    const SceneEdit edit{.kind = SceneEdit::Kind::kAdd, .object = *extra};
    SL_ASSIGN_OR_RETURN(
        const std::shared_ptr<const Scene> edited,
        EditScene(*scene, scene->revision + 1, std::span(&edit, 1), {}, pool, cancel));
    SL_RETURN_IF_ERROR(reference->Find(*edited, workload, pool, cancel, &reference->states_[1]));
  }
  return reference;
}

std::unique_ptr<Reference> Reference::Of(Answers answers, size_t stride) {
  std::unique_ptr<Reference> reference(new Reference(std::max<size_t>(1, stride)));
  reference->states_.push_back(std::move(answers));
  return reference;
}

absl::Status Reference::Find(const Scene& scene, const Workload& workload, ThreadPool& pool,
                             const CancelToken* cancel, Answers* answers) const {
  Mutex mutex;
  absl::Status status;
  for (size_t k = 0; k < kKinds; ++k) {
    const Kind kind = static_cast<Kind>(k);
    if (workload.StreamCount(kind) == 0) continue;
    std::vector<Answer>& of_kind = (*answers)[k];
    of_kind.resize((workload.ItemCount(kind) + stride_ - 1) / stride_);
    pool.ParallelFor(
        of_kind.size(), 1,
        [&](size_t begin, size_t end) {
          for (size_t i = begin; i < end; ++i) {
            absl::StatusOr<Answer> answer =
                EngineAnswer(scene, workload, {.kind = kind, .item = i * stride_}, cancel);
            if (answer.ok()) {
              of_kind[i] = *std::move(answer);
            } else {
              MutexLock lock(mutex);
              status.Update(answer.status());
            }
          }
        },
        cancel);
    // Items that were left out have no status of their own.
    if (cancel != nullptr) status.Update(cancel->ToStatus());
  }
  return status;
}

void Reference::ExpectRevision(int64_t revision, size_t state) {
  MutexLock lock(mutex_);
  revisions_[revision] = state;
}

Verdict Reference::Judge(const Work& work, int64_t revision, const Answer& answer,
                         std::string* difference) const {
  if (!Knows(work)) return Verdict::kNotChecked;
  size_t state = 0;
  {
    MutexLock lock(mutex_);
    const auto found = revisions_.find(revision);
    if (found == revisions_.end() || found->second >= states_.size()) {
      *difference = absl::StrCat("it is of revision ", revision, ", which this test did not make");
      return Verdict::kWrong;
    }
    state = found->second;
  }
  const Answer& due = states_[state][static_cast<size_t>(work.kind)][work.item / stride_];
  *difference = Difference(due, answer);
  return difference->empty() ? Verdict::kEqual : Verdict::kWrong;
}

}  // namespace sightline::load
