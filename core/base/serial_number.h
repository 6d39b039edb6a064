// SPDX-License-Identifier: Apache-2.0
//
// A number that no other object of this process has or ever had: what was noted of one is told from
// what was noted of another, even where that one lies at the same address now. It goes along where
// its object is moved; a copy has one of its own, since it may be changed.
//
// Thread safety: numbers may be taken by several threads at once; one of them is a plain value.
//
//   struct Tree { ...; SerialNumber number; };
//   if (notes.tree != tree.number.value()) notes = {};
#ifndef SIGHTLINE_CORE_BASE_SERIAL_NUMBER_H_
#define SIGHTLINE_CORE_BASE_SERIAL_NUMBER_H_

#include <atomic>
#include <cstdint>
#include <utility>

namespace sightline {

class SerialNumber {
 public:
  SerialNumber() = default;
  SerialNumber(const SerialNumber&) : SerialNumber() {}
  SerialNumber(SerialNumber&& other) noexcept : value_(std::exchange(other.value_, Next())) {}
  SerialNumber& operator=(const SerialNumber& other) {
    if (this != &other) value_ = Next();
    return *this;
  }
  SerialNumber& operator=(SerialNumber&& other) noexcept {
    value_ = std::exchange(other.value_, Next());
    return *this;
  }
  ~SerialNumber() = default;

  uint64_t value() const { return value_; }  // Never 0.

 private:
  static uint64_t Next() {
    static std::atomic<uint64_t> next{1};
    return next.fetch_add(1, std::memory_order_relaxed);
  }

  uint64_t value_ = Next();
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_SERIAL_NUMBER_H_
