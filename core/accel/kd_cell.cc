// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_cell.h"

#include <algorithm>
#include <array>
#include <iterator>

#include "core/accel/kd_clip.h"
#include "core/base/parallel.h"

namespace sightline::kd_build {
namespace {

// Below, a parallel loop over three axes costs more than it saves.
constexpr size_t kParallelRefs = 1 << 13;
// Lists are sorted in so many blocks, which are then merged by pairs: a power of two.
constexpr size_t kSortBlocks = 16;
constexpr size_t kMinParallelSort = 1 << 15;

// The order is total, so the result does not depend on how the work is cut.
void SortEvents(std::vector<KdEvent>* events) {
  const size_t n = events->size();
  if (n < kMinParallelSort) {
    std::sort(events->begin(), events->end());
    return;
  }
  const auto at = [&](size_t block) {
    return events->begin() + static_cast<ptrdiff_t>(n * std::min(block, kSortBlocks) / kSortBlocks);
  };
  ParallelFor(kSortBlocks, 1, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) std::sort(at(i), at(i + 1));
  });
  for (size_t width = 1; width < kSortBlocks; width *= 2) {
    ParallelFor(kSortBlocks / (2 * width), 1, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        std::inplace_merge(at(2 * width * i), at(2 * width * i + width), at(2 * width * (i + 1)));
      }
    });
  }
}

// By reference: where it goes, and its number there. Cut ones are numbered after the others.
struct Destination {
  static constexpr uint32_t kCut = 0xFFFFFFFEu;
  uint32_t half;    // 0 or 1, or kCut.
  uint32_t number;  // Unless cut.
};

void ForEachAxis(size_t refs, BlockFn body) {
  if (refs >= kParallelRefs) {
    ParallelFor(3, 1, body);
  } else {
    body(0, 3);
  }
}

}  // namespace

KdCell RootCell(const SceneGeometry& geometry, const CancelToken* cancel) {
  KdCell cell;
  cell.refs.reserve(geometry.triangles.size() - geometry.inert.size());
  size_t next_inert = 0;
  for (size_t i = 0; i < geometry.triangles.size(); ++i) {
    if (next_inert < geometry.inert.size() && geometry.inert[next_inert] == i) {
      ++next_inert;
      continue;
    }
    KdReference ref;
    ref.id = static_cast<uint32_t>(i);
    for (const Vec3f& corner : geometry.Corners(ref.id)) ref.box.Extend(corner);
    cell.bounds.Extend(ref.box);
    cell.refs.push_back(ref);
  }
  for (int axis = 0; axis < 3; ++axis) {
    if (cancel != nullptr && cancel->cancelled()) return cell;
    std::vector<KdEvent>& events = cell.events[axis];
    events.reserve(2 * cell.refs.size());
    for (size_t i = 0; i < cell.refs.size(); ++i) {
      AppendEvents(cell.refs[i].box, static_cast<uint32_t>(i), axis, &events);
    }
    SortEvents(&events);
  }
  return cell;
}

std::pair<KdCell, KdCell> SplitCell(const SceneGeometry& geometry, KdCell cell,
                                    const KdSplit& split, bool perfect) {
  const int axis = split.axis;
  KdCell half[2];
  half[0].bounds = half[1].bounds = cell.bounds;
  half[0].bounds.hi[axis] = half[1].bounds.lo[axis] = split.at;

  const size_t n = cell.refs.size();
  std::vector<Destination> destination(n);
  std::vector<uint32_t> cut;
  half[0].refs.reserve(split.below);
  half[1].refs.reserve(split.above);
  for (size_t i = 0; i < n; ++i) {
    const KdReference& ref = cell.refs[i];
    const float lo = ref.box.lo[axis], hi = ref.box.hi[axis];
    uint32_t to;
    if (lo == split.at && hi == split.at) {
      to = split.flat_below ? 0 : 1;
    } else if (hi <= split.at) {
      to = 0;
    } else if (lo >= split.at) {
      to = 1;
    } else {
      destination[i] = {Destination::kCut, 0};
      cut.push_back(static_cast<uint32_t>(i));
      continue;
    }
    destination[i] = {to, static_cast<uint32_t>(half[to].refs.size())};
    half[to].refs.push_back(ref);
  }
  const size_t whole[2] = {half[0].refs.size(), half[1].refs.size()};
  for (const uint32_t i : cut) {
    const KdReference& ref = cell.refs[i];
    for (KdCell& to : half) {
      KdReference part = ref;
      (&to == &half[0] ? part.box.hi : part.box.lo)[axis] = split.at;
      if (perfect) {
        part.box = ClipToBox(geometry.Corners(ref.id), part.box);
        if (part.box.empty()) continue;
      }
      to.refs.push_back(part);
    }
  }
  ForEachAxis(n, [&](size_t begin, size_t end) {
    for (size_t k = begin; k < end; ++k) {
      const int of = static_cast<int>(k);
      std::array<std::vector<KdEvent>, 2> kept;
      for (int h = 0; h < 2; ++h) kept[h].reserve(2 * whole[h]);
      for (const KdEvent& event : cell.events[of]) {
        const Destination& to = destination[event.ref()];
        if (to.half != Destination::kCut) {
          kept[to.half].emplace_back(event.at, to.number, event.kind());
        }
      }
      std::vector<KdEvent>().swap(cell.events[of]);
      for (int h = 0; h < 2; ++h) {
        std::vector<KdEvent> added;
        added.reserve(2 * (half[h].refs.size() - whole[h]));
        for (size_t i = whole[h]; i < half[h].refs.size(); ++i) {
          AppendEvents(half[h].refs[i].box, static_cast<uint32_t>(i), of, &added);
        }
        if (added.empty()) {
          half[h].events[of] = std::move(kept[h]);
          continue;
        }
        SortEvents(&added);
        half[h].events[of].reserve(kept[h].size() + added.size());
        std::merge(kept[h].begin(), kept[h].end(), added.begin(), added.end(),
                   std::back_inserter(half[h].events[of]));
      }
    }
  });
  return {std::move(half[0]), std::move(half[1])};
}

}  // namespace sightline::kd_build
