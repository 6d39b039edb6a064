// SPDX-License-Identifier: Apache-2.0
#include "core/accel/sah_split.h"

#include <cmath>
#include <limits>

#include "core/base/check.h"

namespace sightline::bvh_build {
namespace {

// Extents below this make count / extent overflow.
constexpr float kMinExtent = 0x1p-119f;
// Below this many primitives a second table costs more than it saves.
constexpr size_t kTwoTables = 64;
static_assert(kMaxBins / kMinExtent < std::numeric_limits<float>::max());

}  // namespace

BinMapping::BinMapping(const BuildBox& centroids, int count, bool longest_axis_only)
    : base_{centroids.lo(0), centroids.lo(1), centroids.lo(2), 0}, count_(count) {
  SIGHTLINE_DCHECK(count >= 2 && count <= kMaxBins);
  const int longest = centroids.widest_axis();
  for (int axis = 0; axis < 3; ++axis) {
    if (longest_axis_only && axis != longest) continue;
    const float extent = centroids.extent(axis);
    if (extent >= kMinExtent) scale_[axis] = static_cast<float>(count) / extent;
  }
}

SahBins::SahBins(int count) : count_(count) {
  const Float8 empty = BuildBox().faces;
  for (int i = 0; i < count_; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      bins_[i].faces[axis] = empty;
      bins_[i].count[axis] = 0;
    }
  }
}

void SahBins::Add(std::span<const Primitive> primitives, const BinMapping& mapping) {
  for (const Primitive& p : primitives) {
    const Int4 b = mapping.BinsOf(p);
    const Float8 box = p.box();
    for (int axis = 0; axis < 3; ++axis) {
      Bin& bin = bins_[b[axis]];
      bin.faces[axis] = Min(bin.faces[axis], box);
      ++bin.count[axis];
    }
  }
}

void SahBins::AddAxis(std::span<const Primitive> primitives, const BinMapping& mapping, int axis) {
  const auto add = [&](const Primitive& p, Bin* bins) {
    Bin& bin = bins[mapping.BinOf(p, axis)];
    bin.faces[axis] = Min(bin.faces[axis], p.box());
    ++bin.count[axis];
  };
  if (primitives.size() < kTwoTables) {
    for (const Primitive& p : primitives) add(p, bins_);
    return;
  }
  // Neighbours fall into one bin, and a bin's next minimum waits for its last: two tables by turns.
  SahBins other(count_);
  size_t i = 0;
  for (; i + 1 < primitives.size(); i += 2) {
    add(primitives[i], bins_);
    add(primitives[i + 1], other.bins_);
  }
  if (i < primitives.size()) add(primitives[i], bins_);
  for (int b = 0; b < count_; ++b) {
    bins_[b].faces[axis] = Min(bins_[b].faces[axis], other.bins_[b].faces[axis]);
    bins_[b].count[axis] += other.bins_[b].count[axis];
  }
}

void SahBins::Merge(const SahBins& other) {
  for (int i = 0; i < count_; ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      bins_[i].faces[axis] = Min(bins_[i].faces[axis], other.bins_[i].faces[axis]);
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
    BuildBox right;
    uint32_t count = 0;
    for (int b = mapping.count() - 1; b > 0; --b) {
      right.Extend(bins.bin(b).box(axis));
      count += bins.bin(b).count[axis];
      right_count[b] = count;
      right_cost[b] = right.HalfArea(cost.area_scale) * cost.Subtree(count);
    }
    BuildBox left;
    count = 0;
    for (int b = 1; b < mapping.count(); ++b) {
      left.Extend(bins.bin(b - 1).box(axis));
      count += bins.bin(b - 1).count[axis];
      // Infinite or NaN while a side is empty.
      const float c = left.HalfArea(cost.area_scale) * cost.Subtree(count) + right_cost[b];
      if (c < best.cost && count != 0 && right_count[b] != 0) {
        best.axis = axis;
        best.bin = b;
        best.cost = c;
        best.left_count = count;
      }
    }
  }
  if (best.axis < 0) return best;
  for (int b = 0; b < mapping.count(); ++b) {
    (b < best.bin ? best.left : best.right).Extend(bins.bin(b).box(best.axis));
  }
  return best;
}

}  // namespace sightline::bvh_build
