// SPDX-License-Identifier: Apache-2.0
#include "server/admission/ray_queue.h"

#include "core/base/check.h"
#include "server/base/error.h"

namespace sightline {
namespace {

bool Fits(uint64_t rays, uint64_t held, uint64_t most) {
  return held <= most && rays <= most - held;
}

}  // namespace

void RayTicket::Release() {
  if (queue_ == nullptr) return;
  std::exchange(queue_, nullptr)->Release(account_.held_.get(), rays_);
  account_ = RayAccount();
}

RayAccount RayQueue::Open(const std::string& client, uint64_t max_rays) {
  MutexLock lock(mutex_);
  // Names of clients that are gone go with the next one that comes: no more are kept than are open.
  std::erase_if(accounts_, [](const auto& entry) { return entry.second.expired(); });
  std::weak_ptr<RayAccount::Held>& entry = accounts_[client];
  std::shared_ptr<RayAccount::Held> held = entry.lock();
  if (held == nullptr) {
    held = std::make_shared<RayAccount::Held>();
    entry = held;
  }
  held->by_role = max_rays != 0;
  held->most = held->by_role ? max_rays : max_rays_per_client_;
  return RayAccount(std::move(held));
}

absl::StatusOr<RayTicket> RayQueue::Admit(const RayAccount& account, uint64_t rays) {
  MutexLock lock(mutex_);
  RayAccount::Held& held = *account.held_;
  if (held.tickets > 0 && !Fits(rays, held.rays, held.most)) {
    return OverLimit("the client's rays waiting for an answer", held.rays + rays,
                     held.by_role ? "limit rays of the access file" : "max_queued_rays_per_client",
                     held.most, "read replies, then send more", v1::ERROR_REASON_QUOTA_EXCEEDED);
  }
  if (tickets_ > 0 && !Fits(rays, queued_, max_rays_)) {
    return OverLimit("rays waiting for an answer", queued_ + rays, "max_queued_rays", max_rays_,
                     "send it again after the retry delay", v1::ERROR_REASON_QUEUE_FULL);
  }
  queued_ += rays;
  ++tickets_;
  held.rays += rays;
  ++held.tickets;
  return RayTicket(this, account, rays);
}

uint64_t RayQueue::queued_rays() const {
  MutexLock lock(mutex_);
  return queued_;
}

void RayQueue::Release(RayAccount::Held* held, uint64_t rays) {
  MutexLock lock(mutex_);
  SIGHTLINE_CHECK(tickets_ > 0 && queued_ >= rays) << "a ticket was given back twice";
  queued_ -= rays;
  --tickets_;
  held->rays -= rays;
  --held->tickets;
}

}  // namespace sightline
