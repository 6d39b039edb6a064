// SPDX-License-Identifier: Apache-2.0
//
// What a child slot of a BVH's node refers to: nothing, a node or a leaf.
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_ACCEL_CHILD_REF_H_
#define SIGHTLINE_CORE_ACCEL_CHILD_REF_H_

#include <cstdint>

namespace sightline {

inline constexpr int kMaxLeafTriangles = 16;
inline constexpr int kUnitTriangles = 4;  // A leaf takes whole units of as many.

// What hangs in a child slot. Leaves: bit 31 set, bits 27-30 triangle count - 1, bits 0-26 first
// unit.
class ChildRef {
 public:
  static constexpr uint32_t kLeafBit = 0x80000000u;
  static constexpr uint32_t kMaxUnit = (1u << 27) - 2;  // One below, so that no leaf looks empty.
  constexpr ChildRef() = default;
  static constexpr ChildRef Empty() { return ChildRef(0xFFFFFFFFu); }
  static constexpr ChildRef FromBits(uint32_t bits) { return ChildRef(bits); }
  static constexpr ChildRef Inner(uint32_t node) { return ChildRef(node); }
  // REQUIRES: 1 <= count <= kMaxLeafTriangles, unit <= kMaxUnit.
  static constexpr ChildRef Leaf(uint32_t unit, uint32_t count) {
    return ChildRef(kLeafBit | ((count - 1) << 27) | unit);
  }
  constexpr bool is_empty() const { return bits_ == 0xFFFFFFFFu; }
  constexpr bool is_leaf() const { return (bits_ & kLeafBit) != 0 && !is_empty(); }
  constexpr bool is_inner() const { return (bits_ & kLeafBit) == 0; }
  constexpr uint32_t node() const { return bits_; }
  constexpr uint32_t leaf_unit() const { return bits_ & ((1u << 27) - 1); }
  constexpr uint32_t leaf_count() const { return ((bits_ >> 27) & 15u) + 1; }
  constexpr uint32_t leaf_units() const { return (leaf_count() + 3) / 4; }
  constexpr uint32_t bits() const { return bits_; }
  friend constexpr bool operator==(ChildRef, ChildRef) = default;

 private:
  explicit constexpr ChildRef(uint32_t bits) : bits_(bits) {}
  uint32_t bits_ = 0xFFFFFFFFu;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_ACCEL_CHILD_REF_H_
