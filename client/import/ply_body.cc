// SPDX-License-Identifier: Apache-2.0
#include "client/import/ply_body.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "absl/strings/str_cat.h"

namespace sightline {
namespace {

template <typename T>
double Load(const char* bytes, bool big_endian) {
  char copy[sizeof(T)];
  std::memcpy(copy, bytes, sizeof(T));
  if (big_endian) std::reverse(copy, copy + sizeof(T));
  T value;
  std::memcpy(&value, copy, sizeof(T));
  return static_cast<double>(value);
}

double LoadScalar(PlyType type, const char* bytes, bool big_endian) {
  switch (type) {
    case PlyType::kInt8:
      return Load<int8_t>(bytes, big_endian);
    case PlyType::kUint8:
      return Load<uint8_t>(bytes, big_endian);
    case PlyType::kInt16:
      return Load<int16_t>(bytes, big_endian);
    case PlyType::kUint16:
      return Load<uint16_t>(bytes, big_endian);
    case PlyType::kInt32:
      return Load<int32_t>(bytes, big_endian);
    case PlyType::kUint32:
      return Load<uint32_t>(bytes, big_endian);
    case PlyType::kFloat:
      return Load<float>(bytes, big_endian);
    case PlyType::kDouble:
      return Load<double>(bytes, big_endian);
  }
  return 0;
}

}  // namespace

void PlyBody::Fail(absl::Status error) {
  if (error_.ok()) error_ = std::move(error);
  binary_ = {};
  text_ = TextScanner({});
}

double PlyBody::Scalar(PlyType type) {
  if (ascii()) {
    const std::string_view token = text_.Token();
    if (token.empty()) {
      Fail(absl::DataLossError("ends before its last element"));
      return 0;
    }
    return ParseDouble(token).value_or(std::numeric_limits<double>::quiet_NaN());
  }
  const size_t size = PlyTypeSize(type);
  if (binary_.size() < size) {
    Fail(absl::DataLossError("ends before its last element"));
    return 0;
  }
  const double value =
      LoadScalar(type, binary_.data(), encoding_ == PlyHeader::Encoding::kBigEndian);
  binary_.remove_prefix(size);
  return value;
}

uint64_t PlyBody::ListSize(const PlyProperty& list) {
  const double size = Scalar(list.count_type);
  if (!ok()) return 0;
  // A value takes at least its digit and a blank (the last one its digit alone), or its own size.
  const uint64_t most =
      ascii() ? (text_.remaining() + 1) / 2 : binary_.size() / PlyTypeSize(list.type);
  if (!(size >= 0) || size != std::floor(size)) {
    Fail(absl::DataLossError(
        absl::StrCat("a list \"", list.name, "\" has the length ", size, ", which is none")));
    return 0;
  }
  if (size > static_cast<double>(most)) {
    Fail(absl::DataLossError(absl::StrCat("a list \"", list.name, "\" has the length ", size,
                                          ", but only ", most, " values can follow")));
    return 0;
  }
  return static_cast<uint64_t>(size);
}

void PlyBody::Skip(const PlyProperty& property) {
  if (!property.is_list) {
    Scalar(property.type);
    return;
  }
  const uint64_t size = ListSize(property);
  if (!ok()) return;
  if (ascii()) {
    for (uint64_t i = 0; i < size && ok(); ++i) Scalar(property.type);
  } else {
    binary_.remove_prefix(size * PlyTypeSize(property.type));
  }
}

uint64_t PlyBody::Unread() const {
  if (!ascii()) return binary_.size();
  TextScanner rest = text_;
  const std::string_view next = rest.Token();
  return next.size() + rest.remaining();
}

uint64_t PlyBody::MostElements(const PlyElement& element) const {
  if (element.properties.empty()) return std::numeric_limits<uint64_t>::max();
  if (ascii()) return (text_.remaining() + 1) / (2 * element.properties.size());
  return binary_.size() / element.MinBinarySize();
}

}  // namespace sightline
