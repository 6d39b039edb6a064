// SPDX-License-Identifier: Apache-2.0
//
// How the service's errors look to a caller of the library: an absl::Status with the server's code
// and message, and its machine-readable reason as a payload (a google.rpc.ErrorInfo under that
// type's URL).
//
// Thread safety: free functions.
//
//   if (std::optional<ErrorDetail> detail = GetErrorDetail(status)) Log(detail->reason);
#ifndef SIGHTLINE_CLIENT_LIB_STATUS_H_
#define SIGHTLINE_CLIENT_LIB_STATUS_H_

#include <grpcpp/support/status.h>

#include <map>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "sightline/v1/status.pb.h"

namespace sightline::client {

struct ErrorDetail {
  std::string reason;  // The name of a v1.ErrorReason without its prefix: "QUEUE_FULL".
  std::map<std::string, std::string> metadata;
};

// The URL under which the reason is kept (absl::Status::GetPayload).
inline constexpr char kErrorInfoUrl[] = "type.googleapis.com/google.rpc.ErrorInfo";
inline constexpr char kRetryInfoUrl[] = "type.googleapis.com/google.rpc.RetryInfo";

absl::Status FromGrpc(const grpc::Status& status);
absl::Status FromItem(const v1::ItemStatus& status);

// The reason, where the server gave one.
std::optional<ErrorDetail> GetErrorDetail(const absl::Status& status);

// Whether the same call may succeed later: UNAVAILABLE; RESOURCE_EXHAUSTED when the queue was full
// or the server says when to try again. Any other limit passed never heals.
bool IsRetryable(const absl::Status& status);

// How long the server asked to wait, where it did.
std::optional<absl::Duration> RetryDelay(const absl::Status& status);

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_STATUS_H_
