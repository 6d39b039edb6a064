// SPDX-License-Identifier: Apache-2.0
//
// One unanswered item of a visibility stream, and the key by which waiting work is ordered.
//
// Thread safety: plain data, guarded by the stream's lock, except the token (safe by itself) and
// `work` (constant once prepared).
#ifndef SIGHTLINE_SERVER_STREAM_STREAM_ITEM_H_
#define SIGHTLINE_SERVER_STREAM_STREAM_ITEM_H_

#include <grpcpp/alarm.h>

#include <chrono>
#include <compare>
#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "core/base/cancel.h"
#include "core/query/options.h"
#include "server/admission/ray_queue.h"

namespace sightline {

// Higher priority first, then order of arrival, then parts in order.
struct TaskKey {
  int32_t negative_priority = 0;
  uint64_t sequence = 0;
  uint64_t part = 0;  // 0: decode and prepare; k + 1: part k.

  // clang-tidy 14 takes a 0 within the defaulted comparison for a pointer.
  // NOLINTNEXTLINE(modernize-use-nullptr)
  friend auto operator<=>(const TaskKey&, const TaskKey&) = default;
};

template <typename Method>
struct StreamItem {
  explicit StreamItem(const CancelToken* stream_token) : token(stream_token) {}

  uint64_t id = 0;
  uint64_t cost = 0;  // Taken off the stream's credit.
  RayTicket ticket;   // Its share of the server's queue.
  int32_t priority = 0;
  uint64_t sequence = 0;
  typename Method::Item request;  // Emptied once prepared.
  CancelToken token;
  std::chrono::steady_clock::time_point arrival;
  std::unique_ptr<grpc::Alarm> deadline_alarm;

  std::unique_ptr<typename Method::Work> work;  // Once prepared.
  uint64_t queue_nanos = 0;
  bool started = false;     // Some task of it has begun.
  uint64_t tasks_left = 1;  // Waiting or running: first the preparation, then the parts.
  absl::Status status;      // The first thing that went wrong.
  QueryStats stats;
  bool closed = false;  // Its last reply is in the outbox.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_STREAM_ITEM_H_
