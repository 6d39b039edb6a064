// SPDX-License-Identifier: Apache-2.0
//
// A loop on one thread that looks at a cancel token once in a while: for what is quick by the
// element, and whose elements may be many.
//
// Thread safety: functions only.
//
//   if (!InPolledBlocks(n, cancel, [&](size_t begin, size_t end) { Copy(begin, end); })) {
//     return cancel->ToStatus();
//   }
#ifndef SIGHTLINE_CORE_BASE_POLLED_BLOCKS_H_
#define SIGHTLINE_CORE_BASE_POLLED_BLOCKS_H_

#include <algorithm>
#include <cstddef>
#include <span>
#include <vector>

#include "core/base/cancel.h"

namespace sightline {

// Of elements that take some nanoseconds each: some hundred microseconds.
inline constexpr size_t kPolledBlock = 64 << 10;

// Calls body(begin, end) for [0, n) in blocks of `block`, and looks at `cancel` (may be null)
// before each and after the last. False: it has fired, and blocks may be left out.
template <typename Body>
bool InPolledBlocks(size_t n, size_t block, const CancelToken* cancel, const Body& body) {
  const auto fired = [cancel] { return cancel != nullptr && cancel->cancelled(); };
  for (size_t begin = 0; begin < n; begin += block) {
    if (fired()) return false;
    body(begin, begin + std::min(block, n - begin));
  }
  return !fired();
}
template <typename Body>
bool InPolledBlocks(size_t n, const CancelToken* cancel, const Body& body) {
  return InPolledBlocks(n, kPolledBlock, cancel, body);
}

// A copy; once `cancel` has fired, of a part.
template <typename T>
std::vector<T> CopyInPolledBlocks(std::span<const T> from, const CancelToken* cancel) {
  std::vector<T> copy;
  copy.reserve(from.size());
  InPolledBlocks(from.size(), cancel, [&](size_t begin, size_t end) {
    const auto part = from.subspan(begin, end - begin);
    copy.insert(copy.end(), part.begin(), part.end());
  });
  return copy;
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_BASE_POLLED_BLOCKS_H_
