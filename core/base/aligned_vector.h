// SPDX-License-Identifier: Apache-2.0
//
// A growable array of trivially copyable elements that starts on a cache line (64 bytes), on huge
// pages where it is large: what SIMD code reads and what the native scene file maps. Beside
// std::vector's usual part it can grow without initializing, for arrays that are about to be
// overwritten whole.
//
// An array may also be borrowed from memory that somebody else holds, such as a mapped file: it is
// read as any other, may not be written in place, and whatever changes its size copies it first. A
// copy of it is an ordinary array.
//
// Invariants: data() is 64-byte aligned (null while capacity is 0); size() <= capacity(). Growth
// moves the elements: pointers and spans into it end there. Running out of memory throws
// std::bad_alloc, as std::vector does.
//
// Thread safety: as std::vector: const access from many threads, or one writer.
//
//   AlignedVector<float> x;
//   x.ResizeUninitialized(n);
//   pool.ParallelFor(n, 4096, [&](size_t b, size_t e) { while (b < e) x[b++] = 0; });
#ifndef SIGHTLINE_CORE_BASE_ALIGNED_VECTOR_H_
#define SIGHTLINE_CORE_BASE_ALIGNED_VECTOR_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <type_traits>
#include <utility>

#include "core/base/array_memory.h"
#include "core/base/check.h"

namespace sightline {

template <typename T>
class AlignedVector {
  static_assert(std::is_trivially_copyable_v<T>,
                "elements are moved by memcpy and never destroyed");

 public:
  static constexpr size_t kAlignment = kArrayAlignment;
  static_assert(alignof(T) <= kAlignment);

  using value_type = T;
  using size_type = size_t;
  using difference_type = std::ptrdiff_t;
  using reference = T&;
  using const_reference = const T&;
  using iterator = T*;
  using const_iterator = const T*;

  AlignedVector() = default;
  explicit AlignedVector(size_t n, const T& value = T()) { resize(n, value); }
  AlignedVector(std::initializer_list<T> values) { Assign(values.begin(), values.size()); }
  template <std::forward_iterator It>
  AlignedVector(It first, It last) {
    ResizeUninitialized(static_cast<size_t>(std::distance(first, last)));
    std::copy(first, last, data_);
  }
  AlignedVector(const AlignedVector& other) { Assign(other.data_, other.size_); }
  AlignedVector(AlignedVector&& other) noexcept { swap(other); }
  AlignedVector& operator=(const AlignedVector& other) {
    if (this != &other) Assign(other.data_, other.size_);
    return *this;
  }
  AlignedVector& operator=(AlignedVector&& other) noexcept {
    AlignedVector taken(std::move(other));
    swap(taken);
    return *this;
  }
  ~AlignedVector() { Free(); }

  // The elements of `values` where they are, while `owner` is held. REQUIRES: it is not null; they
  // are 64-byte aligned and unchanging. NOLINTNEXTLINE(performance-unnecessary-value-param): moved
  static AlignedVector Borrow(std::span<const T> values, std::shared_ptr<const void> owner) {
    SIGHTLINE_CHECK(owner != nullptr);
    SIGHTLINE_CHECK_EQ(reinterpret_cast<uintptr_t>(values.data()) % kAlignment, 0u);
    AlignedVector array;
    if (values.empty()) return array;
    array.data_ = const_cast<T*>(values.data());
    array.size_ = array.capacity_ = values.size();
    array.owner_ = std::move(owner);
    return array;
  }
  bool borrowed() const { return owner_ != nullptr; }

  // REQUIRES, of this and of all that hand out elements to write: !borrowed().
  T* data() {
    SIGHTLINE_DCHECK(!borrowed());
    return data_;
  }
  const T* data() const { return data_; }
  size_t size() const { return size_; }
  size_t capacity() const { return capacity_; }
  bool empty() const { return size_ == 0; }
  T* begin() { return data(); }
  T* end() { return data() + size_; }
  const T* begin() const { return data_; }
  const T* end() const { return data_ + size_; }

