// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/slow_query_log.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "server/base/log.h"

namespace sightline {
namespace {

std::string Milliseconds(std::chrono::nanoseconds time) {
  return absl::StrFormat("%.3f", std::chrono::duration<double, std::milli>(time).count());
}

}  // namespace

void SlowQueryLog::Write(const SlowQuery& query) {
  const ItemRecord& record = query.record;
  const QueryStats& stats = record.stats;
  Log(LogLevel::kWarning, "slow_query",
      {{"method", std::string(OperationName(record.operation))},
       {"scene", std::string(query.scene)},
       {"revision", absl::StrCat(query.revision)},
       {"item", absl::StrCat(query.item_id)},
       {"peer", std::string(query.peer)},
       {"status", absl::StatusCodeToString(record.code)},
       {"total_ms", Milliseconds(record.total)},
       {"queue_ms", Milliseconds(record.queue)},
       {"compute_ms", Milliseconds(std::chrono::nanoseconds(stats.compute_nanoseconds))},
       {"cost_rays", absl::StrCat(query.cost_rays)},
       {"rays", absl::StrCat(stats.rays)},
       {"strategy", std::string(StrategyName(stats.strategy))},
       {"nodes", absl::StrCat(stats.nodes)},
       {"leaves", absl::StrCat(stats.leaves)},
       {"triangle_tests", absl::StrCat(stats.triangle_tests)},
       {"exact_tests", absl::StrCat(stats.doubt_exact)}});
}

}  // namespace sightline
