// SPDX-License-Identifier: Apache-2.0
//
// Points to come, brought into the cache a few at a time, while something else is computed. Asked
// for all at once, dozens of lines that no cache holds would stop a core until the first of them
// arrive.
//
// Thread safety: one thread's own.
//
//   GradualFetch fetch(positions, sources, valid);
//   fetch.Resume(asked_before, /*most=*/20000);
//   fetch.Until(4096);
//   while (...) { fetch.Some(); ... }
//   asked_before = fetch.at();
#ifndef SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_
#define SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/check.h"
#include "core/geometry/vec3.h"

namespace sightline {

// Asks for the lines of so many bytes, for the second level: the first one is what walks work in.
// By assembly, since GCC takes a function that does nothing but prefetch for one without effect,
// and drops it.
inline void AskForLines(uintptr_t from, size_t bytes) {
  constexpr size_t kLineBytes = 64;
  for (size_t at = 0; at < bytes; at += kLineBytes) {
    asm volatile("prefetcht1 %0" : : "m"(*reinterpret_cast<const char*>(from + at)));
  }
}

class GradualFetch {
 public:
  static constexpr size_t kPointsAtOnce = 32;

  GradualFetch() = default;  // Of no points.
  // Rows of as many points, or none of the latter two. Nothing is asked for until it is said how
  // far.
  GradualFetch(std::span<const Vec3f> positions, std::span<const uint32_t> sources,
               std::span<const uint8_t> valid)
      : positions_(positions), sources_(sources), valid_(valid) {
    SIGHTLINE_DCHECK(sources.empty() || sources.size() == positions.size());
    SIGHTLINE_DCHECK(valid.empty() || valid.size() == positions.size());
  }

  bool empty() const { return positions_.empty(); }

  // Goes on where another has come to: with the point whose position lies at `address`, if that is
  // one of the first `most` or just behind them. One farther on is of an earlier time.
  void Resume(uintptr_t address, size_t most) {
    const uintptr_t first = AddressOf(positions_, 0);
    if (address < first) return;
    const size_t next = (address - first) / sizeof(Vec3f);
    if (next <= std::min(most, positions_.size())) next_ = next;
  }
  // Where the first position that was not asked for lies.
  uintptr_t at() const { return AddressOf(positions_, next_); }

  // Points from this one on are not asked for.
  void Until(size_t point) { end_ = std::min(point, positions_.size()); }
  bool done() const { return next_ >= end_; }

  // Leaves the positions of so many points to the caller, who is to ask for them: where they begin.
  // What belongs to them is asked for at once. Null: there are not as many to ask for.
  const Vec3f* Take(size_t points) {
    if (next_ + points > end_) return nullptr;
    const Vec3f* const from = positions_.data() + next_;
    if (!sources_.empty()) Ask(sources_, points);
    if (!valid_.empty()) Ask(valid_, points);
    next_ += points;
    return from;
  }

  // The next few points. Some that follow may be among them, or what lies behind the rows.
  void Some() {
    if (done()) return;
    Ask(positions_, kPointsAtOnce);
    if (!sources_.empty()) Ask(sources_, kPointsAtOnce);
    if (!valid_.empty()) Ask(valid_, kPointsAtOnce);
    next_ = std::min(next_ + kPointsAtOnce, positions_.size());
  }

 private:
  template <typename T>
  static uintptr_t AddressOf(std::span<const T> row, size_t i) {
    return reinterpret_cast<uintptr_t>(row.data()) + i * sizeof(T);
  }

  template <typename T>
  void Ask(std::span<const T> row, size_t points) const {
    AskForLines(AddressOf(row, next_), points * sizeof(T));
  }

  std::span<const Vec3f> positions_;
  std::span<const uint32_t> sources_;
  std::span<const uint8_t> valid_;
  size_t next_ = 0, end_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_
