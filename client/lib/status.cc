// SPDX-License-Identifier: Apache-2.0
#include "client/lib/status.h"

#include "absl/strings/cord.h"
#include "absl/strings/strip.h"

namespace sightline::client {
namespace {

absl::StatusCode ToCode(int code) {
  // gRPC's codes are Abseil's; one out of range is a server's mistake.
  return code >= 0 && code <= 16 ? static_cast<absl::StatusCode>(code) : absl::StatusCode::kUnknown;
}

// What gRPC says itself is no more than the code: of a method that a server does not have, and of a
// deadline that passed here. A server's own errors have details.
std::string MessageOf(const grpc::Status& status) {
  if (status.error_code() == grpc::StatusCode::UNIMPLEMENTED && status.error_message().empty()) {
    return "the server does not know this call: it is older than this client, or not a Sightline "
           "server";
  }
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED &&
      status.error_details().empty()) {
    return "the call's own deadline passed before the server answered: give it a longer timeout";
  }
  return status.error_message();
}

}  // namespace

absl::Status FromGrpc(const grpc::Status& status) {
  if (status.ok()) return absl::OkStatus();
  absl::Status result(ToCode(status.error_code()), MessageOf(status));
  v1::Status details;
  if (!status.error_details().empty() && details.ParseFromString(status.error_details())) {
    for (const google::protobuf::Any& any : details.details()) {
      result.SetPayload(any.type_url(), absl::Cord(any.value()));
    }
  }
  return result;
}

absl::Status FromItem(const v1::ItemStatus& status) {
  if (status.code() == 0) return absl::OkStatus();
  absl::Status result(ToCode(status.code()), status.message());
  if (status.reason() != v1::ERROR_REASON_UNSPECIFIED) {
    v1::ErrorInfo info;
    info.set_domain("sightline");
    info.set_reason(
        std::string(absl::StripPrefix(v1::ErrorReason_Name(status.reason()), "ERROR_REASON_")));
    *info.mutable_metadata() = status.metadata();
    result.SetPayload(kErrorInfoUrl, absl::Cord(info.SerializeAsString()));
  }
  if (status.has_retry_delay()) {
    v1::RetryInfo retry;
    *retry.mutable_retry_delay() = status.retry_delay();
    result.SetPayload(kRetryInfoUrl, absl::Cord(retry.SerializeAsString()));
  }
  return result;
}

std::optional<ErrorDetail> GetErrorDetail(const absl::Status& status) {
  const auto payload = status.GetPayload(kErrorInfoUrl);
  v1::ErrorInfo info;
  if (!payload || !info.ParseFromString(std::string(*payload))) return std::nullopt;
  ErrorDetail detail;
  detail.reason = info.reason();
  detail.metadata.insert(info.metadata().begin(), info.metadata().end());
  return detail;
}

bool IsRetryable(const absl::Status& status) {
  if (absl::IsUnavailable(status)) return true;
  if (!absl::IsResourceExhausted(status)) return false;
  const std::optional<ErrorDetail> detail = GetErrorDetail(status);
  return (detail && (detail->reason == "QUEUE_FULL" || detail->reason == "QUOTA_EXCEEDED")) ||
         RetryDelay(status).has_value();
}

std::optional<absl::Duration> RetryDelay(const absl::Status& status) {
  const auto payload = status.GetPayload(kRetryInfoUrl);
  v1::RetryInfo retry;
  if (!payload || !retry.ParseFromString(std::string(*payload)) || !retry.has_retry_delay()) {
    return std::nullopt;
  }
  return absl::Seconds(retry.retry_delay().seconds()) +
         absl::Nanoseconds(retry.retry_delay().nanos());
}

}  // namespace sightline::client
