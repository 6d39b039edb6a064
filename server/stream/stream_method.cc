// SPDX-License-Identifier: Apache-2.0
#include "server/stream/stream_method.h"

#include <grpc/grpc.h>

#include <algorithm>
#include <limits>
#include <string>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/log.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/query_codec.h"

namespace sightline {
namespace {

// `what` is it that waited, `for_what` its client was to do, and what else helps.
absl::Status StallError(const Limits& limits, absl::string_view what, absl::string_view for_what) {
  const std::string seconds = absl::StrCat(limits.max_stream_stall_seconds);
  return MakeError(absl::StatusCode::kDeadlineExceeded, v1::ERROR_REASON_DEADLINE_EXCEEDED,
                   absl::StrCat("this ", what, " has waited for max_stream_stall = ", seconds,
                                " s for its client ", for_what),
                   {{"limit", "max_stream_stall"}, {"limit_value", seconds}});
}

}  // namespace

absl::Status StreamMethod::OpenScene(const v1::StreamHeader& header) {
  SL_ASSIGN_OR_RETURN(pin_, ScenePin::Open(header, env_));
  SL_RETURN_IF_ERROR(CheckSceneOptions(*pin_->opened(), options_.query));
  if (lights_ != nullptr) SL_RETURN_IF_ERROR(lights_->For(pin_->opened()).status());
  opened_revision_ = pin_->opened()->revision;
  pin_->ReleaseOpened();
  return absl::OkStatus();
}

uint64_t RayCount(uint64_t elements, uint64_t rays_each) {
  constexpr uint64_t kMost = std::numeric_limits<uint64_t>::max();
  return elements > kMost / rays_each ? kMost : elements * rays_each;
}

absl::Status CheckItemRays(uint64_t rays, const Limits& limits) {
  if (rays <= limits.max_item_rays) return absl::OkStatus();
  return OverLimit("item rays", rays, "max_item_rays", limits.max_item_rays,
                   "cut the item into smaller ones");
}

uint64_t MostUnanswered(const Limits& limits) {
  return (limits.stream_credit_rays + limits.min_item_cost_rays - 1) / limits.min_item_cost_rays;
}

ElementLimit MostElements(const Limits& limits) {
  const uint64_t most = 2 * (limits.max_lights + MostUnanswered(limits)) + 1024;
  return {most,
          [&limits, most](const google::protobuf::FieldDescriptor& field,
                          uint64_t count) -> absl::Status {
            if (field.message_type() == v1::Light::descriptor()) {
              SL_RETURN_IF_ERROR(CheckLightCount(count, limits));
            } else if (field.containing_type() == v1::CancelItems::descriptor()) {
              SL_RETURN_IF_ERROR(CheckCancelled(count, limits));
            }
            return TooManyElements(field, count, most);
          }};
}

uint64_t ItemCost(uint64_t rays, uint64_t message_bytes, const Limits& limits) {
  return std::max({rays, limits.min_item_cost_rays, message_bytes / kBytesPerRay});
}

absl::Status CheckCancelled(uint64_t ids, const Limits& limits) {
  const uint64_t most = MostUnanswered(limits);
  if (ids <= most) return absl::OkStatus();
  return InvalidField("cancel.item_ids", absl::StrCat(ids, " ids"),
                      absl::StrCat("may be ", most, ", as many as a stream has unanswered items"));
}

absl::Status CreditError(uint64_t item_id, int64_t credit, size_t unanswered,
                         const Limits& limits) {
  return MakeError(
      absl::StatusCode::kResourceExhausted, v1::ERROR_REASON_CREDIT_EXCEEDED,
      absl::StrCat("item ", item_id, " was sent without credit: all of stream_credit_rays = ",
                   limits.stream_credit_rays, " is taken by ", unanswered,
                   " unanswered items; read their last replies first"),
      {{"limit", "stream_credit_rays"},
       {"limit_value", absl::StrCat(limits.stream_credit_rays)},
       {"value", absl::StrCat(credit)}});
}

absl::Status ItemExpiredError(uint64_t item_id) {
  return MakeError(absl::StatusCode::kDeadlineExceeded, v1::ERROR_REASON_DEADLINE_EXCEEDED,
                   absl::StrCat("the timeout of item ", item_id, " passed"));
}

absl::Status ItemCancelledError(uint64_t item_id) {
  return MakeError(absl::StatusCode::kCancelled, v1::ERROR_REASON_CANCELLED,
                   absl::StrCat("item ", item_id, " was cancelled"));
}

absl::Status CallCancelledError() {
  return MakeError(absl::StatusCode::kCancelled, v1::ERROR_REASON_CANCELLED,
                   "the client cancelled the call, or is gone");
}

absl::Status CallExpiredError() {
  return MakeError(absl::StatusCode::kDeadlineExceeded, v1::ERROR_REASON_DEADLINE_EXCEEDED,
                   "the call's deadline passed; allow more time or ask for less");
}

absl::Status StreamStallError(const Limits& limits) {
  return StallError(limits, "stream",
                    "to take a reply or grant result credit enough for the next: read what is "
                    "sent, keep fewer items on their way, or have the server wait longer "
                    "(--max-stream-stall-seconds) or send shorter replies (--target-reply-bytes)");
}

absl::Status WatchStallError(const Limits& limits) {
  return StallError(limits, "watch of a scene",
                    "to take what it is told: read what is sent, watch again to hear how the scene "
                    "is by then, or have the server wait longer (--max-stream-stall-seconds)");
}

void LogFailure(absl::string_view peer, const absl::Status& status) {
  Log(LogLevel::kInfo, "stream_failed",
      {{"peer", std::string(peer)},
       {"status", status.ToString(absl::StatusToStringMode::kWithNoExtraData)}});
}

void CutOff(grpc::CallbackServerContext* context, const absl::Status& status) {
  grpc_call_cancel_with_status(context->c_call(), static_cast<grpc_status_code>(status.code()),
                               std::string(status.message()).c_str(), nullptr);
}

}  // namespace sightline
