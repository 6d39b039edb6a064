// SPDX-License-Identifier: Apache-2.0
//
// An array of uninitialized elements, as long as it may have to be, of which most are never
// touched: places that threads take by a counter.
//
// Huge pages would be zeroed whole for the few elements at their beginning (2 MiB take 80
// microseconds, a quarter of the build of a small tree), so they are asked for only where the array
// is so large that its memory comes fresh from the system each time. Smaller ones come from what
// was freed before, without a page fault.
//
// Thread safety: as an array's: different elements may be written at once.
//
//   SparseArray<Node> nodes(most_nodes);
//   nodes[next.fetch_add(1)] = node;
#ifndef SIGHTLINE_CORE_BASE_SPARSE_ARRAY_H_
#define SIGHTLINE_CORE_BASE_SPARSE_ARRAY_H_

#include <cstddef>
#include <new>
#include <type_traits>
#include <utility>

#include "core/base/array_memory.h"
#include "core/base/check.h"

namespace sightline {

template <typename T>
class SparseArray {
  static_assert(std::is_trivially_copyable_v<T>, "elements are neither constructed nor destroyed");
  static_assert(alignof(T) <= kArrayAlignment);

 public:
  SparseArray() = default;
  // Throws std::bad_alloc where there is no memory. REQUIRES: size * sizeof(T) fits a size_t.
  explicit SparseArray(size_t size) : size_(size), data_(Allocate(size)) {}
  SparseArray(SparseArray&& other) noexcept
      : size_(std::exchange(other.size_, 0)), data_(std::exchange(other.data_, nullptr)) {}
  SparseArray& operator=(SparseArray&& other) noexcept {
    std::swap(size_, other.size_);
    std::swap(data_, other.data_);
    return *this;
  }
  ~SparseArray() {
    if (IsLarge(size_)) {
      FreeArray(data_, size_ * sizeof(T));
    } else {
      ::operator delete (data_, std::align_val_t{kArrayAlignment});
    }
  }

  size_t size() const { return size_; }
  // REQUIRES: i < size().
  T& operator[](size_t i) {
    SIGHTLINE_DCHECK_LT(i, size_);
    return data_[i];
  }
  const T& operator[](size_t i) const {
    SIGHTLINE_DCHECK_LT(i, size_);
    return data_[i];
  }

 private:
  // From here on glibc's malloc maps memory anew each time, whatever was freed before.
  static constexpr size_t kLargeBytes = size_t{32} << 20;
  static bool IsLarge(size_t size) { return size * sizeof(T) >= kLargeBytes; }

  static T* Allocate(size_t size) {
    if (size == 0) return nullptr;
    const size_t bytes = size * sizeof(T);
    return static_cast<T*>(IsLarge(size)
                               ? AllocateArray(bytes)
                               : ::operator new (bytes, std::align_val_t{kArrayAlignment}));
  }

  size_t size_ = 0;
  T* data_ = nullptr;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_SPARSE_ARRAY_H_
