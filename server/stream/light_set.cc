// SPDX-License-Identifier: Apache-2.0
#include "server/stream/light_set.h"

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

}  // namespace sightline
