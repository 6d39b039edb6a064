// SPDX-License-Identifier: Apache-2.0
//
// A reply to an item before it has its header: the results that a part computed, whose arrays go
// out from where they are.
//
// Thread safety: one thread at a time.
//
//   ItemReply reply;
//   reply.Add(v1::TileReply::kTileFieldNumber, EncodeTile(...));
//   const grpc::ByteBuffer bytes = ReplyBytes(header, std::move(reply));
#ifndef SIGHTLINE_SERVER_STREAM_ITEM_REPLY_H_
#define SIGHTLINE_SERVER_STREAM_ITEM_REPLY_H_

#include <google/protobuf/message_lite.h>
#include <grpcpp/support/byte_buffer.h>

#include <utility>
#include <vector>

#include "server/codec/wire_message.h"
#include "sightline/v1/visibility_service.pb.h"

namespace sightline {

class ItemReply {
 public:
  // `field` is a number in TileReply, ShadowReply or SegmentReply.
  void Add(int field, WireMessage result) { results_.emplace_back(field, std::move(result)); }
  // Fields for a result that is there, or for one of its own.
  void AddFields(int field, const google::protobuf::MessageLite& fields);

 private:
  friend grpc::ByteBuffer ReplyBytes(const v1::ReplyHeader& header, ItemReply reply);
  std::vector<std::pair<int, WireMessage>> results_;
};

// The message of a stream that holds the reply: a TraceTilesResponse, ComputeShadowsResponse or
// TestSegmentsResponse, which are alike so far.
grpc::ByteBuffer ReplyBytes(const v1::ReplyHeader& header, ItemReply reply);

// A message without arrays.
grpc::ByteBuffer MessageBytes(const google::protobuf::MessageLite& message);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_ITEM_REPLY_H_
