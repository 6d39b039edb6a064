// SPDX-License-Identifier: Apache-2.0
#include "server/stream/shadow_method.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/result_codec.h"

namespace sightline {

// The prepared points of an item: its own, or a range of a set.
struct ShadowMethod::Points {
  std::shared_ptr<const PreparedPoints> points;
  size_t offset = 0, count = 0;
  uint64_t near_surface = 0;  // Of inline points.
};

class ShadowMethod::ShadowWork final : public ShadowMethod::Work {
 public:
  ShadowWork(const ShadowMethod& method, std::shared_ptr<const Scene> scene,
             std::shared_ptr<const SampleSet> samples, Points points, std::vector<PartRange> parts)
      : Work(std::move(scene), std::move(parts)),
        method_(method),
        samples_(std::move(samples)),
        points_(std::move(points)) {}

  absl::Status RunPart(size_t part, const CancelToken& cancel, Response* response,
                       QueryStats* stats) override {
    const PartRange range = parts()[part];
    const PointRange points =
        PointRange::Slice(*points_.points, points_.offset + range.offset, range.count);
    const v1::ShadowOutputs& wanted = method_.outputs_;
    QueryOptions options = method_.options_.query;
    options.cancel = &cancel;
    ShadowResult result;
    SL_RETURN_IF_ERROR(ComputeShadows(scene(), points, *samples_, method_.shadow_options_,
                                      DecodeShadowOutputs(wanted), options, &result));
    stats->Add(result.stats);
    EncodeShadows(scene().geometry, result, points.valid, samples_->samples, wanted,
                  response->mutable_reply()->mutable_shadows());
    return absl::OkStatus();
  }

  void Complete(Response* response) override {
    response->mutable_reply()->mutable_shadows()->set_near_surface_point_count(
        points_.near_surface);
  }

 private:
  const ShadowMethod& method_;
  const std::shared_ptr<const SampleSet> samples_;
  const Points points_;
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

uint64_t ShadowMethod::Rays(const Item& item) const {
  return RayCount(item.has_point_set_range() ? item.point_set_range().count()
                                             : item.points().points().size() / sizeof(Vec3d),
                  sample_count());
}

absl::StatusOr<ShadowMethod::Points> ShadowMethod::FindPoints(
    const Item& item, const std::shared_ptr<const Scene>& scene, const CancelToken& cancel) const {
  switch (item.source_case()) {
    case Item::SOURCE_NOT_SET:
      return InvalidField("item.source", "(unset)", "must be points or point_set_range");
    case Item::kPoints: {
      DecodedPoints decoded;
      SL_RETURN_IF_ERROR(AppendPoints("item.points", item.points(), &decoded));
      SL_ASSIGN_OR_RETURN(const std::vector<uint32_t> sources, decoded.Sources(scene->geometry));
      SL_ASSIGN_OR_RETURN(PreparedPoints prepared,
                          PreparePoints(*scene, {decoded.positions, decoded.normals, sources},
                                        point_options_, &cancel));
      const size_t count = prepared.size();
      const uint64_t near_surface = prepared.near_surface;
      return Points{std::make_shared<const PreparedPoints>(std::move(prepared)), 0, count,
                    near_surface};
    }
    case Item::kPointSetRange:
      break;
  }
  const v1::PointSetRange& range = item.point_set_range();
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
  return Points{std::shared_ptr<const PreparedPoints>(view.set, &view.set->points), range.offset(),
                range.count(), 0};
}

absl::StatusOr<std::unique_ptr<ShadowMethod::Work>> ShadowMethod::Prepare(
    const Item& item, const CancelToken& cancel, uint64_t part_rays) const {
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, pin_->ForItem());
  SL_ASSIGN_OR_RETURN(std::shared_ptr<const SampleSet> samples, lights_->For(scene));
  SL_ASSIGN_OR_RETURN(Points points, FindPoints(item, scene, cancel));
  const uint64_t sample_count = samples->samples.size();
  SL_ASSIGN_OR_RETURN(
      std::vector<PartRange> parts,
      CutIntoParts(points.count, 1, sample_count, part_rays, env_.limits,
                   [&](uint64_t n) { return ShadowBytes(outputs_, n, sample_count); }));
  return std::unique_ptr<Work>(new ShadowWork(*this, std::move(scene), std::move(samples),
                                              std::move(points), std::move(parts)));
}

}  // namespace sightline
