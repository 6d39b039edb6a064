// SPDX-License-Identifier: Apache-2.0
//
// What each stage of a shaft's walk left to the next (shaft-inl.h). Of a node's eight boxes those
// that met the shaft are among the nodes and leaves visited. Not part of an answer.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_TRAVERSE_SHAFT_STATS_H_
#define SIGHTLINE_CORE_TRAVERSE_SHAFT_STATS_H_

#include <cstdint>

namespace sightline {

struct ShaftStats {
  uint64_t triangles = 0;  // In the leaves visited.
  uint64_t relevant = 0;   // Those whose vertices and edges the shaft may meet.
  uint64_t pairs = 0;      // Of a relevant triangle and a block of sixteen rays that it may touch.
  uint64_t covers = 0;     // Pairs whose triangle covers the block: no test decides.
  uint64_t splits = 0;     // Sets of rays parted in two.
  uint64_t singles = 0;    // Rays left to be walked one by one.

  void Add(const ShaftStats& other) {
    triangles += other.triangles;
    relevant += other.relevant;
    pairs += other.pairs;
    covers += other.covers;
    splits += other.splits;
    singles += other.singles;
  }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_TRAVERSE_SHAFT_STATS_H_
