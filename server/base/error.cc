// SPDX-License-Identifier: Apache-2.0
#include "server/base/error.h"

#include <algorithm>

#include "absl/strings/cord.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "core/base/check.h"
#include "server/base/shortened.h"

namespace sightline {
namespace {

// Of what is said back to a client, in bytes. A message travels twice in gRPC's trailers, which may
// be 8 KiB.
constexpr size_t kMaxMessageHead = 700;
constexpr size_t kMaxMessageTail = 324;
constexpr size_t kMaxTold = 200;

constexpr absl::string_view kDomain = "sightline";
constexpr absl::string_view kReasonPrefix = "ERROR_REASON_";

std::string ReasonName(v1::ErrorReason reason) {
  return std::string(absl::StripPrefix(v1::ErrorReason_Name(reason), kReasonPrefix));
}

v1::ErrorReason ReasonOfCode(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
      return v1::ERROR_REASON_INVALID_FIELD;
    case absl::StatusCode::kResourceExhausted:
      return v1::ERROR_REASON_LIMIT_EXCEEDED;
    case absl::StatusCode::kAlreadyExists:
      return v1::ERROR_REASON_ALREADY_EXISTS;
    case absl::StatusCode::kCancelled:
      return v1::ERROR_REASON_CANCELLED;
    case absl::StatusCode::kDeadlineExceeded:
      return v1::ERROR_REASON_DEADLINE_EXCEEDED;
    case absl::StatusCode::kAborted:
      return v1::ERROR_REASON_SCENE_BUSY;
    case absl::StatusCode::kUnavailable:
      return v1::ERROR_REASON_DRAINING;
    default:
      return v1::ERROR_REASON_INTERNAL;
  }
}

std::string ToldMessage(const absl::Status& status) {
  return ShortenedWithin(status.message(), kMaxMessageHead, kMaxMessageTail);
}

bool ReadInfo(const absl::Status& status, v1::ErrorInfo* info) {
  const std::optional<absl::Cord> payload = [&] {
    auto found = status.GetPayload(kErrorInfoUrl);
    return found.has_value() ? std::optional<absl::Cord>(*found) : std::nullopt;
  }();
  return payload.has_value() && info->ParseFromString(std::string(*payload));
}

}  // namespace

absl::Status MakeError(absl::StatusCode code, v1::ErrorReason reason, absl::string_view message,
                       const ErrorMetadata& metadata) {
  SIGHTLINE_CHECK(code != absl::StatusCode::kOk) << message;
  return WithReason(absl::Status(code, message), reason, metadata);
}

absl::Status WithReason(absl::Status status, v1::ErrorReason reason,
                        const ErrorMetadata& metadata) {
  if (status.ok() || status.GetPayload(kErrorInfoUrl).has_value()) return status;
  v1::ErrorInfo info;
  info.set_reason(ReasonName(reason));
  info.set_domain(std::string(kDomain));
  for (const auto& [key, value] : metadata) {
    (*info.mutable_metadata())[key] = Shortened(value, kMaxTold);
  }
  status.SetPayload(kErrorInfoUrl, absl::Cord(info.SerializeAsString()));
  return status;
}

absl::Status InvalidFieldText(absl::string_view field, absl::string_view value,
                              absl::string_view remedy, v1::ErrorReason reason) {
  const std::string shown = value.empty() ? "(empty)" : Shortened(value, kMaxTold);
  return MakeError(absl::StatusCode::kInvalidArgument, reason,
                   absl::StrCat(field, " = ", shown, ": ", remedy),
                   {{"field", std::string(field)}, {"value", std::string(value)}});
}

absl::Status BadSequence(absl::string_view field, absl::string_view remedy) {
  return MakeError(absl::StatusCode::kInvalidArgument, v1::ERROR_REASON_BAD_SEQUENCE,
                   absl::StrCat(field, ": ", remedy), {{"field", std::string(field)}});
}

absl::Status OverLimit(absl::string_view what, uint64_t value, absl::string_view limit,
                       uint64_t limit_value, absl::string_view remedy, v1::ErrorReason reason) {
  return MakeError(absl::StatusCode::kResourceExhausted, reason,
                   absl::StrCat(what, " = ", value, " is over the limit ", limit, " = ",
                                limit_value, ": ", remedy),
                   {{"limit", std::string(limit)},
                    {"limit_value", absl::StrCat(limit_value)},
                    {"value", absl::StrCat(value)}});
}

absl::Status WithRetryDelay(absl::Status status, absl::Duration delay) {
  const int64_t nanos = absl::ToInt64Nanoseconds(
      std::clamp(delay, absl::Duration(absl::Milliseconds(1)), absl::Duration(absl::Minutes(1))));
  v1::RetryInfo info;
  info.mutable_retry_delay()->set_seconds(nanos / 1'000'000'000);
  info.mutable_retry_delay()->set_nanos(static_cast<int32_t>(nanos % 1'000'000'000));
  status.SetPayload(kRetryInfoUrl, absl::Cord(info.SerializeAsString()));
  return status;
}

v1::ErrorReason ReasonOf(const absl::Status& status) {
  if (status.ok()) return v1::ERROR_REASON_UNSPECIFIED;
  v1::ErrorInfo info;
  v1::ErrorReason reason;
  if (ReadInfo(status, &info) &&
      v1::ErrorReason_Parse(absl::StrCat(kReasonPrefix, info.reason()), &reason)) {
    return reason;
  }
  return ReasonOfCode(status.code());
}

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const absl::Status full = WithReason(status, ReasonOfCode(status.code()));
  const std::string message = ToldMessage(full);
  v1::Status details;
  details.set_code(full.raw_code());
  details.set_message(message);
  google::protobuf::Any* any = details.add_details();
  any->set_type_url(std::string(kErrorInfoUrl));
  any->set_value(std::string(*full.GetPayload(kErrorInfoUrl)));
  if (const auto retry = full.GetPayload(kRetryInfoUrl); retry.has_value()) {
    any = details.add_details();
    any->set_type_url(std::string(kRetryInfoUrl));
    any->set_value(std::string(*retry));
  }
  return grpc::Status(static_cast<grpc::StatusCode>(full.code()), message,
                      details.SerializeAsString());
}

void ToItemStatus(const absl::Status& status, v1::ItemStatus* out) {
  out->Clear();
  if (status.ok()) return;
  out->set_code(status.raw_code());
  out->set_reason(ReasonOf(status));
  out->set_message(ToldMessage(status));
  v1::ErrorInfo info;
  if (ReadInfo(status, &info)) *out->mutable_metadata() = info.metadata();
  v1::RetryInfo retry;
  if (const auto payload = status.GetPayload(kRetryInfoUrl);
      payload.has_value() && retry.ParseFromString(std::string(*payload))) {
    out->mutable_retry_delay()->Swap(retry.mutable_retry_delay());
  }
}

}  // namespace sightline
