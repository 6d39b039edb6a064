// SPDX-License-Identifier: Apache-2.0
//
// Whether the gRPC port is alive, as a client sees it: a new connection is made and a call of the
// standard health service answered over it. A connection kept from before would not do: gRPC's own
// listener can die (CVE-2023-4785) while old connections go on.
//
// The probe has no certificate and no token, so it announces by which address it will come, and the
// server lets that one connection in for a health check. For a Unix socket it takes an abstract
// address of its own.
//
// Thread safety: functions only; blocks, so not on a gRPC thread.
//
//   const absl::Status alive = CheckAlive(bound_address, absl::Seconds(2), announcement);
#ifndef SIGHTLINE_SERVER_METRICS_LIVENESS_H_
#define SIGHTLINE_SERVER_METRICS_LIVENESS_H_

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/net/socket_address.h"

namespace sightline {

// Told of the probe's own address before it connects, and after it has gone.
struct ProbeAnnouncement {
  std::function<void(const std::string&address)> begin, end;
};

// OK when the call was answered, whatever the health; else what went wrong, within `timeout`.
absl::Status CheckAlive(const SocketAddress& server, absl::Duration timeout,
                        const ProbeAnnouncement& announcement);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_LIVENESS_H_
