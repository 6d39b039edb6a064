// SPDX-License-Identifier: Apache-2.0
//
// Memory that is asked for a few lines at a time, while something else is computed. Asked for all
// at once, dozens of lines that no cache holds would stop a core until the first of them arrive.
//
// Thread safety: one thread's own.
//
//   GradualFetch fetch;
//   fetch.Add(positions);
//   while (...) { fetch.Some(); ... }
//   fetch.All();
#ifndef SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_
#define SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/check.h"

namespace sightline {

class GradualFetch {
 public:
  static constexpr size_t kMostRows = 3, kLineBytes = 64;

  // Asked for after what was added before; at most kMostRows rows that are not empty.
  template <typename T>
  void Add(std::span<const T> row) {
    if (row.empty()) return;
    SIGHTLINE_DCHECK(count_ < kMostRows);
    const uintptr_t begin = reinterpret_cast<uintptr_t>(row.data());
    rows_[count_++] = {begin, begin + row.size_bytes()};
  }

  bool done() const { return next_ == count_; }

  // The next few lines. Those just behind a row may be among them.
  void Some() {
    if (done()) return;
    Row& row = rows_[next_];
    for (size_t i = 0; i < kLinesAtOnce; ++i) Ask(row.at + i * kLineBytes);
    row.at += kLinesAtOnce * kLineBytes;
    next_ += row.at >= row.end ? 1 : 0;
  }

  // All that is left, at once.
  void All() {
    while (!done()) Some();
  }

 private:
  static constexpr size_t kLinesAtOnce = 8;
  struct Row {
    uintptr_t at, end;
  };

  // To the second level: the first one is what walks work in. By assembly, since GCC takes a
  // function that does nothing but prefetch for one without effect, and drops it.
  static void Ask(uintptr_t at) {
    asm volatile("prefetcht1 %0" : : "m"(*reinterpret_cast<const char*>(at)));
  }

  std::array<Row, kMostRows> rows_;
  size_t next_ = 0, count_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_
