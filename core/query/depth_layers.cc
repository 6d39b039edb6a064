// SPDX-License-Identifier: Apache-2.0
#include "core/query/depth_layers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>

#include "core/base/check.h"
#include "core/base/polled_blocks.h"
#include "core/query/golden_places.h"
#include "core/shaft/frame.h"
#include "hwy/highway.h"

namespace sightline {
namespace {

// AVX2, the floor, for all: so that an order is the same whatever the machine.
namespace hn = hwy::HWY_NAMESPACE;
using Eight = hn::CappedTag<float, 8>;
using V = hn::Vec<Eight>;
constexpr size_t kLanes = 8;
static_assert(hn::MaxLanes(Eight()) == kLanes, "x86-64-v3 holds eight floats in a vector");

constexpr size_t kBlock = kSmallestPart;
static_assert(kBlock == 2 * kLanes);
// Blocks that are looked at, an eighth of a tile's, and how many of them must be valid.
constexpr size_t kSampleBlocks = 32, kLeastSampleBlocks = 8;
// Foliage is best off in 16 to 64, and worse in 128: blocks of a layer reach too far across a tile.
constexpr uint32_t kMostLayers = 64, kFewestLayers = 4;
// Where blocks reach over less of all depths than this there is no need to look further. Those of a
// tile of one surface, 64 pixels wide, reach over a sixteenth.
constexpr double kLeastReach = 0.06;
// Points are counted and put in their places in so many runs at once, so that neighbours in one
// layer need not wait for each other.
constexpr size_t kRuns = 4;

// Blocks of points, as rows of coordinates by axis.
struct Sample {
  size_t blocks = 0;
  alignas(32) float rows[3][kSampleBlocks * kBlock];

