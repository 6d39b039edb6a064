// SPDX-License-Identifier: Apache-2.0
#include "core/query/point_order.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/base/check.h"
#include "core/geometry/box3.h"
#include "core/query/depth_layers.h"
#include "core/query/golden_places.h"
#include "core/query/point_parter.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

constexpr size_t kSmallBlock = kSmallestPart;
// What shares a shaft (RayPacket::kMaxRays). A picture's rows come as narrow blocks of the one kind
// and as long ones of the other: hits in rows of 512 are answered for four lights at two to three
// times the rate once they are ordered.
constexpr size_t kLargeBlock = 256;
// Blocks are looked at where so many large ones follow one another, in so many places.
constexpr size_t kWindowBlocks = 64, kMostWindows = 4;
// Fewer samples pay for fewer blocks.
constexpr size_t kThoroughSamples = 4;
// Ordering a point costs about what one light does whose rays take so many cycles. What an order
// saves grows with how many times as wide the blocks are that it would make narrow: for two such
// lights it pays from 3.7 times on, for four from 2.5 times on (the pictures of seven scenes in
// rows, in tiles and in strips).
constexpr float kOrderCost = 52;
constexpr double kWorthwhile = 5;
constexpr double kLeastExcess = 1.25;
// Less than two such lights pay for no such look: there only shuffled points, which any block gives
// away, are worth ordering. Theirs are 18 to 27 times as wide as pieces of the surface that all lie
// on, those of a picture 1 to 5 times.
constexpr double kLeastLights = 2;
constexpr size_t kFewBlocks = 8;
constexpr double kShuffled = 9;
// How many times as much rays would have taken without points parted, about: 1.4 to 1.6 times over
// foliage, where it matters most.
constexpr float kPartingGain = 1.5f;
// Sorting a point by depth costs some ten cycles, and must spare as many as the first number: rays
// between buildings spare less than leaves' do. Where a point's rays take fewer than the second, no
// look at a sample, a cycle a point, pays; where they take more than the third, points parted do:
// what the two orders spare differs by a twentieth, what they cost by 25 cycles.
constexpr float kLayersPay = 15, kLeastOrderedRays = 48, kMostLayeredRays = 500;

// What share of their cycles rays spare by layers that make blocks so many times as narrow: by the
// shadows and suns of foliage, tile by tile, 5 to 20 % for 1.05 times, 18 to 30 for twice, 25 to 40
// for three times and 31 to 45 where it is more, the suns' shares the greater ones.
constexpr double kMostSpared = 0.42, kGainOfNone = 0.7;
float ShareSpared(double gain) {
  return static_cast<float>(kMostSpared * (1 - kGainOfNone / gain));
}

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
  static_assert(kSmallBlock == 2 * hn::MaxLanes(Eight()) && sizeof(Vec3f) == 3 * sizeof(float));
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

// How wide blocks are, in the mean.
class MeanWidth {
 public:
  void Add(const Box3f& box) {
    sum_ += Norm1(box);
    ++count_;
  }
  double Get() const { return count_ > 0 ? sum_ / static_cast<double>(count_) : 0; }
  size_t count() const { return count_; }

 private:
  double sum_ = 0;
  size_t count_ = 0;
};

// Whether a few small blocks are far wider in the order given than they would be if they divided
// the surface that all lie on among them.
bool AreShuffled(std::span<const Vec3f> positions, std::span<const uint8_t> valid) {
  const size_t there = positions.size() / kSmallBlock;
  const double part = static_cast<double>(kSmallBlock) / static_cast<double>(positions.size());
  Box3f all;
  MeanWidth width;
  const auto widths = [&] {
    // Squares of the surface; or, where that is but a line, pieces of it.
    const Vec3d e = Extent(all);
    const double area = e.x * e.y + e.y * e.z + e.z * e.x;
    return width.Get() / std::max(2 * std::sqrt(area * part), Norm1(all) * part);
  };
  for (size_t i = 0; i < kFewBlocks; ++i) {
    const size_t first = GoldenPlace(i, there) * kSmallBlock;
    Box3f block;
    if (std::memchr(valid.data() + first, 0, kSmallBlock) == nullptr) {
      block = BoxOfBlock(&positions[first]);
    } else {
      size_t met = 0;
      for (size_t p = first; p < first + kSmallBlock; ++p) {
        if (!valid[p]) continue;
        block.Extend(positions[p]);
        ++met;
      }
      if (2 * met < kSmallBlock) continue;
    }
    all.Extend(block);
    width.Add(block);
    // Two blocks of shuffled points reach over as much as many of them do.
    if (width.count() == 2 && widths() < kShuffled / 3) return false;
  }
  return width.Get() > 0 && widths() >= kShuffled;
}