  // REQUIRES: i < size().
  T& operator[](size_t i) {
    SIGHTLINE_DCHECK_LT(i, size_);
    SIGHTLINE_DCHECK(!borrowed());
    return data_[i];
  }
  const T& operator[](size_t i) const {
    SIGHTLINE_DCHECK_LT(i, size_);
    return data_[i];
  }
  // REQUIRES: !empty().
  T& front() { return (*this)[0]; }
  const T& front() const { return (*this)[0]; }
  T& back() { return (*this)[size_ - 1]; }
  const T& back() const { return (*this)[size_ - 1]; }

  // `value` may be an element of this array: it is copied before the array moves.
  void push_back(T value) {
    if (size_ == capacity_ || borrowed()) {
      Reallocate(std::max<size_t>(kMinCapacity, 2 * capacity_));
    }
    std::memcpy(static_cast<void*>(data_ + size_), &value, sizeof(T));
    ++size_;
  }
  // REQUIRES: !empty().
  void pop_back() {
    SIGHTLINE_DCHECK_GT(size_, 0u);
    --size_;
  }

  void reserve(size_t n) {
    if (n > capacity_ || borrowed()) Reallocate(std::max(n, size_));
  }
  // REQUIRES: `values` is no part of this array.
  void Append(std::span<const T> values) {
    if (values.empty()) return;
    const size_t old = size_;
    if (old + values.size() > capacity_) reserve(std::max(old + values.size(), 2 * capacity_));
    ResizeUninitialized(old + values.size());
    std::memcpy(static_cast<void*>(data_ + old), values.data(), values.size_bytes());
  }
  // New elements are copies of `value`.
  void resize(size_t n, T value = T()) {
    const size_t old = size_;
    ResizeUninitialized(n);
    if (n > old) std::uninitialized_fill(data_ + old, data_ + n, value);
  }
  // New elements hold whatever was in memory. Grows to exactly `n`.
  void ResizeUninitialized(size_t n) {
    reserve(n);
    size_ = n;
  }
  void clear() {
    if (borrowed()) Free();
    size_ = 0;
  }
  void shrink_to_fit() {
    if (capacity_ > size_) Reallocate(size_);
  }
  void swap(AlignedVector& other) noexcept {
    std::swap(data_, other.data_);
    std::swap(size_, other.size_);
    std::swap(capacity_, other.capacity_);
    owner_.swap(other.owner_);
  }

  friend bool operator==(const AlignedVector& a, const AlignedVector& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
  }

 private:
  // The first allocation fills a cache line.
  static constexpr size_t kMinCapacity = std::max<size_t>(1, kAlignment / sizeof(T));

  static T* Allocate(size_t n) {
    if (n == 0) return nullptr;
    if (n > std::numeric_limits<std::ptrdiff_t>::max() / sizeof(T))
      throw std::bad_array_new_length();
    return static_cast<T*>(AllocateArray(n * sizeof(T)));
  }
  // Leaves no memory, and size_ as it is.
  void Free() {
    if (!borrowed()) FreeArray(data_, capacity_ * sizeof(T));
    data_ = nullptr;
    capacity_ = 0;
    owner_.reset();
  }

  // REQUIRES: n >= size_.
  void Reallocate(size_t n) {
    T* const data = Allocate(n);
    if (size_ > 0) std::memcpy(static_cast<void*>(data), data_, size_ * sizeof(T));
    Free();
    data_ = data;
    capacity_ = n;
  }
  void Assign(const T* values, size_t n) {
    if (n > capacity_ || borrowed()) size_ = 0;  // Nothing of the old contents need be moved.
    ResizeUninitialized(n);
    if (n > 0) std::memcpy(static_cast<void*>(data_), values, n * sizeof(T));
  }

  T* data_ = nullptr;
  size_t size_ = 0;
  size_t capacity_ = 0;
  std::shared_ptr<const void> owner_;  // Of borrowed elements; null for elements of its own.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_ALIGNED_VECTOR_H_
