// SPDX-License-Identifier: Apache-2.0
#include "server/stream/item_reply.h"

#include <algorithm>

namespace sightline {
namespace {

constexpr int kReply = v1::TraceTilesResponse::kReplyFieldNumber;
static_assert(v1::ComputeShadowsResponse::kReplyFieldNumber == kReply);
static_assert(v1::TestSegmentsResponse::kReplyFieldNumber == kReply);
constexpr int kHeader = v1::TileReply::kHeaderFieldNumber;
static_assert(v1::ShadowReply::kHeaderFieldNumber == kHeader);
static_assert(v1::SegmentReply::kHeaderFieldNumber == kHeader);

}  // namespace

void ItemReply::AddFields(int field, const google::protobuf::MessageLite& fields) {
  const auto result = std::find_if(results_.begin(), results_.end(),
                                   [&](const auto& each) { return each.first == field; });
  if (result != results_.end()) return result->second.AddFields(fields);
  WireMessage message;
  message.AddFields(fields);
  Add(field, std::move(message));
}

grpc::ByteBuffer ReplyBytes(const v1::ReplyHeader& header, ItemReply reply) {
  WireMessage message;
  message.AddMessage(kHeader, header);
  for (auto& result : reply.results_) {
    message.AddMessage(result.first, std::move(result.second));
  }
  WireMessage response;
  response.AddMessage(kReply, std::move(message));
  return response.Finish();
}

grpc::ByteBuffer MessageBytes(const google::protobuf::MessageLite& message) {
  WireMessage bytes;
  bytes.AddFields(message);
  return bytes.Finish();
}

}  // namespace sightline
