// SPDX-License-Identifier: Apache-2.0
#include "server/stream/light_set.h"

#include <span>
#include <utility>

#include "core/base/status_macros.h"

namespace sightline {

absl::StatusOr<std::unique_ptr<LightSet>> LightSet::Open(const Lights& lights,
                                                         const Limits& limits) {
  SL_ASSIGN_OR_RETURN(const uint64_t samples, CheckLights(lights, limits));
  return std::unique_ptr<LightSet>(new LightSet(lights, samples));
}

absl::StatusOr<std::shared_ptr<const SampleSet>> LightSet::For(
    const std::shared_ptr<const Scene>& scene) {
  MutexLock lock(mutex_);
  if (samples_ == nullptr || scene_.lock() != scene) {
    SL_ASSIGN_OR_RETURN(SampleSet samples, DecodeLights(lights_, scene->geometry));
    samples_ = std::make_shared<const SampleSet>(std::move(samples));
    scene_ = scene;
  }
  return samples_;
}

absl::Status ComputeShadows(const Scene& scene, const PointRange& points, const SampleSet& samples,
                            const ShadowOptions& shadow, const ShadowOutputs& outputs,
                            const QueryOptions& options, ShadowResult* result) {
  std::span<const double> weights;
  if (outputs.weighted_sums) weights = samples.weights;
  return ComputeShadows(scene, points, samples.samples, weights, shadow, outputs, options, result);
}

}  // namespace sightline
