// SPDX-License-Identifier: Apache-2.0
#include "server/codec/wire_array.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "core/base/check.h"

namespace sightline {

WireArray WireArray::Refer(absl::string_view bytes) {
  WireArray array;
  array.Append(grpc::Slice(bytes.data(), bytes.size(), grpc::Slice::STATIC_SLICE));
  return array;
}

void WireArray::Append(grpc::Slice slice) {
  if (slice.size() == 0) return;
  const size_t begin = size_;
  size_ += slice.size();
  pieces_.push_back({begin, std::move(slice)});
}

void WireArray::Copy(size_t begin, size_t count, void* out) const {
  SIGHTLINE_CHECK(begin <= size_ && count <= size_ - begin);
  if (count == 0) return;
  // The last piece that begins no later.
  auto piece =
      std::upper_bound(pieces_.begin(), pieces_.end(), begin,
                       [](size_t byte, const Piece& other) { return byte < other.begin; }) -
      1;
  auto* to = static_cast<uint8_t*>(out);
  for (; count > 0; ++piece) {
    const size_t skipped = begin - piece->begin;
    const size_t here = std::min(count, piece->slice.size() - skipped);
    std::memcpy(to, piece->slice.begin() + skipped, here);
    to += here;
    begin += here;
    count -= here;
  }
}

WireArray ArrayOf(WireArray lifted, std::string* held) {
  return lifted.empty() ? WireArray(std::move(*held)) : std::move(lifted);
}

void CopyBytes(absl::string_view from, void* out) {
  if (!from.empty()) std::memcpy(out, from.data(), from.size());
}

}  // namespace sightline
