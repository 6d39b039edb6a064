// SPDX-License-Identifier: Apache-2.0
//
// The tracing of a camera's point set, by turns with everybody's streams: a flow of its client's
// whose tasks are a few tiles each, and rays of the queue that are counted as theirs.
//
// Invariants
//  1. At most one task more waits or runs than the scheduler has threads; each is about what a part
//     of a stream's item is. (One waits even when all threads are at it: a flow that did not wait
//     would be taken for one that has nothing to do, and what it has had would be forgotten.)
//  2. Each task holds a ticket for its rays. Who is admitted has one, and hands it on from task to
//     task until the end: so a set of any size goes on, and takes no more of the queue and of its
//     client's quota than what is under way, or what there is room for; one tile at least.
//  3. `done` is called once, with no task waiting and nothing held of the queue. Nothing waits for
//     it: the trace is kept by its tasks.
//  4. After the first failure, or a cancel, no tile begins; a walk under way sees its token.
//
// Thread safety: Admit and Start from one thread, Take after `done`.
//
//   SL_ASSIGN_OR_RETURN(std::shared_ptr<CameraTrace> trace,
//                       CameraTrace::Admit(scheduler, queue, client, std::move(points), &cancel));
//   trace->Start([trace] { pool.Submit([trace] { Use(trace->Take()); }); });
#ifndef SIGHTLINE_SERVER_POINTS_CAMERA_TRACE_H_
#define SIGHTLINE_SERVER_POINTS_CAMERA_TRACE_H_

#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/functional/any_invocable.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"
#include "core/query/points.h"
#include "server/admission/client_name.h"
#include "server/admission/ray_queue.h"
#include "server/admission/scheduler.h"
#include "server/points/camera_points.h"

namespace sightline {

class CameraTrace : public std::enable_shared_from_this<CameraTrace> {
 public:
  using Done = absl::AnyInvocable<void()>;

  // `cancel` lives until `done` is called. ResourceExhausted (QUEUE_FULL, QUOTA_EXCEEDED, with a
  // retry delay): not even a tile may wait for its turn now.
  static absl::StatusOr<std::shared_ptr<CameraTrace>> Admit(Scheduler& scheduler, RayQueue& queue,
                                                            const Client& client,
                                                            std::unique_ptr<CameraPoints> points,
                                                            const CancelToken* cancel);
  CameraTrace(const CameraTrace&) = delete;
  CameraTrace& operator=(const CameraTrace&) = delete;

  // Once. `done` runs on a thread of the scheduler's: it must neither block nor compute.
  void Start(Done done);
  // What came of it: the points, or what went wrong first. Frees them then. Once.
  absl::StatusOr<PreparedPoints> Take();

 private:
  struct Tiles {
    size_t begin = 0, end = 0;
    uint64_t rays = 0;
  };
  CameraTrace(Scheduler& scheduler, RayQueue& queue, const Client& client,
              std::unique_ptr<CameraPoints> points, const CancelToken* cancel);

  // Adds tasks, the first of them with the ticket at hand.
  void Launch(RayTicket at_hand) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // The ticket at hand, or one for as much more as there is room for, up to `wanted` rays; one of
  // no rays if there is neither.
  RayTicket TicketFor(uint64_t wanted, RayTicket at_hand);
  // The next ones: of `rays` rays at most, but one at least.
  Tiles Next(uint64_t rays) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool Run(const Tiles& tiles, RayTicket ticket);
  absl::Status Trace(const Tiles& tiles);
  void Fail(absl::Status status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  RayQueue& queue_;
  const RayAccount account_;
  const std::unique_ptr<Scheduler::Flow> flow_;
  std::unique_ptr<CameraPoints> points_;
  const size_t most_pending_;
  CancelToken token_;  // Child of the caller's.
  Mutex mutex_;
  Done done_ ABSL_GUARDED_BY(mutex_);
  RayTicket first_ ABSL_GUARDED_BY(mutex_);     // From Admit to Start.
  size_t pending_ ABSL_GUARDED_BY(mutex_) = 0;  // Tasks waiting or running.
  size_t next_tile_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t next_part_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t to_come_ ABSL_GUARDED_BY(mutex_) = 0;  // Rays announced, of tasks not yet added.
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_POINTS_CAMERA_TRACE_H_
