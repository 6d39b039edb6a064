// SPDX-License-Identifier: Apache-2.0
//
// The bytes of one large array as they travel: where the transport put them on their way in, where
// they were computed on their way out. Neither is copied; a message's slices live as long as the
// arrays that refer to them.
//
// Thread safety: a constant array may be read from several threads.
//
//   WireArray array;                      // Or WireArray(std::vector<float>{...}).
//   array.Append(slice);                  // As often as there are pieces.
//   array.Copy(48 * first, 48 * count, ends.data());
#ifndef SIGHTLINE_SERVER_CODEC_WIRE_ARRAY_H_
#define SIGHTLINE_SERVER_CODEC_WIRE_ARRAY_H_

#include <grpcpp/support/slice.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/string_view.h"
#include "core/base/aligned_vector.h"

namespace sightline {

class WireArray {
 public:
  WireArray() = default;
  // Takes the elements over; their bytes are the wire's.
  explicit WireArray(std::string bytes) { Adopt(std::move(bytes)); }
  template <typename T>
  explicit WireArray(std::vector<T> values) {
    static_assert(std::is_trivially_copyable_v<T>);
    Adopt(std::move(values));
  }
  template <typename T>
  explicit WireArray(AlignedVector<T> values) {
    Adopt(std::move(values));
  }

  // Of bytes that outlive it.
  static WireArray Refer(absl::string_view bytes);

  size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  // Bytes that follow those there are; shared with the slice.
  void Append(grpc::Slice slice);
  // Copies bytes begin .. begin + count - 1. REQUIRES: the array has them.
  void Copy(size_t begin, size_t count, void* out) const;

  // The bytes in order.
  struct Piece {
    size_t begin;  // Of the array.
    grpc::Slice slice;
  };
  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  template <typename Elements>
  void Adopt(Elements elements) {
    const size_t bytes = elements.size() * sizeof(*elements.data());
    if (bytes == 0) return;
    // gRPC lets go of it by `destroy`, on whichever thread is the last to need it.
    auto* const kept = new Elements(std::move(elements));
    Append(grpc::Slice(
        kept->data(), bytes, [](void* held) { delete static_cast<Elements*>(held); }, kept));
  }

  std::vector<Piece> pieces_;
  size_t size_ = 0;
};

// `lifted`, or if it is empty what the message holds, which is taken over.
WireArray ArrayOf(WireArray lifted, std::string* held);

// Of either form, from the beginning.
inline void CopyBytes(const WireArray& from, void* out) { from.Copy(0, from.size(), out); }
void CopyBytes(absl::string_view from, void* out);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_CODEC_WIRE_ARRAY_H_
