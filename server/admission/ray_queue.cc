// SPDX-License-Identifier: Apache-2.0
#include "server/admission/ray_queue.h"

#include "core/base/check.h"
#include "server/base/error.h"

namespace sightline {

void RayTicket::Release() {
  if (queue_ != nullptr) std::exchange(queue_, nullptr)->Release(rays_);
}

absl::StatusOr<RayTicket> RayQueue::Admit(uint64_t rays) {
  MutexLock lock(mutex_);
  if (tickets_ > 0 && (queued_ > max_rays_ || rays > max_rays_ - queued_)) {
    return OverLimit("rays waiting for an answer", queued_ + rays, "max_queued_rays", max_rays_,
                     v1::ERROR_REASON_QUEUE_FULL);
  }
  queued_ += rays;
  ++tickets_;
  return RayTicket(this, rays);
}

uint64_t RayQueue::queued_rays() const {
  MutexLock lock(mutex_);
  return queued_;
}

void RayQueue::Release(uint64_t rays) {
  MutexLock lock(mutex_);
  SIGHTLINE_CHECK(tickets_ > 0 && queued_ >= rays) << "a ticket was given back twice";
  queued_ -= rays;
  --tickets_;
}

}  // namespace sightline
