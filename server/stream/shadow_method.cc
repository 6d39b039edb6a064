// SPDX-License-Identifier: Apache-2.0
#include "server/stream/shadow_method.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/query/point_order.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/result_codec.h"
#include "server/stream/item_points.h"
#include "server/stream/shadow_chunk.h"

namespace sightline {

// Which points each part computes, and which reply they go into.
struct ShadowMethod::Plan {
  // A run of points with a reply of its own; in several parts if it has a chunk, else one part.
  struct Run {
    PartRange points;
    std::unique_ptr<ShadowChunk> chunk;
  };
  std::vector<Run> runs;
  std::vector<PartRange> parts;
  std::vector<std::pair<size_t, size_t>> of_part;  // Its run, and its number within that.

  // `orders`, where it is not null, has those of the points from `begin` on.
  void Add(const PartRange& points, size_t part_points, const PointOrders* orders = nullptr,
           size_t begin = 0) {
    Run run{.points = points, .chunk = nullptr};
    if (orders != nullptr || part_points < points.count) {
      run.chunk = std::make_unique<ShadowChunk>(points.count, part_points, orders, begin);
    }
    for (size_t k = 0; k * part_points < points.count; ++k) {
      parts.push_back({points.offset + k * part_points,
                       std::min<uint64_t>(part_points, points.count - k * part_points)});
      of_part.emplace_back(runs.size(), k);
    }
    runs.push_back(std::move(run));
  }
};

class ShadowMethod::ShadowWork final : public ItemWork {
 public:
  ShadowWork(const ShadowMethod& method, std::shared_ptr<const Scene> scene,
             std::shared_ptr<const SampleSet> samples, std::unique_ptr<ItemPoints> points,
             Plan plan)
      : ItemWork(std::move(scene), std::move(plan.parts), plan.runs.size()),
        method_(method),
        samples_(std::move(samples)),
        points_(std::move(points)),
        runs_(std::move(plan.runs)),
        of_part_(std::move(plan.of_part)) {}

  absl::StatusOr<PartRange> RunPart(size_t part, const CancelToken& cancel, ItemReply* reply,
                                    QueryStats* stats) override {
    const auto [index, within] = of_part_[part];
    const Plan::Run& run = runs_[index];
    const uint64_t begin = run.points.offset, count = run.points.count;
    const PointRange points = points_->Range(begin, count);
    const v1::ShadowOutputs& wanted = method_.outputs_;
    const ShadowOutputs outputs = DecodeShadowOutputs(wanted);
    const QueryOptions options = PartOptions(method_.options_.query, cancel);
    const auto compute = [&](const PointRange& some, ShadowHints* hints, ShadowResult* result) {
      ShadowOptions shadow = method_.shadow_options_;
      shadow.ordered = run.chunk != nullptr;
      shadow.hints = hints;
      return ComputeShadows(scene(), some, *samples_, shadow, outputs, options, result);
    };
    PreparedPoints placed;
    ShadowResult result;
    if (run.chunk == nullptr) {
      SL_ASSIGN_OR_RETURN(const PointRange ready, points_->Place(begin, count, &cancel, &placed));
      ShadowHints hints = TakeHints();
      SL_RETURN_IF_ERROR(compute(ready, &hints, &result));
      LeaveHints(std::move(hints));
      stats->Add(result.stats);
    } else {
      const auto compute_places = [&](std::span<const uint32_t> places, ShadowHints* hints,
                                      ShadowResult* some) -> absl::Status {
        SL_ASSIGN_OR_RETURN(const PointRange ready,
                            points_->Place(begin, places, &cancel, &placed));
        return compute(ready, hints, some);
      };
      SL_ASSIGN_OR_RETURN(const bool last,
                          run.chunk->RunPart(within, points, samples_->samples.size(), outputs,
                                             compute_places, &result, stats));
      if (!last) return PartRange();
    }
    reply->Add(v1::ShadowReply::kShadowsFieldNumber,
               EncodeShadows(scene().geometry, std::move(result), points.valid, samples_->samples,
                             wanted));
    return run.points;
  }