  size_t points() const { return blocks * kBlock; }
  V Along(Vec3f axis, size_t at) const {
    const Eight d;
    return hn::MulAdd(hn::Set(d, axis.x), hn::Load(d, rows[0] + at),
                      hn::MulAdd(hn::Set(d, axis.y), hn::Load(d, rows[1] + at),
                                 hn::Mul(hn::Set(d, axis.z), hn::Load(d, rows[2] + at))));
  }
};

// Blocks that are valid as wholes, here and there.
void Take(std::span<const Vec3f> positions, std::span<const uint8_t> valid, Sample* sample) {
  const Eight d;
  for (size_t i = 0; i < kSampleBlocks; ++i) {
    const size_t first = GoldenPlace(i, positions.size() / kBlock) * kBlock;
    if (std::memchr(valid.data() + first, 0, kBlock) != nullptr) continue;
    for (size_t half = 0; half < kBlock; half += kLanes) {
      V x, y, z;
      hn::LoadInterleaved3(d, &positions[first + half].x, x, y, z);
      const size_t at = sample->points() + half;
      hn::Store(x, d, sample->rows[0] + at);
      hn::Store(y, d, sample->rows[1] + at);
      hn::Store(z, d, sample->rows[2] + at);
    }
    ++sample->blocks;
  }
}

// The direction along which points half a block apart differ most, by the sum of squares; zero
// where they do not, or where squares overflow.
Vec3d MainDirection(const Sample& sample) {
  const Eight d;
  V xx = hn::Zero(d), yy = xx, zz = xx, xy = xx, yz = xx, zx = xx;
  for (size_t at = 0; at < sample.points(); at += kBlock) {
    V e[3];
    for (int k = 0; k < 3; ++k) {
      e[k] = hn::Sub(hn::Load(d, sample.rows[k] + at + kLanes), hn::Load(d, sample.rows[k] + at));
    }
    xx = hn::MulAdd(e[0], e[0], xx);
    yy = hn::MulAdd(e[1], e[1], yy);
    zz = hn::MulAdd(e[2], e[2], zz);
    xy = hn::MulAdd(e[0], e[1], xy);
    yz = hn::MulAdd(e[1], e[2], yz);
    zx = hn::MulAdd(e[2], e[0], zx);
  }
  const auto sum = [d](V v) { return static_cast<double>(hn::GetLane(hn::SumOfLanes(d, v))); };
  const Vec3d rows[3] = {
      {sum(xx), sum(xy), sum(zx)}, {sum(xy), sum(yy), sum(yz)}, {sum(zx), sum(yz), sum(zz)}};
  // Powers of the matrix, on the row of the greatest square.
  Vec3d v = rows[0].x >= rows[1].y && rows[0].x >= rows[2].z ? rows[0]
            : rows[1].y >= rows[2].z                         ? rows[1]
                                                             : rows[2];
  constexpr int kPowers = 6;
  for (int i = 0; i < kPowers; ++i) {
    const double most = std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    if (!(most > 0) || !std::isfinite(most)) return {};
    v = v * (1 / most);
    v = {Dot(rows[0], v), Dot(rows[1], v), Dot(rows[2], v)};
  }
  return v;
}

// How far blocks reach along an axis, in the mean, and all of them together.
struct Reach {
  double block = 0;
  float least = 0, most = 0;
};
Reach ReachAlong(Vec3f axis, const Sample& sample) {
  const Eight d;
  V least = hn::Set(d, std::numeric_limits<float>::infinity()), most = hn::Neg(least);
  Reach reach;
  for (size_t at = 0; at < sample.points(); at += kBlock) {
    const V a = sample.Along(axis, at), b = sample.Along(axis, at + kLanes);
    const V lo = hn::Min(a, b), hi = hn::Max(a, b);
    reach.block += hn::GetLane(hn::MaxOfLanes(d, hi)) - hn::GetLane(hn::MinOfLanes(d, lo));
    least = hn::Min(least, lo);
    most = hn::Max(most, hi);
  }
  reach.block /= static_cast<double>(sample.blocks);
  reach.least = hn::GetLane(hn::MinOfLanes(d, least));
  reach.most = hn::GetLane(hn::MaxOfLanes(d, most));
  return reach;
}

// The layer of each of eight points whose depths are given in layers, from the first one on.
hn::Vec<hn::RebindToSigned<Eight>> LayersOf(V depths, uint32_t layers) {
  const Eight d;
  const V last = hn::Set(d, static_cast<float>(layers - 1));
  return hn::ConvertTo(hn::RebindToSigned<Eight>(), hn::Min(hn::Max(depths, hn::Zero(d)), last));
}

// How many of the sample's points lie in each of the most layers.
std::array<uint32_t, kMostLayers> CountLayers(const Sample& sample, Vec3f axis, float first) {
  const Eight d;
  alignas(32) int32_t layer[kSampleBlocks * kBlock];
  for (size_t at = 0; at < sample.points(); at += kLanes) {
    const V depth = hn::Sub(sample.Along(axis, at), hn::Set(d, first));
    hn::Store(LayersOf(depth, kMostLayers), hn::RebindToSigned<Eight>(), layer + at);
  }
  uint32_t runs[kRuns][kMostLayers] = {};
  for (size_t i = 0; i < sample.points(); i += kRuns) {
    for (size_t run = 0; run < kRuns; ++run) ++runs[run][layer[i + run]];
  }
  std::array<uint32_t, kMostLayers> count = {};
  for (const auto& run : runs) {
    for (uint32_t l = 0; l < kMostLayers; ++l) count[l] += run[l];
  }
  return count;
}

}  // namespace

DepthLayers::DepthLayers(std::span<const Vec3f> positions, std::span<const uint8_t> valid)
    : positions_(positions), valid_(valid) {
  SIGHTLINE_DCHECK(positions.size() == valid.size() && positions.size() >= kBlock);
  Sample sample;
  Take(positions, valid, &sample);
  ShaftFrame frame;
  if (sample.blocks < kLeastSampleBlocks || !MakeShaftFrame(MainDirection(sample), {}, &frame)) {
    return;
  }
  const Reach deep = ReachAlong(frame.w, sample);
  const float range = deep.most - deep.least, scale = kMostLayers / range;
  if (!(range > 0) || !std::isfinite(scale) || deep.block < kLeastReach * range) return;
  const double across = ReachAlong(frame.u, sample).block + ReachAlong(frame.v, sample).block;
  std::array<uint32_t, kMostLayers> count =
      CountLayers(sample, frame.w * scale, deep.least * scale);
  // In layers, a block is no deeper than one of these. But a layer has a part of the pixels alone,
  // the mean of which, over points, is squares / points^2: to hold sixteen of them a block reaches
  // over as many times more pixels, and is wider across by the root of that.
  double least = std::numeric_limits<double>::infinity();
  for (uint32_t layers = kMostLayers; layers >= kFewestLayers; layers /= 2) {
    uint32_t squares = 0;
    for (uint32_t l = 0; l < layers; ++l) squares += count[l] * count[l];
    const double points = static_cast<double>(sample.points());
    const double width = std::min(deep.block, double{range} / layers) +
                         across * (points / std::sqrt(static_cast<double>(squares)));
    if (width < least) {
      least = width;
      layers_ = layers;
    }
    for (uint32_t l = 0; 2 * l < layers; ++l) count[l] = count[2 * l] + count[2 * l + 1];
  }
  gain_ = (deep.block + across) / least;
  axis_ = frame.w * (static_cast<float>(layers_) / range);
  first_ = deep.least * (static_cast<float>(layers_) / range);
}

AlignedVector<uint8_t> DepthLayers::LayersOfPoints(size_t room) const {
  const Eight d;
  const hn::Rebind<uint8_t, Eight> d8;
  const size_t n = positions_.size();
  AlignedVector<uint8_t> layer;
  layer.ResizeUninitialized(room);
  const V x_axis = hn::Set(d, axis_.x), y_axis = hn::Set(d, axis_.y), z_axis = hn::Set(d, axis_.z);
  const V first = hn::Set(d, first_);
  const auto put = [&](const Vec3f* points, uint8_t* layers) {
    V x, y, z;
    hn::LoadInterleaved3(d, &points->x, x, y, z);
    const V depth = hn::MulAdd(x_axis, x, hn::MulAdd(y_axis, y, hn::MulSub(z_axis, z, first)));
    hn::StoreU(hn::DemoteTo(d8, LayersOf(depth, layers_)), d8, layers);
  };
  size_t i = 0;
  for (; i + kLanes <= n; i += kLanes) put(&positions_[i], layer.data() + i);
  if (i < n) {
    Vec3f last[kLanes] = {};
    std::copy(positions_.begin() + static_cast<ptrdiff_t>(i), positions_.end(), last);
    put(last, layer.data() + i);
  }
  const auto none = static_cast<uint8_t>(layers_);
  std::memset(layer.data() + n, none, room - n);
  if (std::memchr(valid_.data(), 0, n) != nullptr) {
    for (size_t p = 0; p < n; ++p) layer[p] = valid_[p] != 0 ? layer[p] : none;
  }
  return layer;
}

PartedPoints DepthLayers::Order(const CancelToken* cancel) const {
  SIGHTLINE_CHECK_GT(layers_, 0u) << "no layers were found";
  const size_t n = positions_.size();
  const size_t run = (n + kRuns * kLanes - 1) / (kRuns * kLanes) * kLanes;
  const AlignedVector<uint8_t> layer = LayersOfPoints(kRuns * run);
  // Of each layer and run how many there are, then where the next one goes, and which way from
  // there.
  std::array<std::array<uint32_t, kRuns>, kMostLayers + 1> place = {};
  const bool counted = InPolledBlocks(run, cancel, [&](size_t begin, size_t end) {
    for (size_t p = begin; p < end; ++p) {
      for (size_t r = 0; r < kRuns; ++r) ++place[layer[r * run + p]][r];
    }
  });
  if (!counted) return {};
  std::array<int32_t, kMostLayers + 1> step = {};
  uint32_t before = 0, valid = 0;
  for (uint32_t l = 0; l <= layers_; ++l) {
    const bool backward = l % 2 != 0;
    step[l] = backward ? -1 : 1;
    if (l == layers_) valid = before;
    for (size_t k = 0; k < kRuns; ++k) {
      uint32_t& own = place[l][backward ? kRuns - 1 - k : k];
      const uint32_t count = own;
      own = backward ? before + count - 1 : before;
      before += count;
    }
  }
  PartedPoints order;
  order.numbers.ResizeUninitialized(kRuns * run);
  order.positions.ResizeUninitialized(kRuns * run);
  order.ranks.ResizeUninitialized(kRuns * run);
  const bool placed = InPolledBlocks(run, cancel, [&](size_t begin, size_t end) {
    for (size_t p = begin; p < end; ++p) {
      for (size_t r = 0; r < kRuns; ++r) {
        const size_t point = r * run + p;
        uint32_t& own = place[layer[point]][r];
        const uint32_t at = own;
        own = at + static_cast<uint32_t>(step[layer[point]]);
        order.ranks[point] = at;
        order.numbers[at] = static_cast<uint32_t>(point);
        if (point < n) order.positions[at] = positions_[point];
      }
    }
  });
  if (!placed) return {};
  order.numbers.resize(valid);
  order.positions.resize(valid);
  order.ranks.resize((n + kLanes - 1) / kLanes * kLanes);
  const auto nowhere = static_cast<uint32_t>(n);
  std::fill(order.ranks.begin() + static_cast<ptrdiff_t>(n), order.ranks.end(), nowhere);
  if (valid < n) {
    for (size_t p = 0; p < n; ++p) order.ranks[p] = valid_[p] != 0 ? order.ranks[p] : nowhere;
  }
  return order;
}

}  // namespace sightline
