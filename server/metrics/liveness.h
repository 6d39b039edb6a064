// SPDX-License-Identifier: Apache-2.0
//
// Whether the gRPC port is alive, as a client sees it: a new connection is made and a call of the
// standard health service answered over it. A connection kept from before would not do: gRPC's own
// listener can die (CVE-2023-4785) while old connections go on.
//
// Thread safety: functions only; blocks, so not on a gRPC thread.
//
//   const absl::Status alive = CheckAlive(bound_address, absl::Seconds(2));
#ifndef SIGHTLINE_SERVER_METRICS_LIVENESS_H_
#define SIGHTLINE_SERVER_METRICS_LIVENESS_H_

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "server/net/socket_address.h"

namespace sightline {

// OK when the call was answered, whatever the health; else what went wrong, within `timeout`.
absl::Status CheckAlive(const SocketAddress& server, absl::Duration timeout);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_LIVENESS_H_
