// SPDX-License-Identifier: Apache-2.0
//
// The two pieces of protobuf's wire format that are written by hand: the head of a field with a
// length, and numbers of variable length.
//
// Thread safety: functions only.
//
//   AppendLengthHead(v1::SegmentItem::kSegmentsFieldNumber, bytes.size(), &head);
//
// The wire format: protobuf.dev/programming-guides/encoding.
#ifndef SIGHTLINE_SERVER_CODEC_WIRE_FORMAT_H_
#define SIGHTLINE_SERVER_CODEC_WIRE_FORMAT_H_

#include <cstdint>
#include <string>

namespace sightline {

// What stands in a tag beside the field's number.
enum class WireType : uint32_t {
  kVarint = 0,
  kFixed64 = 1,
  kLength = 2,
  kGroup = 3,
  kEndGroup = 4,
  kFixed32 = 5
};

// Seven bits a byte, the lowest first.
inline void AppendVarint(uint64_t value, std::string* out) {
  for (; value >= 0x80; value >>= 7) out->push_back(static_cast<char>(value | 0x80));
  out->push_back(static_cast<char>(value));
}

// The tag of a field whose value is `bytes` long, and that length.
inline void AppendLengthHead(int field, uint64_t bytes, std::string* out) {
  AppendVarint(static_cast<uint64_t>(field) << 3 | static_cast<uint32_t>(WireType::kLength), out);
  AppendVarint(bytes, out);
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_WIRE_FORMAT_H_
