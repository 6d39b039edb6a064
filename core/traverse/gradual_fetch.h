// SPDX-License-Identifier: Apache-2.0
//
// Points to come, brought into the cache a few at a time, while something else is computed. Asked
// for all at once, dozens of lines that no cache holds would stop a core until the first of them
// arrive.
//
// Thread safety: one thread's own.
//
//   GradualFetch fetch(positions, sources, valid);
//   fetch.Resume(asked_before);
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

class GradualFetch {
 public:
  static constexpr size_t kPointsAtOnce = 32;

  GradualFetch() = default;  // Of no points.
  // Rows of as many points, or none of the latter two. Nothing is asked for until it is said how
  // far.
  GradualFetch(std::span<const Vec3f> positions, std::span<const uint32_t> sources,
               std::span<const uint8_t> valid)
      : positions_(reinterpret_cast<uintptr_t>(positions.data())),
        sources_(reinterpret_cast<uintptr_t>(sources.data())),
        valid_(reinterpret_cast<uintptr_t>(valid.data())),
        count_(positions.size()),
        has_sources_(!sources.empty()),
        has_valid_(!valid.empty()) {
    SIGHTLINE_DCHECK(sources.empty() || sources.size() == count_);
    SIGHTLINE_DCHECK(valid.empty() || valid.size() == count_);
  }

  bool empty() const { return count_ == 0; }

  // Goes on where another has come to, if that is among these points: with the one at `address`.
  void Resume(uintptr_t address) {
    if (address < positions_ || address > positions_ + count_ * sizeof(Vec3f)) return;
    next_ = (address - positions_) / sizeof(Vec3f);
  }
  // Where the first position that was not asked for lies.
  uintptr_t at() const { return positions_ + next_ * sizeof(Vec3f); }

  // Points from this one on are not asked for.
  void Until(size_t point) { end_ = std::min(point, count_); }
  bool done() const { return next_ >= end_; }

  // The next few points. Some that follow may be among them, or what lies behind the rows.
  void Some() {
    if (done()) return;
    Ask<kPointsAtOnce * sizeof(Vec3f)>(at());
    if (has_sources_) Ask<kPointsAtOnce * sizeof(uint32_t)>(sources_ + next_ * sizeof(uint32_t));
    if (has_valid_) Ask<kPointsAtOnce>(valid_ + next_);
    next_ = std::min(next_ + kPointsAtOnce, count_);
  }

 private:
  static constexpr size_t kLineBytes = 64;

  // To the second level: the first one is what walks work in. By assembly, since GCC takes a
  // function that does nothing but prefetch for one without effect, and drops it.
  template <size_t kBytes>
  static void Ask(uintptr_t at) {
    for (size_t from = 0; from < kBytes; from += kLineBytes) {
      asm volatile("prefetcht1 %0" : : "m"(*reinterpret_cast<const char*>(at + from)));
    }
  }

  uintptr_t positions_ = 0, sources_ = 0, valid_ = 0;
  size_t count_ = 0, next_ = 0, end_ = 0;
  bool has_sources_ = false, has_valid_ = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_GRADUAL_FETCH_H_
