// SPDX-License-Identifier: Apache-2.0
//
// Numbers distinct positions in the order in which they first appear: equal coordinates, equal
// number (0 and -0 are equal; two NaN vertices, which all bear the same bits here, are too). An
// open hash table that grows; 4 bytes a slot beside the positions themselves.
//
// The hash is salted by a number that no file knows, so that none can be made whose positions
// collide, each insertion a walk past all others. Numbers do not depend on the salt.
//
// Thread safety: one table per thread.
//
//   PositionTable table;
//   uint32_t id = table.Insert({1, 2, 3});   // 0
//   table.Insert({1, 2, 3});                 // 0 again
#ifndef SIGHTLINE_CLIENT_IMPORT_POSITION_TABLE_H_
#define SIGHTLINE_CLIENT_IMPORT_POSITION_TABLE_H_

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/base/mix_bits.h"
#include "core/geometry/vec3.h"

namespace sightline {

class PositionTable {
 public:
  PositionTable() : PositionTable(ProcessSalt()) {}
  // For tests, which must know the salt to make positions that collide.
  explicit PositionTable(uint64_t salt) : salt_(salt) {}

  // REQUIRES: fewer than 2^32 - 1 positions so far; p is finite or a CanonicalVertex.
  uint32_t Insert(Vec3d p) {
    if (2 * (positions_.size() + 1) > slots_.size()) Grow();
    uint32_t& slot = Find(p);
    if (slot == 0) {
      positions_.push_back(p);
      slot = static_cast<uint32_t>(positions_.size());
    }
    return slot - 1;
  }

  const std::vector<Vec3d>& positions() const { return positions_; }
  std::vector<Vec3d> TakePositions() { return std::move(positions_); }

  // The most slots that are looked at to find one of the positions: 1 where none collide.
  uint64_t LongestProbe() const {
    const uint64_t mask = slots_.size() - 1;
    uint64_t longest = 0;
    for (uint64_t i = 0; i < slots_.size(); ++i) {
      if (slots_[i] == 0) continue;
      longest = std::max(longest, ((i - Hash(positions_[slots_[i] - 1])) & mask) + 1);
    }
    return longest;
  }

 private:
  // Drawn at random when it is first asked for, the same from then on.
  static uint64_t ProcessSalt();

  // Adding 0 turns -0 into 0 and leaves every other value's bits as they are.
  static uint64_t Bits(double x) { return std::bit_cast<uint64_t>(x + 0.0); }
  static bool Same(Vec3d a, Vec3d b) {
    return Bits(a.x) == Bits(b.x) && Bits(a.y) == Bits(b.y) && Bits(a.z) == Bits(b.z);
  }

  uint64_t Hash(Vec3d p) const {
    return MixBits(MixBits(MixBits(Bits(p.x) + salt_) + Bits(p.y)) + Bits(p.z));
  }

  // The slot that holds p's number + 1, or the empty one where it belongs.
  uint32_t& Find(Vec3d p) {
    const uint64_t mask = slots_.size() - 1;
    for (uint64_t i = Hash(p) & mask;; i = (i + 1) & mask) {
      if (slots_[i] == 0 || Same(positions_[slots_[i] - 1], p)) return slots_[i];
    }
  }

  void Grow() {
    slots_.assign(slots_.empty() ? 64 : 2 * slots_.size(), 0);
    for (size_t i = 0; i < positions_.size(); ++i)
      Find(positions_[i]) = static_cast<uint32_t>(i + 1);
  }

  uint64_t salt_;
  std::vector<Vec3d> positions_;
  std::vector<uint32_t> slots_;  // A power of two, at most half full; 0 is empty.
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_POSITION_TABLE_H_
