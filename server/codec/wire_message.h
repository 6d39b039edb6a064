// SPDX-License-Identifier: Apache-2.0
//
// A message on its way out whose large arrays stay where they were computed: protobuf writes what
// is small, every array becomes a slice of its own beside it. What a reader gets are the bytes of
// one ordinary message.
//
// Invariants: fields are written in the order in which they were added; a repeated Add of one
// field is, as in every protobuf message, its merge.
//
// Thread safety: one thread at a time.
//
//   WireMessage result;
//   result.AddArray(v1::TileResult::kDepthsFieldNumber, WireArray(std::move(depths)));
//   WireMessage reply;
//   reply.AddMessage(v1::TileReply::kTileFieldNumber, std::move(result));
//   const grpc::ByteBuffer bytes = reply.Finish();
//
// The wire format: protobuf.dev/programming-guides/encoding.
#ifndef SIGHTLINE_SERVER_CODEC_WIRE_MESSAGE_H_
#define SIGHTLINE_SERVER_CODEC_WIRE_MESSAGE_H_

#include <google/protobuf/message_lite.h>
#include <grpcpp/support/byte_buffer.h>

#include <cstddef>
#include <string>
#include <vector>

#include "server/codec/wire_array.h"

namespace sightline {

class WireMessage {
 public:
  // Below so many bytes an array is copied beside what is small: a slice costs more.
  static constexpr size_t kLeastShared = 4096;

  // A field of type bytes; none if the array is empty.
  void AddArray(int field, const WireArray& array);
  // A field of a message type, present even if it is empty.
  void AddMessage(int field, const google::protobuf::MessageLite& message);
  void AddMessage(int field, WireMessage message);
  // The fields of a message that has the same type as this one.
  void AddFields(const google::protobuf::MessageLite& message);

  // In bytes.
  size_t size() const { return size_; }
  // What gRPC sends.
  grpc::ByteBuffer Finish() const;
  // As one run of bytes, for those who want the message here.
  std::string ToString() const;

 private:
  // Small bytes, then a shared slice; either may be empty.
  struct Part {
    std::string small;
    grpc::Slice shared;
  };
  void AddHead(int field, size_t bytes);
  std::string& Small();

  std::vector<Part> parts_;
  size_t size_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_WIRE_MESSAGE_H_
