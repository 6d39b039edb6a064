// SPDX-License-Identifier: Apache-2.0
#include "server/points/camera_trace.h"

#include <algorithm>
#include <utility>

#include "absl/time/time.h"
#include "core/base/status_macros.h"
#include "core/query/tile_result.h"
#include "server/base/error.h"
#include "server/base/memory_guard.h"

namespace sightline {

CameraTrace::CameraTrace(Scheduler& scheduler, RayQueue& queue, const Client& client,
                         std::unique_ptr<CameraPoints> points, const CancelToken* cancel)
    : queue_(queue),
      account_(queue.Open(client.name, client.limits.rays)),
      flow_(scheduler.Open(client.name)),
      points_(std::move(points)),
      most_pending_(static_cast<size_t>(scheduler.threads()) + 1),
      token_(cancel) {}

absl::StatusOr<std::shared_ptr<CameraTrace>> CameraTrace::Admit(
    Scheduler& scheduler, RayQueue& queue, const Client& client,
    std::unique_ptr<CameraPoints> points, const CancelToken* cancel) {
  std::shared_ptr<CameraTrace> trace(
      new CameraTrace(scheduler, queue, client, std::move(points), cancel));
  const uint64_t rays = trace->points_->rays();
  // The least that goes on, so that no set takes its client beyond a quota which holds that much.
  absl::StatusOr<RayTicket> ticket =
      queue.Admit(trace->account_, std::min(rays, CameraPoints::kTileRays));
  if (!ticket.ok()) {
    // By then the server will have answered about as much as this set asks for.
    return WithRetryDelay(ticket.status(), absl::FromChrono(scheduler.TimeFor(rays)));
  }
  MutexLock lock(trace->mutex_);
  trace->first_ = *std::move(ticket);
  return trace;
}

void CameraTrace::Start(Done done) {
  MutexLock lock(mutex_);
  done_ = std::move(done);
  to_come_ = points_->rays();
  flow_->Announce(to_come_);
  Launch(std::move(first_));
}

absl::StatusOr<PreparedPoints> CameraTrace::Take() {
  MutexLock lock(mutex_);
  const std::unique_ptr<CameraPoints> points = std::move(points_);
  if (!status_.ok()) return status_;
  return points->Take();
}

void CameraTrace::Launch(RayTicket at_hand) {
  while (next_tile_ < points_->tiles() && pending_ < most_pending_) {
    RayTicket ticket = TicketFor(std::min(flow_->PartRays(), to_come_), std::move(at_hand));
    if (ticket.rays() == 0) return;
    const Tiles tiles = Next(ticket.rays());
    ++pending_;
    to_come_ -= tiles.rays;
    flow_->Add({.part = next_part_++}, tiles.rays,
               [self = shared_from_this(), tiles, ticket = std::move(ticket)]() mutable {
                 return self->Run(tiles, std::move(ticket));
               });
  }
}

RayTicket CameraTrace::TicketFor(uint64_t wanted, RayTicket at_hand) {
  const uint64_t least = std::min(wanted, CameraPoints::kTileRays);
  for (uint64_t rays = wanted; rays >= least && rays > at_hand.rays(); rays /= 2) {
    absl::StatusOr<RayTicket> ticket = queue_.Admit(account_, rays);
    if (ticket.ok()) return *std::move(ticket);
  }
  return at_hand;
}

CameraTrace::Tiles CameraTrace::Next(uint64_t rays) {
  Tiles tiles{.begin = next_tile_, .end = next_tile_};
  do {
    tiles.rays += points_->RaysOf(tiles.end++);
  } while (tiles.end < points_->tiles() && tiles.rays + points_->RaysOf(tiles.end) <= rays);
  next_tile_ = tiles.end;
  return tiles;
}

bool CameraTrace::Run(const Tiles& tiles, RayTicket ticket) {
  absl::Status status = GuardMemory([&] { return Trace(tiles); });
  const bool traced = status.ok();
  Done done;
  {
    MutexLock lock(mutex_);
    --pending_;
    if (!traced) Fail(std::move(status));
    if (status_.ok()) Launch(std::move(ticket));
    ticket.Release();  // Unless it was handed on.
    if (pending_ == 0) done = std::move(done_);
  }
  if (done != nullptr) done();
  return traced;
}

absl::Status CameraTrace::Trace(const Tiles& tiles) {
  TileResult scratch;
  for (size_t tile = tiles.begin; tile < tiles.end; ++tile) {
    SL_RETURN_IF_ERROR(token_.ToStatus());
    SL_RETURN_IF_ERROR(points_->Trace(tile, &token_, &scratch));
  }
  return absl::OkStatus();
}

void CameraTrace::Fail(absl::Status status) {
  if (!status_.ok()) return;
  status_ = std::move(status);
  token_.Cancel();
  pending_ -= flow_->Drop(0, 0);
  flow_->Withdraw(std::exchange(to_come_, 0));
}

}  // namespace sightline
