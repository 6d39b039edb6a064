// SPDX-License-Identifier: Apache-2.0
//
// What this process takes of the machine, as Prometheus' standard process_ metrics want it.
//
// Thread safety: functions only.
//
//   const ProcessUsage usage = MeasureProcess();
#ifndef SIGHTLINE_SERVER_METRICS_PROCESS_USAGE_H_
#define SIGHTLINE_SERVER_METRICS_PROCESS_USAGE_H_

#include <cstdint>

namespace sightline {

struct ProcessUsage {
  double cpu_seconds = 0;  // User and system.
  uint64_t resident_bytes = 0;
  uint64_t open_descriptors = 0, max_descriptors = 0;
  uint64_t threads = 0;
};

// From /proc; what cannot be read (no descriptor left to read it with) is 0.
ProcessUsage MeasureProcess();

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_PROCESS_USAGE_H_
