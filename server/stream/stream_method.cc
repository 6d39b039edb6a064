// SPDX-License-Identifier: Apache-2.0
#include "server/stream/stream_method.h"

#include <limits>

#include "core/base/status_macros.h"
#include "server/codec/query_codec.h"

namespace sightline {

absl::Status StreamMethod::OpenScene(const v1::StreamHeader& header) {
  SL_ASSIGN_OR_RETURN(pin_, ScenePin::Open(header, env_));
  SL_RETURN_IF_ERROR(CheckSceneOptions(*pin_->opened(), options_.query));
  if (lights_ != nullptr) SL_RETURN_IF_ERROR(lights_->For(pin_->opened()).status());
  opened_revision_ = pin_->opened()->revision;
  pin_->ReleaseOpened();
  return absl::OkStatus();
}

uint64_t RayCount(uint64_t elements, uint64_t rays_each) {
  constexpr uint64_t kMost = std::numeric_limits<uint64_t>::max();
  return elements > kMost / rays_each ? kMost : elements * rays_each;
}

}  // namespace sightline
