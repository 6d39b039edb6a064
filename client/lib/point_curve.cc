// SPDX-License-Identifier: Apache-2.0
#include "client/lib/point_curve.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

namespace sightline::client {
namespace {

constexpr int kAxisBits = 10;
// Three passes of a radix sort take a key, one digit each.
constexpr int kDigitBits = kAxisBits;

// Bit i goes to bit 3i.
uint32_t Spread(uint32_t x) {
  x = (x | x << 16) & 0x030000FFu;
  x = (x | x << 8) & 0x0300F00Fu;
  x = (x | x << 4) & 0x030C30C3u;
  return (x | x << 2) & 0x09249249u;
}

struct Keyed {
  uint32_t key, index;
};

std::vector<Keyed> Keys(std::span<const double> positions) {
  std::array<double, 3> low, size;
  for (size_t axis = 0; axis < 3; ++axis) {
    double least = HUGE_VAL, most = -HUGE_VAL;
    for (size_t i = axis; i < positions.size(); i += 3) {
      if (!std::isfinite(positions[i])) continue;
      least = std::min(least, positions[i]);
      most = std::max(most, positions[i]);
    }
    low[axis] = least;
    size[axis] = most - least;
  }
  constexpr double kCells = 1 << kAxisBits;
  std::vector<Keyed> keys(positions.size() / 3);
  for (size_t i = 0; i < keys.size(); ++i) {
    uint32_t key = 0;
    for (size_t axis = 0; axis < 3; ++axis) {
      const double share = (positions[3 * i + axis] - low[axis]) / size[axis];
      // False for NaNs, also where all have one coordinate, and for -infinity.
      if (share > 0) {
        key |= Spread(static_cast<uint32_t>(std::min(share * kCells, kCells - 1))) << axis;
      }
    }
    keys[i] = {key, static_cast<uint32_t>(i)};
  }
  return keys;
}

// Rows of `width` numbers in the order given.
template <typename T>
std::vector<T> Reordered(std::span<const T> rows, size_t width,
                         const std::vector<uint32_t>& order) {
  std::vector<T> out(rows.size());
  for (size_t i = 0; i < order.size() && !rows.empty(); ++i) {
    std::copy_n(rows.begin() + static_cast<ptrdiff_t>(order[i] * width), width,
                out.begin() + static_cast<ptrdiff_t>(i * width));
  }
  return out;
}

}  // namespace

PointCurve::PointCurve(const Points& points) {
  std::vector<Keyed> keys = Keys(points.positions), sorted(keys.size());
  for (int shift = 0; shift < 3 * kAxisBits; shift += kDigitBits) {
    std::array<uint32_t, size_t{1} << kDigitBits> next{};
    const auto digit = [shift](uint32_t key) { return key >> shift & ((1u << kDigitBits) - 1); };
    for (const Keyed& k : keys) ++next[digit(k.key)];
    uint32_t start = 0;
    for (uint32_t& n : next) start += std::exchange(n, start);
    for (const Keyed& k : keys) sorted[next[digit(k.key)]++] = k;
    keys.swap(sorted);
  }
  order_.reserve(keys.size());
  for (const Keyed& k : keys) order_.push_back(k.index);
  positions_ = Reordered(points.positions, 3, order_);
  source_objects_ = Reordered(points.source_objects, 1, order_);
  source_triangles_ = Reordered(points.source_triangles, 1, order_);
  normals_ = Reordered(points.normals, 3, order_);
}

}  // namespace sightline::client
