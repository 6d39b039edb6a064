// SPDX-License-Identifier: Apache-2.0
#include "server/stream/scene_pin.h"

#include <chrono>
#include <utility>

#include "absl/time/clock.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/query_codec.h"

namespace sightline {

absl::StatusOr<std::unique_ptr<ScenePin>> ScenePin::Open(const v1::StreamHeader& header,
                                                         const QueryEnvironment& env) {
  SL_ASSIGN_OR_RETURN(std::string scene_id, ParseSceneName("header.stream.scene", header.scene()));
  if (header.revision() < 0) {
    return InvalidField("header.stream.revision", header.revision(), "must not be negative");
  }
  const absl::Duration most = absl::Seconds(env.limits.max_pin_seconds);
  SL_ASSIGN_OR_RETURN(
      const absl::Duration duration,
      DecodeDuration("header.stream.max_pin_duration", header.has_max_pin_duration(),
                     header.max_pin_duration(), most, most));
  const auto revision = static_cast<uint64_t>(header.revision());
  std::unique_ptr<ScenePin> pin(new ScenePin(env.scenes, std::move(scene_id), revision));
  SL_ASSIGN_OR_RETURN(pin->opened_, env.scenes.PinTagged(pin->scene_id_, revision, &pin->tag_));
  if (revision != 0) {
    {
      MutexLock lock(pin->held_->mutex);
      pin->held_->scene = pin->opened_;
    }
    pin->expiry_.Set(absl::ToChronoTime(absl::Now() + duration), [held = pin->held_](bool) {
      std::shared_ptr<const Scene> gone;
      MutexLock lock(held->mutex);
      gone.swap(held->scene);
    });
  }
  return pin;
}

absl::StatusOr<std::shared_ptr<const Scene>> ScenePin::ForItem() const {
  if (revision_ == 0) return scenes_.Pin(scene_id_, revision_);
  {
    MutexLock lock(held_->mutex);
    if (held_->scene != nullptr) return held_->scene;
  }
  return scenes_.PinOf(scene_id_, revision_, tag_);
}

}  // namespace sightline
