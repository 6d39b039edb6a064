// SPDX-License-Identifier: Apache-2.0
//
// Packed little-endian arrays on the wire against vectors of plain elements. The project runs on
// x86-64 alone, so that the bytes are the memory; as they came they may be unaligned and in pieces,
// hence the copies. `Bytes` is a string_view or a WireArray.
//
// Thread safety: functions only.
//
//   std::vector<Vec3d> points;
//   SL_RETURN_IF_ERROR(DecodeArray(item.points(), "points.points", "float64 [n, 3]", &points));
#ifndef SIGHTLINE_SERVER_CODEC_PACKED_ARRAY_H_
#define SIGHTLINE_SERVER_CODEC_PACKED_ARRAY_H_

#include <bit>
#include <cstddef>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/codec/wire_array.h"

namespace sightline {

static_assert(std::endian::native == std::endian::little);

// InvalidArgument (BAD_ARRAY_LENGTH) naming `field`, the length and `shape` unless `bytes` are
// whole elements.
template <typename T>
absl::Status CheckArrayLength(size_t bytes, absl::string_view field, absl::string_view shape) {
  if (bytes % sizeof(T) == 0) return absl::OkStatus();
  return InvalidField(
      field, absl::StrCat(bytes, " bytes"),
      absl::StrCat("not a whole number of elements of ", sizeof(T), " bytes (", shape, ")"),
      v1::ERROR_REASON_BAD_ARRAY_LENGTH);
}

// Appends the elements in `bytes` to `out`, unless CheckArrayLength objects.
template <typename T, typename Bytes>
absl::Status AppendArray(const Bytes& bytes, absl::string_view field, absl::string_view shape,
                         std::vector<T>* out) {
  static_assert(std::is_trivially_copyable_v<T>);
  SL_RETURN_IF_ERROR(CheckArrayLength<T>(bytes.size(), field, shape));
  const size_t old = out->size();
  out->resize(old + bytes.size() / sizeof(T));
  CopyBytes(bytes, out->data() + old);
  return absl::OkStatus();
}

template <typename T, typename Bytes>
absl::Status DecodeArray(const Bytes& bytes, absl::string_view field, absl::string_view shape,
                         std::vector<T>* out) {
  out->clear();
  return AppendArray(bytes, field, shape, out);
}

template <typename T>
void EncodeArray(std::span<const T> values, std::string* out) {
  static_assert(std::is_trivially_copyable_v<T>);
  out->assign(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

// InvalidArgument (BAD_ARRAY_LENGTH) unless `count` is `expected`.
inline absl::Status CheckCount(absl::string_view field, uint64_t count, uint64_t expected,
                               absl::string_view expected_by) {
  if (count == expected) return absl::OkStatus();
  return InvalidField(field, absl::StrCat(count, " elements"),
                      absl::StrCat("must have ", expected, " elements, as many as ", expected_by),
                      v1::ERROR_REASON_BAD_ARRAY_LENGTH);
}

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_PACKED_ARRAY_H_
