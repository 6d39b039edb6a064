// SPDX-License-Identifier: Apache-2.0
//
// A server's own metrics, read over HTTP in Prometheus' text format before and after a run. The
// difference of its counters stands beside what the client saw.
//
// Errors: UNAVAILABLE (no connection, or an HTTP status that is not 200), RESOURCE_EXHAUSTED (more
// than 64 MiB), INVALID_ARGUMENT (a line that is not of the format, by its number).
//
// Thread safety: free functions; the first call of ReadMetrics initializes libcurl and must not run
// beside other first uses of it.
//
//   SL_ASSIGN_OR_RETURN(Metrics before, ReadMetrics("127.0.0.1:9090"));
#ifndef SIGHTLINE_CLIENT_LOAD_SERVER_METRICS_H_
#define SIGHTLINE_CLIENT_LOAD_SERVER_METRICS_H_

#include <map>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace sightline::load {

// Samples by name and labels as they were written: `sightline_requests_total{result="ok"}`.
using Metrics = std::map<std::string, double>;

absl::StatusOr<Metrics> ParseMetrics(absl::string_view text);

// `where` is a URL, or HOST:PORT, which stands for http://HOST:PORT/metrics.
std::string MetricsUrl(const std::string& where);
// `token` is shown to the server unless it is empty. The environment's proxy (http_proxy) is used
// for other machines alone.
absl::StatusOr<Metrics> ReadMetrics(const std::string& where, const std::string& token = "",
                                    absl::Duration timeout = absl::Seconds(5));
// The token of --metrics-token-file = `path`, to be shown at `where`; none if `path` is empty.
// A usage error where it would go to another machine in the clear, and what LoadToken returns.
absl::StatusOr<std::string> MetricsToken(const std::string& path, const std::string& where);

struct MetricChange {
  double before = 0, after = 0;
};
// Every sample of `after` that is not of `before`, or has another value; Go's, the process's and
// histograms' buckets left out.
std::map<std::string, MetricChange> ChangedMetrics(const Metrics& before, const Metrics& after);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_SERVER_METRICS_H_
