// SPDX-License-Identifier: Apache-2.0
//
// A message on its way in, read without copying its large arrays: a scan over the slices that it
// came in finds them, and protobuf reads all the rest. Whatever is not plain to the scan (a field
// that comes twice, two parts of a oneof, groups, lengths that do not fit) is left to protobuf
// alone, so that what a message means, and whether it is one, is always protobuf's word.
//
// Errors are INVALID_ARGUMENT: the bytes are no message of the type.
//
// Thread safety: functions only.
//
//   constexpr std::array<WirePath, 1> kPaths = {{{2, 2}}};   // item.segments
//   std::array<WireArray, 1> arrays;
//   SL_RETURN_IF_ERROR(ReadRequest(&buffer, kPaths, &request, arrays));
//   if (arrays[0].empty()) arrays[0] = WireArray(std::move(*request.mutable_item()->...));
//
// The wire format: protobuf.dev/programming-guides/encoding.
#ifndef SIGHTLINE_SERVER_CODEC_WIRE_REQUEST_H_
#define SIGHTLINE_SERVER_CODEC_WIRE_REQUEST_H_

#include <google/protobuf/message.h>
#include <grpcpp/support/byte_buffer.h>

#include <array>
#include <cstddef>
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

// Reads `buffer`, which is empty then. An array that was long enough is in arrays[i], for paths[i],
// and its field in `message` is empty. REQUIRES: every path is one of `message`'s type, through
// singular fields; as many arrays as paths, all of them empty. `least`: kLeastLifted, but for
// tests.
absl::Status ReadRequest(grpc::ByteBuffer* buffer, std::span<const WirePath> paths,
                         google::protobuf::Message* message, std::span<WireArray> arrays,
                         size_t least = kLeastLifted);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_WIRE_REQUEST_H_
