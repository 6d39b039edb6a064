// SPDX-License-Identifier: Apache-2.0
//
// The exact sweep of the surface area heuristic over a cell's references: where to split it.
// Private to core/accel.
//
// A reference begins and ends along each axis, or lies flat in a plane; these events are kept in
// one sorted list per axis. Between two events the number of references on either side of a plane
// does not change, and the cost is linear in its position: the best plane is at an event.
//
// Thread safety: plain values and functions.
//
//   const KdSplit split = FindKdSplit(cell, refs.size(), events, 1.0);
#ifndef SIGHTLINE_CORE_ACCEL_KD_SWEEP_H_
#define SIGHTLINE_CORE_ACCEL_KD_SWEEP_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/geometry/box3.h"

namespace sightline::kd_build {

// Ordered by position; at one position, ends come before flat ones, and those before beginnings.
struct KdEvent {
  enum Kind : uint32_t { kEnd = 0, kFlat = 1, kBegin = 2 };

  float at;
  uint32_t ref_and_kind;  // A reference by its number in the cell, and two bits.

  KdEvent() = default;
  KdEvent(float at, uint32_t ref, Kind kind) : at(at), ref_and_kind(ref << 2 | kind) {}
  Kind kind() const { return static_cast<Kind>(ref_and_kind & 3u); }
  uint32_t ref() const { return ref_and_kind >> 2; }
  friend bool operator<(const KdEvent& a, const KdEvent& b) {
    if (a.at != b.at) return a.at < b.at;
    if (a.kind() != b.kind()) return a.kind() < b.kind();
    return a.ref() < b.ref();
  }
};
inline constexpr uint64_t kMaxCellRefs = uint64_t{1} << 30;
static_assert((kMaxCellRefs - 1) << 2 <= std::numeric_limits<uint32_t>::max());

using KdEvents = std::array<std::vector<KdEvent>, 3>;  // By axis, sorted.

// Appends the events of a box with this number.
void AppendEvents(const Box3f& box, uint32_t ref, int axis, std::vector<KdEvent>* events);

struct KdSplit {
  int axis = -1;  // -1: no plane takes anything off.
  float at = 0;
  bool flat_below = false;  // Whether references that lie in the plane go to the lower child.
  // traversal_cost + the references of the children, weighted by their areas over the cell's.
  double cost = std::numeric_limits<double>::infinity();
  uint64_t below = 0, above = 0;  // References of the children; those across count in both.
};

// The plane of least cost strictly within the cell; ties go to the lowest axis and position. A
// split that leaves one side empty costs less (kEmptyBonus). Axes are swept in parallel where there
// is enough to do.
KdSplit FindKdSplit(const Box3f& cell, size_t refs, const KdEvents& events, double traversal_cost);

// Cutting off empty space helps rays more than areas tell: they end there. (Havran's thesis, and
// all builders since: 0.8.)
inline constexpr double kEmptyBonus = 0.8;

}  // namespace sightline::kd_build

#endif  // SIGHTLINE_CORE_ACCEL_KD_SWEEP_H_