// How many times as wide blocks are in the order given as they would be in one of their own.
class Excess {
 public:
  // Some points that follow one another: blocks of them, `stride` apart, that are told by sixteen
  // points each.
  void Look(std::span<const Vec3f> positions, std::span<const uint8_t> valid, size_t stride) {
    std::vector<Vec3f> sample;
    sample.reserve(positions.size() / stride);
    for (size_t first = 0; first + kSmallBlock * stride <= positions.size();
         first += kSmallBlock * stride) {
      const size_t before = sample.size();
      Box3f block;
      for (size_t k = 0; k < kSmallBlock; ++k) {
        // Anywhere within the stride, so that points of several rows do not stand below each other.
        const size_t number = first + k * stride, p = number + GoldenPlace(number, stride);
        if (!valid[p]) continue;
        block.Extend(positions[p]);
        sample.push_back(positions[p]);
      }
      if (2 * (sample.size() - before) >= kSmallBlock) given_.Add(block);
    }
    const PartedPoints parted = InSpatialOrder(sample, std::vector<uint8_t>(sample.size(), 1));
    for (size_t first = 0; first + kSmallBlock <= parted.positions.size(); first += kSmallBlock) {
      Box3f block;
      for (size_t k = 0; k < kSmallBlock; ++k) block.Extend(parted.positions[first + k]);
      parted_.Add(block);
    }
  }

  double Get() const { return parted_.Get() > 0 ? given_.Get() / parted_.Get() : 0; }

 private:
  MeanWidth given_, parted_;
};

// Of small blocks or large ones, whichever is more.
double ExcessWidth(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                   size_t samples) {
  const size_t there = positions.size() / kLargeBlock;
  const size_t share = std::min(samples, kThoroughSamples);
  const size_t blocks = std::min(there, kWindowBlocks * share / kThoroughSamples);
  const size_t windows = std::clamp<size_t>(there / (2 * kWindowBlocks), 1, kMostWindows);
  Excess small, large;
  for (size_t w = 0; w < windows; ++w) {
    const size_t first = (2 * w + 1) * (there - blocks) / (2 * windows) * kLargeBlock;
    large.Look(positions.subspan(first, blocks * kLargeBlock),
               valid.subspan(first, blocks * kLargeBlock), kLargeBlock / kSmallBlock);
    const size_t middle = first + blocks / 2 * kLargeBlock;
    small.Look(positions.subspan(middle, kLargeBlock), valid.subspan(middle, kLargeBlock), 1);
  }
  return std::max(small.Get(), large.Get());
}

}  // namespace

bool OrderingPays(std::span<const Vec3f> positions, std::span<const uint8_t> valid, size_t samples,
                  float ray_cost) {
  if (positions.size() < kLeastOrderedPoints || samples == 0) return false;
  if (AreShuffled(positions, valid)) return true;
  const double lights =
      static_cast<double>(samples) * (ray_cost > 0 ? double{ray_cost / kOrderCost} : 1.0);
  if (lights < kLeastLights) return false;
  return lights * (ExcessWidth(positions, valid, samples) - kLeastExcess) >= kWorthwhile;
}

std::optional<OwnOrder> OrderThatPays(std::span<const Vec3f> positions,
                                      std::span<const uint8_t> valid, size_t samples,
                                      float ray_cost, SimdTarget simd, const CancelToken* cancel) {
  if (positions.size() < kLeastOrderedPoints || samples == 0) return std::nullopt;
  const float rays = static_cast<float>(samples) * ray_cost;
  const bool known = ray_cost > 0;
  if (known && rays < kLeastOrderedRays) return std::nullopt;  // No order spares more than that.
  if (known && rays < kMostLayeredRays) {
    const DepthLayers layers(positions, valid);
    const float spared = layers.gain() > 1 ? ShareSpared(layers.gain()) : 0;
    if (rays * spared >= kLayersPay) return OwnOrder{layers.Order(cancel), 1 / (1 - spared)};
  }
  if (!OrderingPays(positions, valid, samples, ray_cost)) return std::nullopt;
  return OwnOrder{InSpatialOrder(positions, valid, simd, cancel), kPartingGain};
}