  void Complete(ItemReply* reply) override {
    v1::ShadowResult whole;
    whole.set_near_surface_point_count(points_->near_surface());
    reply->AddFields(v1::ShadowReply::kShadowsFieldNumber, whole);
  }

 private:
  // What the parts before left for those that come as neighbours.
  ShadowHints TakeHints() {
    MutexLock lock(mutex_);
    return hints_;
  }
  void LeaveHints(ShadowHints hints) {
    MutexLock lock(mutex_);
    hints_ = std::move(hints);
  }

  const ShadowMethod& method_;
  const std::shared_ptr<const SampleSet> samples_;
  const std::unique_ptr<ItemPoints> points_;
  const std::vector<Plan::Run> runs_;
  const std::vector<std::pair<size_t, size_t>> of_part_;
  Mutex mutex_;
  ShadowHints hints_ ABSL_GUARDED_BY(mutex_);
};

absl::StatusOr<std::unique_ptr<ShadowMethod>> ShadowMethod::Open(const Header& header,
                                                                 const QueryEnvironment& env) {
  std::unique_ptr<ShadowMethod> method(new ShadowMethod(env));
  SL_ASSIGN_OR_RETURN(method->options_, DecodeOptions(header.stream().options()));
  SL_ASSIGN_OR_RETURN(method->lights_, LightSet::Open(header.lights(), env.limits));
  if (method->sample_count() == 0) {
    return InvalidField("header.lights", "(empty)", "needs at least one light");
  }
  SL_ASSIGN_OR_RETURN(method->point_options_, DecodePointOptions(header.point_options()));
  if (!(header.t_min() >= 0 && header.t_min() < 1)) {
    return InvalidField("header.t_min", header.t_min(), "must be at least 0 and less than 1");
  }
  method->shadow_options_.t_min = header.t_min();
  method->outputs_ = WantedShadows(header.outputs());
  SL_RETURN_IF_ERROR(method->OpenScene(header.stream()));
  return method;
}

std::span<const WirePath> ShadowMethod::ArrayPaths() {
  using Arrays = v1::PointArrays;
  constexpr int kItem = Request::kItemFieldNumber, kPoints = v1::ShadowItem::kPointsFieldNumber;
  static constexpr std::array<WirePath, 4> kPaths = {
      {{kItem, kPoints, Arrays::kPointsFieldNumber},
       {kItem, kPoints, Arrays::kSourceObjectsFieldNumber},
       {kItem, kPoints, Arrays::kSourceTrianglesFieldNumber},
       {kItem, kPoints, Arrays::kNormalsFieldNumber}}};
  return kPaths;
}

absl::Status ShadowMethod::Read(grpc::ByteBuffer* bytes, const ElementLimit& elements,
                                Request* request, Item* item) {
  std::array<WireArray, 4> arrays;
  SL_RETURN_IF_ERROR(ReadRequest(bytes, ArrayPaths(), elements, request, arrays));
  if (!request->has_item()) return absl::OkStatus();
  item->message = std::move(*request->mutable_item());
  if (!item->message.has_points()) return absl::OkStatus();
  v1::PointArrays& points = *item->message.mutable_points();
  item->points = {
      .points = ArrayOf(std::move(arrays[0]), points.mutable_points()),
      .source_objects = ArrayOf(std::move(arrays[1]), points.mutable_source_objects()),
      .source_triangles = ArrayOf(std::move(arrays[2]), points.mutable_source_triangles()),
      .normals = ArrayOf(std::move(arrays[3]), points.mutable_normals())};
  return absl::OkStatus();
}

uint64_t ShadowMethod::Rays(const Item& item) const {
  const v1::ShadowItem& message = item.message;
  return RayCount(message.has_point_set_range() ? message.point_set_range().count()
                                                : item.points.points.size() / sizeof(Vec3d),
                  sample_count());
}

absl::StatusOr<std::unique_ptr<ItemPoints>> ShadowMethod::FindPoints(
    const Item& item, const std::shared_ptr<const Scene>& scene, const CancelToken& cancel) const {
  switch (item.message.source_case()) {
    case v1::ShadowItem::SOURCE_NOT_SET:
      return InvalidField("item.source", "(unset)", "must be points or point_set_range");
    case v1::ShadowItem::kPoints: {
      DecodedPoints decoded;
      SL_RETURN_IF_ERROR(AppendPoints("item.points", item.points, &decoded));
      return ItemPoints::Own(*scene, std::move(decoded), point_options_, placement_pace_.get(),
                             &cancel);
    }
    case v1::ShadowItem::kPointSetRange:
      break;
  }
  const v1::PointSetRange& range = item.message.point_set_range();
  SL_ASSIGN_OR_RETURN(const PointSetName name,
                      ParsePointSetName("item.point_set_range.point_set", range.point_set()));
  if (name.scene_id != pin_->scene_id()) {
    return InvalidField("item.point_set_range.point_set", range.point_set(),
                        absl::StrCat("the stream is about ", SceneName(pin_->scene_id())));
  }
  SL_ASSIGN_OR_RETURN(const PointSetView view,
                      env_.point_sets.Get(name.scene_id, name.point_set_id));
  if (view.set->scene.lock() != scene) {
    return MakeError(absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_REVISION_MISMATCH,
                     absl::StrCat(range.point_set(), " belongs to revision ", view.set->revision,
                                  ", the item sees revision ", scene->revision),
                     {{"resource", range.point_set()},
                      {"value", absl::StrCat(view.set->revision)},
                      {"current", absl::StrCat(scene->revision)}});
  }
  const uint64_t size = view.set->points.size();
  if (range.count() == 0) {
    return InvalidField("item.point_set_range.count", 0, "must be at least 1");
  }
  if (range.offset() >= size || range.count() > size - range.offset()) {
    return InvalidField(
        "item.point_set_range.count", range.count(),
        absl::StrCat("from ", range.offset(), " on leaves the set, which has ", size, " points"));
  }
  return ItemPoints::OfSet(view.set, range.offset(), range.count());
}

// Runs are long where their points have to be ordered, since they are ordered within a run.
absl::StatusOr<ShadowMethod::Plan> ShadowMethod::MakePlan(const ItemPoints& points,
                                                          uint64_t samples,
                                                          uint64_t part_rays) const {
  if (points.wants_placing()) {
    part_rays = std::min(part_rays, RayCount(placement_pace_->MostPoints(), samples));
  }
  const auto bytes = [&](uint64_t n) { return ShadowBytes(outputs_, n, samples); };
  const auto cut = [&](uint64_t count, uint64_t rays) {
    return CutIntoParts(count, 1, samples, rays, env_.limits, bytes);
  };
  SL_ASSIGN_OR_RETURN(
      const std::vector<PartRange> runs,
      cut(points.size(), std::max(part_rays, RayCount(ShadowChunk::kMostPoints, samples))));
  Plan plan;
  for (const PartRange& run : runs) {
    if (points.orders() != nullptr && run.count >= kLeastOrderedPoints) {
      plan.Add(run, ShadowChunk::PartPoints(part_rays, samples), points.orders(),
               points.offset() + run.offset);
      continue;
    }
    const PointRange slice = points.Range(run.offset, run.count);
    if (OrderingPays(slice.positions, slice.valid, samples)) {
      plan.Add(run, ShadowChunk::PartPoints(part_rays, samples));
      continue;
    }
    SL_ASSIGN_OR_RETURN(const std::vector<PartRange> parts, cut(run.count, part_rays));
    for (const PartRange& part : parts)
      plan.Add({run.offset + part.offset, part.count}, part.count);
  }
  return plan;
}

absl::StatusOr<std::unique_ptr<ItemWork>> ShadowMethod::Prepare(const Item& item,
                                                                const CancelToken& cancel,
                                                                uint64_t part_rays) const {
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, pin_->ForItem());
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const SampleSet> samples, lights_->For(scene));
  SL_ASSIGN_OR_RETURN(std::unique_ptr<ItemPoints> points, FindPoints(item, scene, cancel));
  SL_ASSIGN_OR_RETURN(Plan plan, MakePlan(*points, samples->samples.size(), part_rays));
  return std::unique_ptr<ItemWork>(new ShadowWork(*this, std::move(scene), std::move(samples),
                                                  std::move(points), std::move(plan)));
}

}  // namespace sightline
