// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_order.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/geometry/box3.h"
#include "core/query/point_parter.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

// Fewer points than this are a few blocks whatever their order.
constexpr size_t kLeastPoints = 1024;
constexpr size_t kSmallestBlock = PointParter::kSmallestBlock;
// What shares a shaft (RayPacket::kMaxRays). A picture's rows come as narrow blocks of the one kind
// and as long ones of the other: 262,144 hits in rows of 512 are answered for 145 lights at six
// times the rate once they are ordered, for three lights at twice.
constexpr size_t kLargestBlock = 256;
// About so many blocks of each are looked at: enough for a mean.
constexpr size_t kMostSmallBlocks = 32, kMostLargeBlocks = 16;
// With fewer samples fewer are, and for one no large ones: there only shuffled points, which any
// block gives away, are worth ordering, and looking at 1,300 of 4,096 is a tenth of a light's work.
constexpr size_t kThoroughSamples = 4;
// Every so manieth point of a large block tells how wide it is. Odd, so that it meets no row's.
constexpr size_t kLargeBlockStride = 5;
// Ordering a point costs about what two lights do. A light's cost grows with the blocks' spread,
// which is 1 to 2 for the hits of a smooth surface by tiles, 2 to 5 for those in rows or of
// foliage, 1 to 16 for the points of a mesh as they come and 18 to 27 for shuffled ones.
constexpr double kWorthwhile = 8;
// What an order leaves: its own blocks are no squares.
constexpr double kLeastSpread = 1.25;

Vec3d Extent(const Box3f& box) { return ToDouble(box.hi) - ToDouble(box.lo); }

double Norm1(const Box3f& box) {
  const Vec3d extent = Extent(box);
  return extent.x + extent.y + extent.z;
}

// AVX2, the floor: eight floats.
namespace hn = hwy::HWY_NAMESPACE;
using Eight = hn::CappedTag<float, 8>;
static_assert(hn::MaxLanes(Eight()) == 8, "x86-64-v3 holds eight floats in a vector");

// Of sixteen points, all valid.
Box3f BoxOfBlock(const Vec3f* points) {
  static_assert(kSmallestBlock == 2 * hn::MaxLanes(Eight()) && sizeof(Vec3f) == 3 * sizeof(float));
  const Eight d;
  const float* from = &points->x;
  hn::Vec<Eight> x0, y0, z0, x1, y1, z1;
  hn::LoadInterleaved3(d, from, x0, y0, z0);
  hn::LoadInterleaved3(d, from + 3 * hn::MaxLanes(d), x1, y1, z1);
  const auto least = [&](hn::Vec<Eight> a, hn::Vec<Eight> b) {
    return hn::GetLane(hn::MinOfLanes(d, hn::Min(a, b)));
  };
  const auto most = [&](hn::Vec<Eight> a, hn::Vec<Eight> b) {
    return hn::GetLane(hn::MaxOfLanes(d, hn::Max(a, b)));
  };
  return {{least(x0, x1), least(y0, y1), least(z0, z1)},
          {most(x0, x1), most(y0, y1), most(z0, z1)}};
}

// Some blocks of so many points as they come.
struct Blocks {
  size_t size, most, stride;
  double sum = 0;  // Of their boxes' norms.
  size_t count = 0;
};

void Look(std::span<const Vec3f> positions, std::span<const uint8_t> valid, Blocks* blocks,
          Box3f* all) {
  // Multiples of the golden ratio keep no step with rows.
  constexpr double kGolden = 0.6180339887498949;
  const size_t there = positions.size() / blocks->size;
  for (size_t i = 0; i < std::min(there, blocks->most); ++i) {
    const double at = kGolden * static_cast<double>(i);
    const auto chosen = static_cast<size_t>((at - std::floor(at)) * static_cast<double>(there));
    const size_t first = (there <= blocks->most ? i : chosen) * blocks->size;
    Box3f block;
    if (blocks->size == kSmallestBlock &&
        std::memchr(valid.data() + first, 0, kSmallestBlock) == nullptr) {
      block = BoxOfBlock(&positions[first]);
    } else {
      size_t seen = 0, met = 0;
      for (size_t p = first; p < first + blocks->size; p += blocks->stride, ++seen) {
        if (!valid[p]) continue;
        block.Extend(positions[p]);
        ++met;
      }
      if (2 * met < seen) continue;
    }
    all->Extend(block);
    blocks->sum += Norm1(block);
    ++blocks->count;
  }
}

// How wide blocks of points are in the order given, in units of what they would be if they divided
// the surface that all lie on among them; of small blocks or large ones, whichever are wider.
double Spread(std::span<const Vec3f> positions, std::span<const uint8_t> valid, size_t samples) {
  Box3f all;
  if (samples == 0) return 0;
  const size_t share = std::min(samples, kThoroughSamples);
  Blocks small = {
      .size = kSmallestBlock, .most = kMostSmallBlocks * share / kThoroughSamples, .stride = 1};
  Blocks large = {.size = kLargestBlock,
                  .most = kMostLargeBlocks * (share - 1) / (kThoroughSamples - 1),
                  .stride = kLargeBlockStride};
  Look(positions, valid, &small, &all);
  Look(positions, valid, &large, &all);
  double spread = 0;
  for (const Blocks& blocks : {small, large}) {
    if (!(blocks.sum > 0)) continue;
    const double part = static_cast<double>(blocks.size) / static_cast<double>(positions.size());
    // Squares of the surface; or, where that is but a line, pieces of it.
    const Vec3d e = Extent(all);
    const double area = e.x * e.y + e.y * e.z + e.z * e.x;
    const double least = std::max(2 * std::sqrt(area * part), Norm1(all) * part);
    spread = std::max(spread, blocks.sum / (static_cast<double>(blocks.count) * least));
  }
  return spread;
}

}  // namespace

bool OrderingPays(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                  size_t samples) {
  if (positions.size() < kLeastPoints) return false;
  return static_cast<double>(samples) * (Spread(positions, valid, samples) - kLeastSpread) >=
         kWorthwhile;
}

std::vector<uint32_t> SpatialOrder(std::span<const Vec3f> positions,
                                   std::span<const uint8_t> valid) {
  PointParter points(positions, valid);
  points.Part();
  return points.Order();
}

}  // namespace sightline
