// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_sweep.h"

#include "core/base/parallel.h"

namespace sightline::kd_build {
namespace {

// Below, a parallel loop over three axes costs more than it saves.
constexpr size_t kParallelRefs = 1 << 13;

// The best plane of one axis.
KdSplit Sweep(int axis, const Box3f& cell, size_t refs, const std::vector<KdEvent>& events,
              double traversal_cost) {
  KdSplit best;
  const double lo = cell.lo[axis], hi = cell.hi[axis];
  const Vec3d extent = ToDouble(cell.hi) - ToDouble(cell.lo);
  const double a = extent[(axis + 1) % 3], b = extent[(axis + 2) % 3];
  // Half areas: a·b + (a + b)·width. Doubles hold those of coordinates within 2^41 at ease.
  const double area = a * b + (a + b) * extent[axis];
  if (!(extent[axis] > 0) || !(area > 0)) return best;
  uint64_t below = 0, above = refs;
  for (size_t i = 0; i < events.size();) {
    const float at = events[i].at;
    uint64_t count[3] = {};
    for (; i < events.size() && events[i].at == at; ++i) ++count[events[i].kind()];
    above -= count[KdEvent::kEnd] + count[KdEvent::kFlat];
    if (at > lo && at < hi) {
      const double area_below = a * b + (a + b) * (at - lo),
                   area_above = a * b + (a + b) * (hi - at);
      const auto consider = [&](bool flat_below) {
        const uint64_t n_below = below + (flat_below ? count[KdEvent::kFlat] : 0);
        const uint64_t n_above = above + (flat_below ? 0 : count[KdEvent::kFlat]);
        double cost = traversal_cost + (area_below * static_cast<double>(n_below) +
                                        area_above * static_cast<double>(n_above)) /
                                           area;
        if (n_below == 0 || n_above == 0) cost *= kEmptyBonus;
        if (cost < best.cost) best = {axis, at, flat_below, cost, n_below, n_above};
      };
      consider(true);
      if (count[KdEvent::kFlat] > 0) consider(false);
    }
    below += count[KdEvent::kBegin] + count[KdEvent::kFlat];
  }
  return best;
}

}  // namespace

void AppendEvents(const Box3f& box, uint32_t ref, int axis, std::vector<KdEvent>* events) {
  if (box.lo[axis] == box.hi[axis]) {
    events->emplace_back(box.lo[axis], ref, KdEvent::kFlat);
  } else {
    events->emplace_back(box.lo[axis], ref, KdEvent::kBegin);
    events->emplace_back(box.hi[axis], ref, KdEvent::kEnd);
  }
}

KdSplit FindKdSplit(const Box3f& cell, size_t refs, const KdEvents& events, double traversal_cost) {
  KdSplit found[3];
  const auto sweep = [&](size_t begin, size_t end) {
    for (size_t axis = begin; axis < end; ++axis) {
      found[axis] = Sweep(static_cast<int>(axis), cell, refs, events[axis], traversal_cost);
    }
  };
  if (refs >= kParallelRefs) {
    ParallelFor(3, 1, sweep);
  } else {
    sweep(0, 3);
  }
  KdSplit best = found[0];
  for (int axis = 1; axis < 3; ++axis) {
    if (found[axis].cost < best.cost) best = found[axis];
  }
  return best;
}

}  // namespace sightline::kd_build
