// SPDX-License-Identifier: Apache-2.0
//
// One unanswered item of a visibility stream.
//
// Thread safety: plain data, guarded by the stream's lock, except the token (safe by itself) and
// `work` (constant once prepared).
#ifndef SIGHTLINE_SERVER_STREAM_STREAM_ITEM_H_
#define SIGHTLINE_SERVER_STREAM_STREAM_ITEM_H_

#include <grpcpp/alarm.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "core/base/cancel.h"
#include "core/query/options.h"
#include "server/admission/ray_queue.h"
#include "server/admission/scheduler.h"
#include "server/base/error.h"
#include "server/codec/result_codec.h"
#include "server/stream/item_reply.h"
#include "server/stream/item_work.h"

namespace sightline {

template <typename Method>
struct StreamItem {
  explicit StreamItem(const CancelToken* stream_token) : token(stream_token) {}

  uint64_t id = 0;
  uint64_t cost = 0;  // Taken off the stream's credit.
  RayTicket ticket;   // Its share of the server's queue.
  int32_t priority = 0;
  uint64_t sequence = 0;
  uint64_t to_come = 0;           // Rays announced to the scheduler, of tasks not yet added.
  typename Method::Item request;  // Emptied once prepared.
  CancelToken token;
  std::chrono::steady_clock::time_point arrival;
  std::unique_ptr<grpc::Alarm> deadline_alarm;

  std::unique_ptr<ItemWork> work;  // Once prepared.
  uint64_t queue_nanos = 0;
  bool started = false;       // Some task of it has begun.
  uint64_t tasks_left = 1;    // Waiting or running: first the preparation, then the parts.
  uint64_t replies_left = 0;  // Of the work, not yet filled.
  // The last reply, while a part that shared in it is not yet through, and what it holds.
  std::optional<ItemReply> last;
  PartRange last_range;
  absl::Status status;  // The first thing that went wrong.
  QueryStats stats;
  bool closed = false;  // Its last reply is in the outbox.

  // The token stops what runs; `passed` answers for what still waits. Called with whether it has.
  void SetDeadline(absl::Duration timeout, std::function<void(bool)> passed) {
    token.set_deadline(arrival + absl::ToChronoNanoseconds(timeout));
    deadline_alarm = std::make_unique<grpc::Alarm>();
    deadline_alarm->Set(std::chrono::system_clock::now() + absl::ToChronoMicroseconds(timeout),
                        std::move(passed));
  }
  // A task of it begins.
  void Begin() {
    if (std::exchange(started, true)) return;
    const std::chrono::nanoseconds waited = std::chrono::steady_clock::now() - arrival;
    queue_nanos = static_cast<uint64_t>(waited.count());
  }
  TaskKey Key(uint64_t part) const {
    return {.negative_priority = -priority, .sequence = sequence, .part = part};
  }
};

// Of a reply with the elements of `range`.
template <typename Method>
v1::ReplyHeader HeaderOf(const StreamItem<Method>& item, const PartRange& range) {
  v1::ReplyHeader header;
  header.set_item_id(item.id);
  header.set_offset(range.offset);
  header.set_element_count(range.count);
  header.set_revision(item.work == nullptr ? 0 : static_cast<int64_t>(item.work->revision()));
  return header;
}

// Of its last reply, which says how it went.
template <typename Method>
v1::ReplyHeader LastHeaderOf(const StreamItem<Method>& item, bool statistics) {
  v1::ReplyHeader header = HeaderOf(item, item.last_range);
  header.set_last(true);
  ToItemStatus(item.status, header.mutable_status());
  if (statistics) EncodeStatistics(item.stats, item.queue_nanos, header.mutable_statistics());
  return header;
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_STREAM_ITEM_H_
