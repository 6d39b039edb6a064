// SPDX-License-Identifier: Apache-2.0
//
// The slow-query log: one line of the structured log for every item that took longer than the
// operator wants to know of, with what it asked for, where its time went and what was culled.
//
// Thread safety: constant after construction.
//
//   SlowQueryLog slow(absl::Seconds(1));
//   if (slow.Wants(total)) slow.Write({...});
//   // level=warning event=slow_query method=TraceTiles scene=hall revision=3 item=17 status=OK ...
#ifndef SIGHTLINE_SERVER_METRICS_SLOW_QUERY_LOG_H_
#define SIGHTLINE_SERVER_METRICS_SLOW_QUERY_LOG_H_

#include <chrono>
#include <cstdint>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "server/metrics/metrics.h"

namespace sightline {

struct SlowQuery {
  const ItemRecord& record;
  absl::string_view scene, peer;
  uint64_t revision = 0, item_id = 0, cost_rays = 0;
};

class SlowQueryLog {
 public:
  // Infinite: nothing is logged.
  explicit SlowQueryLog(absl::Duration threshold)
      : threshold_(threshold == absl::InfiniteDuration() ? std::chrono::nanoseconds::max()
                                                         : absl::ToChronoNanoseconds(threshold)) {}

  bool Wants(std::chrono::nanoseconds total) const { return total >= threshold_; }
  static void Write(const SlowQuery& query);

 private:
  const std::chrono::nanoseconds threshold_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_SLOW_QUERY_LOG_H_
