// SPDX-License-Identifier: Apache-2.0
//
// A run as people and programs read it.
//
//   text   a page; latencies in milliseconds, from the planned time and from the send
//   JSON   everything, one object; latencies in milliseconds, rates per second, shares from 0 to 1
//   CSV    a line per window, and one, "all", for the whole run
//
// Thread safety: free functions.
//
//   PrintReport(report, "json", out);
#ifndef SIGHTLINE_CLIENT_LOAD_REPORT_H_
#define SIGHTLINE_CLIENT_LOAD_REPORT_H_

#include <array>
#include <map>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

#include "client/lib/types.h"
#include "client/load/check_source.h"
#include "client/load/knee.h"
#include "client/load/measurement.h"
#include "client/load/options.h"
#include "client/load/reloader.h"
#include "client/load/server_metrics.h"
#include "client/load/slo.h"
#include "client/load/stability.h"

namespace sightline::load {

inline constexpr std::array<double, 6> kReportedPercentiles = {50, 90, 95, 99, 99.9, 99.99};

struct LoadReport {
  const LoadOptions* options = nullptr;
  client::Capabilities server;
  std::string scene_name;
  uint64_t triangles = 0;
  size_t streams = 0;
  double rate = 0;           // Asked for, of an open loop.
  bool interrupted = false;  // Cut short: what there is, is what was measured by then.
  CheckSource check;
  Measurement measured;
  Stability stability;
  std::vector<SloResult> slo;
  std::optional<Knee> knee;
  std::optional<ReloadReport> reloads;
  std::map<std::string, MetricChange> server_metrics;
  std::string server_metrics_error;

  // A search that was interrupted has trials, and no run of its own.
  bool measured_nothing() const { return interrupted && measured.all.requests == 0; }
};

// "open loop, poisson, 600/s" or "closed loop, 8 at once".
std::string LoopText(const LoadReport& report);

// `output`: text, json or csv. A page for people; one JSON object; or a header and a line for each
// window and one for all, whose columns README lists: new ones come behind those that there are.
void PrintReport(const LoadReport& report, const std::string& output, std::ostream& out);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_REPORT_H_
