// SPDX-License-Identifier: Apache-2.0
//
// Errors with a machine-readable reason: an absl::Status whose payload is a google.rpc.ErrorInfo,
// and the one place where such a status becomes a gRPC status or the status of an item.
//
// Invariants: the domain is always "sightline"; a status without a reason gets one by its code on
// the way out, so that no error leaves without. No value is told back in more than 200 bytes, and
// no message leaves with more than 1,024 (and how many there were), of its beginning and of its
// end, where cause and remedy stand.
//
// Thread safety: functions only.
//
//   return InvalidField("item.width", item.width(), "must be 1 .. 1920, the camera's width");
//   return WithReason(registry.Delete(name), v1::ERROR_REASON_SCENE_NOT_FOUND, {{"resource",
//   name}}); reactor->Finish(ToGrpcStatus(status));
#ifndef SIGHTLINE_SERVER_BASE_ERROR_H_
#define SIGHTLINE_SERVER_BASE_ERROR_H_

#include <grpcpp/support/status.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "sightline/v1/status.pb.h"

namespace sightline {

using ErrorMetadata = std::vector<std::pair<std::string, std::string>>;

// The payloads' keys, and the type URLs in gRPC details.
inline constexpr absl::string_view kErrorInfoUrl = "type.googleapis.com/google.rpc.ErrorInfo";
inline constexpr absl::string_view kRetryInfoUrl = "type.googleapis.com/google.rpc.RetryInfo";

// REQUIRES: code is not OK.
absl::Status MakeError(absl::StatusCode code, v1::ErrorReason reason, absl::string_view message,
                       const ErrorMetadata& metadata = {});

// `status` with a reason, where it is an error without one.
absl::Status WithReason(absl::Status status, v1::ErrorReason reason,
                        const ErrorMetadata& metadata = {});

// INVALID_ARGUMENT, "<field> = <value>: <remedy>".
absl::Status InvalidFieldText(absl::string_view field, absl::string_view value,
                              absl::string_view remedy,
                              v1::ErrorReason reason = v1::ERROR_REASON_INVALID_FIELD);
template <typename T>
absl::Status InvalidField(absl::string_view field, const T& value, absl::string_view remedy,
                          v1::ErrorReason reason = v1::ERROR_REASON_INVALID_FIELD) {
  return InvalidFieldText(field, absl::StrCat(value), remedy, reason);
}

// INVALID_ARGUMENT (BAD_SEQUENCE), "<field>: <remedy>".
absl::Status BadSequence(absl::string_view field, absl::string_view remedy);

// RESOURCE_EXHAUSTED, "<what> = <value> is over the limit <limit> = <limit_value>: <remedy>".
absl::Status OverLimit(absl::string_view what, uint64_t value, absl::string_view limit,
                       uint64_t limit_value, absl::string_view remedy,
                       v1::ErrorReason reason = v1::ERROR_REASON_LIMIT_EXCEEDED);

// `status`, which is an error, with word that it may be tried again after `delay`: made at least a
// millisecond (a client must not spin) and at most a minute (nobody knows further ahead).
absl::Status WithRetryDelay(absl::Status status, absl::Duration delay);

// The reason in the payload, or the one that stands for the code.
v1::ErrorReason ReasonOf(const absl::Status& status);

grpc::Status ToGrpcStatus(const absl::Status& status);
// OK leaves `out` empty.
void ToItemStatus(const absl::Status& status, v1::ItemStatus* out);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_BASE_ERROR_H_
