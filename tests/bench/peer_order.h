// SPDX-License-Identifier: Apache-2.0
//
// Points in the order of their Morton codes: neighbours in space become neighbours in the arrays,
// which is what the peer's packets and streams need of points that come in no order, or in a
// mesh's.
//
// A code is that of the cell that a point lies in among 1024³ that divide the points' box; points
// of one cell keep the order they came in. Sorting takes three passes over the points, with ten
// bits of the code in each: some ten nanoseconds a point, which are part of the peer's time.
//
// Thread safety: a PeerOrder belongs to one thread at a time; it keeps its memory from sort to
// sort.
//
//   PeerOrder order;
//   order.Sort(positions);
//   TracePoints(scene, mode, order.positions(), sample, bits.data());
//   order.PutBack(bits.data(), /*first=*/0, positions.size(), lit_bits);
#ifndef SIGHTLINE_TESTS_BENCH_PEER_ORDER_H_
#define SIGHTLINE_TESTS_BENCH_PEER_ORDER_H_

#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/aligned_vector.h"
#include "core/geometry/vec3.h"

namespace sightline::bench {

class PeerOrder {
 public:
  // REQUIRES: finite, fewer than 2^32.
  void Sort(std::span<const Vec3f> positions);
  // As they were sorted.
  std::span<const Vec3f> positions() const { return sorted_; }
  // Which one stands at place i of them.
  uint32_t number(size_t i) const { return keyed_[i].number; }
  // Bits of the places from `first` on, `count` of them, set where they belong in a row of the
  // points as they came. REQUIRES: `row` holds zeros there.
  void PutBack(const uint8_t* bits, size_t first, size_t count, uint8_t* row) const;

 private:
  struct Keyed {
    uint32_t code, number;
  };
  AlignedVector<Keyed> keyed_, other_;
  AlignedVector<Vec3f> sorted_;
};

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_PEER_ORDER_H_
