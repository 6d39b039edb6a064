// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_order.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "core/geometry/box3.h"

namespace sightline {
namespace {

// Fewer points than this are a few blocks whatever their order.
constexpr size_t kLeastPoints = 1024;
constexpr size_t kSampledSteps = 128;
// Shuffled points are half a box apart, those along a surface at most a few hundredths.
constexpr double kScatteredStep = 1.0 / 16;

constexpr int kAxisBits = 10;
constexpr int kDigitBits = 10;
static_assert(3 * kAxisBits == 3 * kDigitBits, "three passes sort a key");

// Bit i goes to bit 3i.
uint32_t Spread(uint32_t x) {
  x = (x | x << 16) & 0x030000FFu;
  x = (x | x << 8) & 0x0300F00Fu;
  x = (x | x << 4) & 0x030C30C3u;
  return (x | x << 2) & 0x09249249u;
}

Box3f BoxOf(std::span<const Vec3f> positions, std::span<const uint8_t> valid) {
  Box3f box;
  for (size_t i = 0; i < positions.size(); ++i) {
    if (valid[i]) box.Extend(positions[i]);
  }
  return box;
}

double Step(Vec3f a, Vec3f b) {
  const Vec3d d = ToDouble(a) - ToDouble(b);
  return std::abs(d.x) + std::abs(d.y) + std::abs(d.z);
}

struct Keyed {
  uint32_t key, index;
};

}  // namespace

bool IsScattered(std::span<const Vec3f> positions, std::span<const uint8_t> valid) {
  if (positions.size() < kLeastPoints) return false;
  const size_t stride = std::max<size_t>(1, positions.size() / kSampledSteps);
  Box3f box;
  double sum = 0;
  size_t steps = 0;
  for (size_t i = 0; i + 1 < positions.size(); i += stride) {
    if (!valid[i] || !valid[i + 1]) continue;
    box.Extend(positions[i]);
    sum += Step(positions[i], positions[i + 1]);
    ++steps;
  }
  return steps > 0 && sum > kScatteredStep * static_cast<double>(steps) * Step(box.lo, box.hi);
}

std::vector<uint32_t> MortonOrder(std::span<const Vec3f> positions,
                                  std::span<const uint8_t> valid) {
  const Box3f box = BoxOf(positions, valid);
  const Vec3d lo = ToDouble(box.lo), extent = ToDouble(box.hi) - lo;
  constexpr double kCells = 1 << kAxisBits;
  const auto cell = [&](Vec3f p, int axis) {
    const double share = extent[axis] > 0 ? (p[axis] - lo[axis]) / extent[axis] : 0.0;
    return static_cast<uint32_t>(std::min(share * kCells, kCells - 1));
  };
  std::vector<Keyed> keyed, sorted;
  keyed.reserve(positions.size());
  for (size_t i = 0; i < positions.size(); ++i) {
    if (!valid[i]) continue;
    const Vec3f p = positions[i];
    keyed.push_back({Spread(cell(p, 0)) | Spread(cell(p, 1)) << 1 | Spread(cell(p, 2)) << 2,
                     static_cast<uint32_t>(i)});
  }
  sorted.resize(keyed.size());
  for (int shift = 0; shift < 3 * kAxisBits; shift += kDigitBits) {
    std::array<uint32_t, size_t{1} << kDigitBits> next{};
    const auto digit = [shift](uint32_t key) { return key >> shift & ((1u << kDigitBits) - 1); };
    for (const Keyed& k : keyed) ++next[digit(k.key)];
    uint32_t start = 0;
    for (uint32_t& n : next) start += std::exchange(n, start);
    for (const Keyed& k : keyed) sorted[next[digit(k.key)]++] = k;
    keyed.swap(sorted);
  }
  std::vector<uint32_t> order(keyed.size());
  for (size_t i = 0; i < keyed.size(); ++i) order[i] = keyed[i].index;
  return order;
}

}  // namespace sightline