std::vector<uint32_t> SpatialOrder(std::span<const Vec3f> positions,
                                   std::span<const uint8_t> valid) {
  const PartedPoints parted = InSpatialOrder(positions, valid);
  return {parted.numbers.begin(), parted.numbers.end()};
}

PartedPoints InSpatialOrder(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                            SimdTarget simd, const CancelToken* cancel) {
  SIGHTLINE_CHECK(positions.size() < uint64_t{1} << 31);
  PartedPoints parted;
  PointParterFor(simd)(positions, valid, cancel, &parted);
  return parted;
}

PointOrders::PointOrders(std::span<const Vec3f> positions, std::span<const uint8_t> valid,
                         ThreadPool& pool, const CancelToken* cancel) {
  // Made once and used for as many lights as come: it is enough that it would help with many.
  constexpr size_t kManySamples = 32;
  const size_t blocks = (positions.size() + kBlock - 1) / kBlock;
  std::vector<std::vector<uint32_t>> orders(blocks);
  std::vector<uint8_t> helps(blocks);
  const auto order_blocks = [&](size_t begin, size_t end) {
    for (size_t b = begin; b < end; ++b) {
      const size_t first = b * kBlock, count = std::min(kBlock, positions.size() - first);
      const auto some = positions.subspan(first, count);
      const auto flags = valid.subspan(first, count);
      helps[b] = OrderingPays(some, flags, kManySamples);
      if (helps[b]) {
        orders[b] = SpatialOrder(some, flags);
        continue;
      }
      orders[b].reserve(count);
      for (size_t i = 0; i < count; ++i) {
        if (flags[i]) orders[b].push_back(static_cast<uint32_t>(i));
      }
    }
  };
  pool.ParallelFor(blocks, 1, order_blocks, cancel);
  if (cancel != nullptr && cancel->cancelled()) return;
  if (std::count(helps.begin(), helps.end(), 1) == 0) return;
  begins_.reserve(blocks + 1);
  size_t all = 0;
  for (const std::vector<uint32_t>& order : orders) {
    begins_.push_back(all);
    all += order.size();
  }
  begins_.push_back(all);
  numbers_.reserve(all);
  for (const std::vector<uint32_t>& order : orders) {
    numbers_.insert(numbers_.end(), order.begin(), order.end());
  }
}

std::vector<uint32_t> PointOrders::Of(size_t begin, size_t count) const {
  std::vector<uint32_t> order;
  order.reserve(count);
  for (size_t b = begin / kBlock; b * kBlock < begin + count; ++b) {
    // Numbers that lie before `begin` wrap around.
    const size_t from = b * kBlock - begin;
    for (size_t i = begins_[b]; i < begins_[b + 1]; ++i) {
      const size_t number = from + numbers_[i];
      if (number < count) order.push_back(static_cast<uint32_t>(number));
    }
  }
  return order;
}

uint64_t PointOrders::BytesFor(uint64_t points, int threads) {
  const uint64_t blocks = (points + kBlock - 1) / kBlock;
  // The numbers, by themselves and together; and the blocks that are being parted: both sides' rows
  // (point_parter-inl.h), numbers and positions.
  constexpr uint64_t kParted = 8 * sizeof(float) + sizeof(uint32_t) + sizeof(Vec3f);
  return 2 * points * sizeof(uint32_t) +
         (blocks + 1) * (sizeof(size_t) + sizeof(std::vector<uint32_t>)) +
         std::min<uint64_t>(blocks, threads) * (kBlock + 2 * kSmallestPart) * kParted;
}

uint64_t PointOrders::MemoryBytes() const {
  return numbers_.capacity() * sizeof(uint32_t) + begins_.capacity() * sizeof(size_t);
}

}  // namespace sightline
