// SPDX-License-Identifier: Apache-2.0
//
// What is kept of an item once it is answered, or will never be: its share of the metrics, and a
// line in the slow-query log.
//
// Thread safety: functions only; called with the stream's lock held.
//
//   ReportItem(env, *context, *method, *item);
#ifndef SIGHTLINE_SERVER_STREAM_ITEM_REPORT_H_
#define SIGHTLINE_SERVER_STREAM_ITEM_REPORT_H_

#include <grpcpp/server_context.h>

#include <chrono>

#include "absl/status/status.h"
#include "server/metrics/metrics.h"
#include "server/metrics/slow_query_log.h"
#include "server/stream/query_environment.h"
#include "server/stream/stream_item.h"

namespace sightline {

template <typename Method>
void ReportItem(const QueryEnvironment& env, const grpc::ServerContextBase& context,
                const Method& method, const StreamItem<Method>& item) {
  if (env.metrics == nullptr) return;
  ItemRecord record;
  record.operation = Method::kOperation;
  record.code = item.status.code();
  record.total = std::chrono::steady_clock::now() - item.arrival;
  // What never began waited all its life.
  record.queue = item.started ? std::chrono::nanoseconds(item.queue_nanos) : record.total;
  record.stats = item.stats;
  env.metrics->RecordItem(record);
  if (env.slow_queries == nullptr || !env.slow_queries->Wants(record.total)) return;
  SlowQueryLog::Write({.record = record,
                       .scene = method.scene_id(),
                       .peer = context.peer(),
                       .revision = item.work == nullptr ? 0 : item.work->revision(),
                       .item_id = item.id,
                       .cost_rays = item.cost});
}

// The items of a stream that ends with `status`, those that nobody will hear of.
template <typename Method, typename Items>
void ReportLost(const QueryEnvironment& env, const grpc::ServerContextBase& context,
                const Method& method, const Items& items, const absl::Status& status) {
  for (const auto& [id, item] : items) {
    if (item->closed) continue;
    if (item->status.ok()) item->status = status;
    ReportItem(env, context, method, *item);
  }
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_ITEM_REPORT_H_
