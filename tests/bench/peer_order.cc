// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/peer_order.h"

#include <algorithm>
#include <array>
#include <utility>

#include "core/geometry/box3.h"

namespace sightline::bench {
namespace {

constexpr int kBits = 10;  // Of each axis, and of each pass.
constexpr uint32_t kCells = 1u << kBits;

// Bit i of ten goes to bit 3i.
uint32_t Spread(uint32_t x) {
  x = (x | x << 16) & 0x030000FFu;
  x = (x | x << 8) & 0x0300F00Fu;
  x = (x | x << 4) & 0x030C30C3u;
  return (x | x << 2) & 0x09249249u;
}

}  // namespace

void PeerOrder::Sort(std::span<const Vec3f> positions) {
  const size_t n = positions.size();
  keyed_.resize(n);
  other_.resize(n);
  sorted_.resize(n);
  Box3f box;
  for (const Vec3f p : positions) box.Extend(p);
  Vec3f scale{};
  for (int axis = 0; axis < 3 && n > 0; ++axis) {
    const float extent = box.hi[axis] - box.lo[axis];
    scale[axis] = extent > 0 ? static_cast<float>(kCells) / extent : 0.0f;
  }
  for (size_t i = 0; i < n; ++i) {
    uint32_t code = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const float cell = (positions[i][axis] - box.lo[axis]) * scale[axis];
      code |= Spread(std::min(static_cast<uint32_t>(cell), kCells - 1)) << axis;
    }
    keyed_[i] = {code, static_cast<uint32_t>(i)};
  }
  for (int pass = 0; pass < 3; ++pass) {
    const int shift = pass * kBits;
    std::array<size_t, kCells> next{};
    for (const Keyed& k : keyed_) ++next[k.code >> shift & (kCells - 1)];
    size_t begin = 0;
    for (size_t& of_digit : next) begin += std::exchange(of_digit, begin);
    for (const Keyed& k : keyed_) other_[next[k.code >> shift & (kCells - 1)]++] = k;
    std::swap(keyed_, other_);
  }
  for (size_t i = 0; i < n; ++i) sorted_[i] = positions[keyed_[i].number];
}

void PeerOrder::PutBack(const uint8_t* bits, size_t first, size_t count, uint8_t* row) const {
  for (size_t i = 0; i < count; ++i) {
    const uint32_t to = number(first + i);
    row[to / 8] = static_cast<uint8_t>(row[to / 8] | (bits[i / 8] >> (i % 8) & 1) << (to % 8));
  }
}

}  // namespace sightline::bench
