// SPDX-License-Identifier: Apache-2.0
//
// The header of a PLY file: its encoding and its elements, each with its properties in file order.
//
// Thread safety: plain values and a free function.
//
//   absl::StatusOr<PlyHeader> header = ParsePlyHeader(bytes);
#ifndef SIGHTLINE_CLIENT_IMPORT_PLY_HEADER_H_
#define SIGHTLINE_CLIENT_IMPORT_PLY_HEADER_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace sightline {

enum class PlyType : uint8_t { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };

// Bytes of one value in a binary file.
size_t PlyTypeSize(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::kFloat;
  bool is_list = false;
  PlyType count_type = PlyType::kUint8;  // Of a list.
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;
  std::vector<PlyProperty> properties;

  // The number of the property with this name, -1 where there is none.
  int Find(std::string_view wanted) const;
  // The fewest bytes that one element can take: its scalars and its lists' counts.
  size_t MinBinarySize() const;
};

struct PlyHeader {
  enum class Encoding : uint8_t { kAscii, kLittleEndian, kBigEndian };
  Encoding encoding = Encoding::kAscii;
  std::vector<PlyElement> elements;
  size_t size = 0;  // Bytes, with the end of the line "end_header".
};

// InvalidArgument with the line's number for anything that is not a header.
absl::StatusOr<PlyHeader> ParsePlyHeader(std::string_view bytes);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_PLY_HEADER_H_
