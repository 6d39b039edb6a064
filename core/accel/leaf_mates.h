// SPDX-License-Identifier: Apache-2.0
//
// Which triangles share an edge, by their places in a BVH's leaves: at most two of those that stand
// at its two ends are each other's mates. Where triangles are known to hide a box of points up to
// their common edges, mates tell that nothing slips between them (core/traverse/patch_cover-inl.h).
//
// A triangle's place is kUnitTriangles times its leaf's first unit, and its lane. `rows` has a leaf
// of n units at kUnitTriangles · 3 times its first one: 4n entries for edge 0, then edges 1 and 2.
// Edge e runs from corner e to corner (e + 1) % 3.
//
// Thread safety: plain values.
//
//   bvh.mates = FindLeafMates(bvh, geometry, cancel);  // leaf_mates_finder.h
//   const LeafMate mate = bvh.mates.of(leaf, edge)[lane];
//   if (mate.exists()) Visit(bvh.mates.leaf(mate), bvh.mates.lane(mate));
#ifndef SIGHTLINE_CORE_ACCEL_LEAF_MATES_H_
#define SIGHTLINE_CORE_ACCEL_LEAF_MATES_H_

#include <cstddef>
#include <cstdint>

#include "core/accel/child_ref.h"
#include "core/base/aligned_vector.h"

namespace sightline {

class LeafMate {
 public:
  // How they are stored, for who reads several at once.
  static constexpr uint32_t kNone = 0xFFFFFFFFu;  // Places end at 2^29.
  static constexpr uint32_t kSameWayBit = 1;
  static constexpr int kPlaceShift = 1;

  constexpr LeafMate() = default;  // None.
  // `same_way`: both triangles' corners run along the edge in the same direction.
  constexpr LeafMate(uint32_t place, bool same_way)
      : bits_(place << kPlaceShift | (same_way ? kSameWayBit : 0)) {}

  constexpr bool exists() const { return bits_ != kNone; }
  constexpr uint32_t place() const { return bits_ >> kPlaceShift; }
  constexpr bool same_way() const { return (bits_ & kSameWayBit) != 0; }
  friend constexpr bool operator==(LeafMate, LeafMate) = default;

 private:
  uint32_t bits_ = kNone;
};

struct LeafMates {
  static constexpr size_t kUnitBytes = kUnitTriangles * 3 * sizeof(LeafMate) + 1;

  AlignedVector<LeafMate> rows;
  AlignedVector<uint8_t> units;  // By unit: UnitCode().

  bool empty() const { return rows.empty(); }
  size_t MemoryBytes() const { return rows.size() * sizeof(LeafMate) + units.size(); }

  // By lane.
  const LeafMate* of(ChildRef leaf, int edge) const {
    return &rows[size_t{kUnitTriangles} * (3 * leaf.leaf_unit() + edge * leaf.leaf_units())];
  }
  ChildRef leaf(LeafMate mate) const {
    const uint32_t unit = mate.place() / kUnitTriangles, code = units[unit];
    return ChildRef::Leaf(unit - code % 4, code / 4 + 1);
  }
  // Of a leaf's unit k: k, and 4 times one less than the leaf has triangles.
  static constexpr uint32_t UnitCode(ChildRef leaf, uint32_t k) {
    return 4 * (leaf.leaf_count() - 1) + k;
  }
  static constexpr uint32_t PlaceOf(ChildRef leaf, uint32_t lane) {
    return kUnitTriangles * leaf.leaf_unit() + lane;
  }
  // In its own leaf.
  static constexpr uint32_t lane(ChildRef leaf, LeafMate mate) {
    return mate.place() - PlaceOf(leaf, 0);
  }
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_LEAF_MATES_H_
