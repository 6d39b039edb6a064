// SPDX-License-Identifier: Apache-2.0
#include "client/lib/relighting.h"

#include <algorithm>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/lib/new_id.h"
#include "client/lib/query_run.h"

namespace sightline::client {
Relighting::Relighting(const Client& client, Source source, const StreamOptions& stream)
    : client_(client), source_(std::move(source)), stream_(stream), lights_(source_.lights) {}

absl::StatusOr<std::unique_ptr<Relighting>> Relighting::Make(const Client& client, Source source,
                                                             const StreamOptions& stream) {
  if (source.lights.empty()) {
    return absl::InvalidArgumentError("a relit picture needs a light that moves; lights is empty");
  }
  std::unique_ptr<Relighting> picture(new Relighting(client, std::move(source), stream));
  const Source& of = picture->source_;
  const StreamOptions begun = Begun(stream);
  const std::string id = NewId("relighting");
  picture->point_set_ = absl::StrCat(of.scene, "/pointSets/", id);
  absl::StatusOr<PointSet> set =
      client.CreatePointSet({.scene = of.scene,
                             .point_set_id = id,
                             .revision = of.options.revision,
                             .lease = of.lease,
                             .camera = of.camera,
                             .options = of.options},
                            {.deadline = begun.deadline, .cancellation = begun.cancellation});
  if (!set.ok()) {
    // One that was given up may be there all the same, and goes with the picture.
    if (!absl::IsCancelled(set.status()) && !absl::IsDeadlineExceeded(set.status())) {
      picture->point_set_.clear();
    }
    return set.status();
  }
  picture->point_set_ = set->name;
  for (const Light& light : picture->lights_) {
    absl::StatusOr<std::vector<uint8_t>> lit = picture->Ask(light, begun);
    if (!lit.ok()) return lit.status();
    picture->lit_.push_back(*std::move(lit));
  }
  picture->base_.resize(size_t{of.camera.width} * of.camera.height);
  picture->chosen_ = static_cast<uint32_t>(picture->lights_.size() - 1);
  picture->SumBase();
  return picture;
}

Relighting::~Relighting() {
  if (point_set_.empty()) return;
  // Nothing more can be done about a failure here: the lease ends by itself.
  client_.DeletePointSet(point_set_, {.deadline = absl::Now() + absl::Seconds(10)}).IgnoreError();
}

absl::Status Relighting::Choose(uint32_t light) {
  if (light >= lights_.size()) {
    return absl::InvalidArgumentError(absl::StrCat("light ", light, " is to move, but there are ",
                                                   lights_.size(), ", numbered from 0"));
  }
  if (light == chosen_) return absl::OkStatus();
  chosen_ = light;
  SumBase();
  return absl::OkStatus();
}

absl::Status Relighting::Move(const Light& light) {
  const StreamOptions begun = Begun(stream_);
  const absl::StatusOr<PointSet> renewed = client_.RenewLease(
      point_set_, source_.lease, {.deadline = begun.deadline, .cancellation = begun.cancellation});
  if (!renewed.ok()) return renewed.status();
  absl::StatusOr<std::vector<uint8_t>> lit = Ask(light, begun);
  if (!lit.ok()) return lit.status();
  lights_[chosen_] = light;
  lit_[chosen_] = *std::move(lit);
  color_ = base_;
  AddTo(chosen_, &color_);
  return absl::OkStatus();
}

absl::StatusOr<std::vector<uint8_t>> Relighting::Ask(const Light& light,
                                                     const StreamOptions& stream) {
  absl::StatusOr<Shadows> shadows = client_.ComputeAllShadows({.scene = source_.scene,
                                                               .lights = {light},
                                                               .point_set = point_set_,
                                                               .options = source_.options},
                                                              stream);
  if (!shadows.ok()) return shadows.status();
  summary_ = shadows->summary;
  return std::move(shadows->lit);
}

void Relighting::AddTo(uint32_t light, std::vector<double>* sums) const {
  const std::vector<uint8_t>& lit = lit_[light];
  const size_t pixels = sums->size(), samples = lit.size() / std::max<size_t>(1, pixels);
  const double share = lights_[light].weight / static_cast<double>(std::max<size_t>(1, samples));
  for (size_t s = 0; s < samples; ++s) {
    for (size_t i = 0; i < pixels; ++i) {
      if (lit[s * pixels + i] == 1) (*sums)[i] += share;
    }
  }
}

void Relighting::SumBase() {
  std::fill(base_.begin(), base_.end(), 0.0);
  for (uint32_t light = 0; light < lights_.size(); ++light) {
    if (light != chosen_) AddTo(light, &base_);
  }
  color_ = base_;
  AddTo(chosen_, &color_);
}

}  // namespace sightline::client
