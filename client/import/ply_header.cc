// SPDX-License-Identifier: Apache-2.0
#include "client/import/ply_header.h"

#include <optional>

#include "absl/strings/str_cat.h"
#include "client/import/text_scanner.h"

namespace sightline {
namespace {

std::optional<PlyType> ParseType(std::string_view name) {
  if (name == "char" || name == "int8") return PlyType::kInt8;
  if (name == "uchar" || name == "uint8") return PlyType::kUint8;
  if (name == "short" || name == "int16") return PlyType::kInt16;
  if (name == "ushort" || name == "uint16") return PlyType::kUint16;
  if (name == "int" || name == "int32") return PlyType::kInt32;
  if (name == "uint" || name == "uint32") return PlyType::kUint32;
  if (name == "float" || name == "float32") return PlyType::kFloat;
  if (name == "double" || name == "float64") return PlyType::kDouble;
  return std::nullopt;
}

std::optional<PlyHeader::Encoding> ParseEncoding(std::string_view name) {
  if (name == "ascii") return PlyHeader::Encoding::kAscii;
  if (name == "binary_little_endian") return PlyHeader::Encoding::kLittleEndian;
  if (name == "binary_big_endian") return PlyHeader::Encoding::kBigEndian;
  return std::nullopt;
}

// "property float x" or "property list uchar int vertex_indices", after its first word.
std::optional<PlyProperty> ParseProperty(std::string_view line) {
  PlyProperty property;
  std::string_view word = TakeToken(&line);
  if (word == "list") {
    property.is_list = true;
    const std::optional<PlyType> count_type = ParseType(TakeToken(&line));
    if (!count_type.has_value() || *count_type >= PlyType::kFloat) return std::nullopt;
    property.count_type = *count_type;
    word = TakeToken(&line);
  }
  const std::optional<PlyType> type = ParseType(word);
  property.name = TakeToken(&line);
  if (!type.has_value() || property.name.empty()) return std::nullopt;
  property.type = *type;
  return property;
}

}  // namespace

size_t PlyTypeSize(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
    case PlyType::kUint8:
      return 1;
    case PlyType::kInt16:
    case PlyType::kUint16:
      return 2;
    case PlyType::kInt32:
    case PlyType::kUint32:
    case PlyType::kFloat:
      return 4;
    case PlyType::kDouble:
      return 8;
  }
  return 8;
}

int PlyElement::Find(std::string_view wanted) const {
  for (size_t i = 0; i < properties.size(); ++i) {
    if (properties[i].name == wanted) return static_cast<int>(i);
  }
  return -1;
}

size_t PlyElement::MinBinarySize() const {
  size_t size = 0;
  for (const PlyProperty& p : properties) size += PlyTypeSize(p.is_list ? p.count_type : p.type);
  return size;
}

absl::StatusOr<PlyHeader> ParsePlyHeader(std::string_view bytes) {
  TextScanner scanner(bytes);
  if (TrimBlanks(scanner.RestOfLine()) != "ply") {
    return absl::InvalidArgumentError("is not a PLY file: it does not begin with a line \"ply\"");
  }
  PlyHeader header;
  bool has_format = false;
  for (size_t number = 2; !scanner.AtEnd(); ++number) {
    std::string_view line = scanner.RestOfLine();
    const auto bad = [&, whole = line] {
      return absl::InvalidArgumentError(
          absl::StrCat("line ", number, " of the PLY header is not understood: ", Quoted(whole)));
    };
    const std::string_view keyword = TakeToken(&line);
    if (keyword.empty() || keyword == "comment" || keyword == "obj_info") continue;
    if (keyword == "end_header") {
      if (!has_format) return absl::InvalidArgumentError("the PLY header has no format line");
      header.size = scanner.position();
      return header;
    }
    if (keyword == "format") {
      const std::optional<PlyHeader::Encoding> encoding = ParseEncoding(TakeToken(&line));
      if (!encoding.has_value() || TakeToken(&line) != "1.0") return bad();
      header.encoding = *encoding;
      has_format = true;
    } else if (keyword == "element") {
      PlyElement element;
      element.name = TakeToken(&line);
      const std::optional<int64_t> count = ParseInt(TakeToken(&line));
      if (element.name.empty() || !count.has_value() || *count < 0) return bad();
      element.count = static_cast<uint64_t>(*count);
      header.elements.push_back(std::move(element));
    } else if (keyword == "property") {
      std::optional<PlyProperty> property = ParseProperty(line);
      if (!property.has_value() || header.elements.empty()) return bad();
      header.elements.back().properties.push_back(*std::move(property));
    } else {
      return bad();
    }
  }
  return absl::DataLossError("the PLY header has no end_header line");
}

}  // namespace sightline
