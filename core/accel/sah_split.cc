// SPDX-License-Identifier: Apache-2.0
#include "core/accel/sah_split.h"

#include <cmath>
#include <limits>

#include "core/base/check.h"

namespace sightline::bvh_build {
namespace {

// Extents below this make count / extent overflow.
constexpr float kMinExtent = 0x1p-119f;
static_assert(kMaxBins / kMinExtent < std::numeric_limits<float>::max());

}  // namespace

BinMapping::BinMapping(const Box4& centroids, int count, bool longest_axis_only)
    : base_(ClearLast(centroids.lo)), count_(count) {
  SIGHTLINE_DCHECK(count >= 2 && count <= kMaxBins);
  int longest = 0;
  const Float4 extent = centroids.hi - centroids.lo;
  for (int axis = 0; axis < 3; ++axis) {
    if (extent[axis] > extent[longest]) longest = axis;
    if (extent[axis] >= kMinExtent) scale_[axis] = static_cast<float>(count) / extent[axis];
  }
  for (int axis = 0; axis < 3 && longest_axis_only; ++axis) {
    if (axis != longest) scale_[axis] = 0;
  }
}

SahBins::SahBins(int count) : count_(count) {
  for (int i = 0; i < count_; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      bins_[i].lo[axis] = Box4().lo;
      bins_[i].hi[axis] = Box4().hi;
      bins_[i].count[axis] = 0;
    }
  }
}

void SahBins::Add(std::span<const Primitive> primitives, const BinMapping& mapping) {
  for (const Primitive& p : primitives) {
    const Int4 b = mapping.BinsOf(p);
    const Float4 lo = p.lo4(), hi = p.hi4();
    for (int axis = 0; axis < 3; ++axis) {
      Bin& bin = bins_[b[axis]];
      bin.lo[axis] = Min(bin.lo[axis], lo);
      bin.hi[axis] = Max(bin.hi[axis], hi);
      ++bin.count[axis];
    }
  }
}

void SahBins::Merge(const SahBins& other) {
  for (int i = 0; i < count_; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      bins_[i].lo[axis] = Min(bins_[i].lo[axis], other.bins_[i].lo[axis]);
      bins_[i].hi[axis] = Max(bins_[i].hi[axis], other.bins_[i].hi[axis]);
      bins_[i].count[axis] += other.bins_[i].count[axis];
    }
  }
}

SahSplit FindSplit(const SahBins& bins, const BinMapping& mapping, const SahCost& cost) {
  SahSplit best;
  best.cost = std::numeric_limits<float>::infinity();
  float right_cost[kMaxBins];
  uint32_t right_count[kMaxBins];
  for (int axis = 0; axis < 3; ++axis) {
    if (!mapping.CanSplit(axis)) continue;
    Box4 right;
    uint32_t count = 0;
    for (int b = mapping.count() - 1; b > 0; --b) {
      right.Extend(bins.bin(b).box(axis));
      count += bins.bin(b).count[axis];
      right_count[b] = count;
      right_cost[b] = count == 0 ? 0 : right.HalfArea(cost.area_scale) * cost.Subtree(count);
    }
    Box4 left;
    count = 0;
    for (int b = 1; b < mapping.count(); ++b) {
      left.Extend(bins.bin(b - 1).box(axis));
      count += bins.bin(b - 1).count[axis];
      if (count == 0 || right_count[b] == 0) continue;
      const float c = left.HalfArea(cost.area_scale) * cost.Subtree(count) + right_cost[b];
      if (c < best.cost) {
        best.axis = axis;
        best.bin = b;
        best.cost = c;
        best.left_count = count;
        best.left = left;
      }
    }
  }
  if (best.axis < 0) return best;
  for (int b = best.bin; b < mapping.count(); ++b) best.right.Extend(bins.bin(b).box(best.axis));
  return best;
}

}  // namespace sightline::bvh_build
