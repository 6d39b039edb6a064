// SPDX-License-Identifier: Apache-2.0
//
// The picture of a run: on the left latency by percentile, from the planned time and from the send
// (where the two part, requests waited); on the right the median and the 99th percentile, window by
// window. Latencies are on a logarithmic scale, percentiles by how few requests lie beyond.
//
// Thread safety: free functions.
//
//   SL_RETURN_IF_ERROR(WritePlot("run.png", measured, "hall, 200/s"));
#ifndef SIGHTLINE_CLIENT_LOAD_PLOT_H_
#define SIGHTLINE_CLIENT_LOAD_PLOT_H_

#include <string>

#include "absl/status/status.h"
#include "client/load/drawing.h"
#include "client/load/measurement.h"

namespace sightline::load {

Drawing DrawPlot(const Measurement& measured, const std::string& title);

// A PNG, or an SVG if the path ends so.
absl::Status WritePlot(const std::string& path, const Measurement& measured,
                       const std::string& title);

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_PLOT_H_
