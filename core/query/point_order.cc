// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_order.h"

#include <algorithm>
#include <cmath>

#include "core/geometry/box3.h"

namespace sightline {
namespace {

// Fewer points than this are a few blocks whatever their order.
constexpr size_t kLeastPoints = 1024;
// What a walk puts to a triangle at once (core/traverse/shaft_rays-inl.h).
constexpr size_t kSmallestBlock = 16;
// About so many blocks are looked at: enough for a mean.
constexpr size_t kMostBlocks = 32;
// Ordering a point costs about what two lights do. A light's cost grows with the blocks' spread,
// which is 1 for the hits of a smooth surface, 2 to 3 for those of foliage, 2 to 24 for the points
// of a mesh as they come and 40 to 60 for shuffled ones.
constexpr double kWorthwhile = 8;

double Norm1(const Box3f& box) {
  const Vec3d extent = ToDouble(box.hi) - ToDouble(box.lo);
  return extent.x + extent.y + extent.z;
}

// How wide blocks of points are in the order given, in units of what they would be if they divided
// the surface that all lie on among them.
double Spread(std::span<const Vec3f> positions, std::span<const uint8_t> valid) {
  Box3f all;
  double sum = 0;
  size_t blocks = 0;
  const size_t step =
      kSmallestBlock * std::max<size_t>(1, positions.size() / (kSmallestBlock * kMostBlocks));
  for (size_t first = 0; first + kSmallestBlock <= positions.size(); first += step) {
    Box3f block;
    size_t count = 0;
    for (size_t i = first; i < first + kSmallestBlock; ++i) {
      if (!valid[i]) continue;
      block.Extend(positions[i]);
      ++count;
    }
    if (count < kSmallestBlock / 2) continue;
    all.Extend(block);
    sum += Norm1(block);
    ++blocks;
  }
  const double least =
      Norm1(all) * std::sqrt(double{kSmallestBlock} / static_cast<double>(positions.size()));
  return sum > 0 ? sum / (static_cast<double>(blocks) * least) : 0;
}

struct Numbered {
  Vec3f position;
  uint32_t index;
};

// Parts the points across their widest axis, again and again. The first part takes the largest
// power of two of smallest blocks that leaves something over, so that every block of 16, 32, 64 ..
// points from the start of the order is one part.
void Part(std::span<Numbered> points) {
  while (points.size() > kSmallestBlock) {
    Box3f box;
    for (const Numbered& p : points) box.Extend(p.position);
    const Vec3f extent = box.hi - box.lo;
    int axis = extent.y > extent.x ? 1 : 0;
    if (extent.z > extent[axis]) axis = 2;
    size_t first = kSmallestBlock;
    while (2 * first < points.size()) first *= 2;
    std::nth_element(points.begin(), points.begin() + static_cast<ptrdiff_t>(first), points.end(),
                     [axis](const Numbered& a, const Numbered& b) {
                       return a.position[axis] < b.position[axis];
                     });
    Part(points.subspan(first));
    points = points.first(first);
  }
}

}  // namespace

bool OrderingPays(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                  size_t samples) {
  if (positions.size() < kLeastPoints) return false;
  return static_cast<double>(samples) * (Spread(positions, valid) - 1) >= kWorthwhile;
}

std::vector<uint32_t> SpatialOrder(std::span<const Vec3f> positions,
                                   std::span<const uint8_t> valid) {
  std::vector<Numbered> points;
  points.reserve(positions.size());
  for (size_t i = 0; i < positions.size(); ++i) {
    if (valid[i]) points.push_back({positions[i], static_cast<uint32_t>(i)});
  }
  Part(points);
  std::vector<uint32_t> order(points.size());
  for (size_t i = 0; i < points.size(); ++i) order[i] = points[i].index;
  return order;
}

}  // namespace sightline
