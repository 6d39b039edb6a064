// SPDX-License-Identifier: Apache-2.0
//
// A message on its way in, read without copying its large arrays: a scan over the slices that it
// came in finds them, and protobuf reads all the rest. Where an array is not plain to the scan (a
// field on the way to it comes twice, or beside another of its oneof) protobuf reads that, too:
// what a message means is always protobuf's word.
//
// Two bytes of a message may become seventy of memory: an unknown field, which protobuf keeps, or
// an element of a repeated field. So the scan drops the unknown ones, which nobody reads, and
// counts the elements before anything is made of them. What is left is no more than the message's
// bytes and a fixed part for itself and for each element.
//
// Errors are INVALID_ARGUMENT for bytes that are no message of the type, and what an ElementLimit
// says of too many elements: which of its fields those are, and how many.
//
// Thread safety: functions only.
//
//   constexpr std::array<WirePath, 1> kPaths = {{{2, 2}}};   // item.segments
//   std::array<WireArray, 1> arrays;
//   SL_RETURN_IF_ERROR(ReadRequest(&buffer, kPaths, {.most = 1000}, &request, arrays));
//   if (arrays[0].empty()) arrays[0] = WireArray(std::move(*request.mutable_item()->...));
//
// The wire format: protobuf.dev/programming-guides/encoding.
#ifndef SIGHTLINE_SERVER_CODEC_WIRE_REQUEST_H_
#define SIGHTLINE_SERVER_CODEC_WIRE_REQUEST_H_

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "absl/status/status.h"
#include "server/codec/wire_array.h"

namespace sightline {

// The numbers of the fields on the way to a field of type bytes, from the top; zeros behind them.
using WirePath = std::array<int, 3>;

// Arrays of fewer bytes are copied. The slices that an array lies in may hold others' bytes before
// its first and behind its last, kMaxReadSlice each (server.cc): so whoever keeps an array keeps at
// most three times as much as it was sent.
inline constexpr size_t kLeastLifted = 256 << 10;
inline constexpr size_t kMaxReadSlice = 256 << 10;

// How many elements a message may have, those of all its repeated fields together.
struct ElementLimit {
  uint64_t most = 0;
  // The error for a message of more, `count` of them in the field that has most of them. Null:
  // INVALID_ARGUMENT.
  std::function<absl::Status(const google::protobuf::FieldDescriptor& field, uint64_t count)>
      error = nullptr;
};

// INVALID_ARGUMENT (INVALID_FIELD) about `count` elements of a field, where `most` may be in all.
absl::Status TooManyElements(const google::protobuf::FieldDescriptor& field, uint64_t count,
                             uint64_t most);

// Reads `buffer`, which is empty then. An array that was long enough is in arrays[i], for paths[i],
// and its field in `message` is empty. REQUIRES: every path is one of `message`'s type, through
// singular fields; as many arrays as paths, at most 31, all of them empty. `least`: kLeastLifted,
// but for tests.
absl::Status ReadRequest(grpc::ByteBuffer* buffer, std::span<const WirePath> paths,
                         const ElementLimit& elements, google::protobuf::Message* message,
                         std::span<WireArray> arrays, size_t least = kLeastLifted);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_WIRE_REQUEST_H_
