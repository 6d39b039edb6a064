// SPDX-License-Identifier: Apache-2.0
//
// The binned surface area heuristic: primitives are counted into bins by their centroid, and the
// cheapest plane between two bins is found. Private to core/accel.
//
// Every result is a minimum, a maximum or a sum of integers, so it does not depend on the order in
// which primitives or partial bins are added.
//
// Thread safety: plain values; a SahBins is filled by one thread and merged with others afterwards.
//
//   BinMapping mapping(centroid_box, 16, /*longest_axis_only=*/false);
//   SahBins bins(mapping.count());
//   bins.Add(primitives, mapping);
//   SahSplit split = FindSplit(bins, mapping, cost);
#ifndef SIGHTLINE_CORE_ACCEL_SAH_SPLIT_H_
#define SIGHTLINE_CORE_ACCEL_SAH_SPLIT_H_

#include <cstdint>
#include <span>

#include "core/accel/build_primitive.h"

namespace sightline::bvh_build {

inline constexpr int kMaxBins = 256;

// What a subtree is expected to cost, per unit of its surface: the same function for the split
// search and for the collapse into leaves and wide nodes. In units of testing one full leaf.
struct SahCost {
  int max_leaf_triangles = 16;
  float node_visit = 1.0f;  // One eight-wide box test.
  float area_scale = 1.0f;  // Applied to extents, so that no area over- or underflows.
  // Rounded up: multiplied and shifted it divides all that a leaf count need be exact for.
  uint64_t leaf_reciprocal = ((uint64_t{1} << 32) + static_cast<uint64_t>(max_leaf_triangles) - 1) /
                             static_cast<uint64_t>(max_leaf_triangles);

  // A leaf costs its visit whatever it holds, and then by the units of four triangles that it
  // loads. Three quarters: with node_visit = 1 the kitchen (1.44 M triangles) has 10.0 triangles in
  // a leaf, and a random line meets 6.0 nodes, 3.2 leaves and 10.2 units; with a half, node_visit =
  // 1/2: 6.8 in a leaf and 6.5, 3.3 and 6.2 for 1.4 times as many nodes; with 1: 11.3 in a
  // leaf, 6.0, 3.2, 10.9, and nodes less full.
  static constexpr float kLeafVisit = 0.75f;
  float Leaf(uint32_t n) const {
    const uint32_t units = (n + 3) / 4;
    return kLeafVisit + (1.0f - kLeafVisit) * 0.25f * static_cast<float>(units);
  }
  // An estimate for many triangles: as many full leaves as hold them. So a plane that fills its
  // leaves is cheaper than one that leaves them half empty.
  float Many(uint32_t n) const {
    const uint64_t last = uint64_t{n} + static_cast<uint64_t>(max_leaf_triangles) - 1;
    return static_cast<float>(static_cast<uint32_t>(last * leaf_reciprocal >> 32));
  }
  float Subtree(uint32_t n) const {
    return n <= static_cast<uint32_t>(max_leaf_triangles) ? Leaf(n) : Many(n);
  }
};

// Doubled centroids to bins 0 .. count - 1, per axis.
class BinMapping {
 public:
  BinMapping(const BuildBox& centroids, int count, bool longest_axis_only);

  int count() const { return count_; }
  // False for an axis along which the centroids do not differ (or differ by next to nothing, below
  // 2^-120).
  bool CanSplit(int axis) const { return scale_[axis] > 0; }
  bool CanSplit() const { return CanSplit(0) || CanSplit(1) || CanSplit(2); }

  Int4 BinsOf(const Primitive& p) const {
    const Int4 bin = __builtin_convertvector((LowHalf(p.centroid()) - base_) * scale_, Int4);
    const Int4 last = {count_ - 1, count_ - 1, count_ - 1, count_ - 1};
    return bin < last ? bin : last;
  }
  // The same operations for one axis: the same bin.
  int BinOf(const Primitive& p, int axis) const {
    const int bin = static_cast<int>((p.centroid(axis) - base_[axis]) * scale_[axis]);
    return bin < count_ - 1 ? bin : count_ - 1;
  }
  // A plane between bins: whether BinOf(p, axis) < bin, as lanes all set or all clear.
  // REQUIRES: bin < count().
  class Plane {
   public:
    Plane(const BinMapping& mapping, int axis, int bin)
        : base_(Broadcast8(mapping.base_[axis])),
          scale_(Broadcast8(mapping.scale_[axis])),
          bin_(Broadcast8(static_cast<int32_t>(bin))),
          axis_(axis) {}
    Int8 IsBelow(const Primitive& p) const {
      const Float8 c = Broadcast8(p.lo[axis_]) - Broadcast8(p.minus_hi[axis_]);
      return __builtin_convertvector((c - base_) * scale_, Int8) < bin_;
    }

   private:
    Float8 base_, scale_;
    Int8 bin_;
    int axis_;
  };

 private:
  Float4 base_;     // Last lane 0.
  Float4 scale_{};  // 0 where the axis cannot be split, and in the last lane.
  int count_;
};

// Bins of all three axes.
class SahBins {
 public:
  explicit SahBins(int count);

  void Add(std::span<const Primitive> primitives, const BinMapping& mapping);
  // The same for one axis alone, faster: FindSplit then looks at that axis alone.
  void AddAxis(std::span<const Primitive> primitives, const BinMapping& mapping, int axis);
  void Merge(const SahBins& other);

  struct alignas(128) Bin {  // Per axis. Trivial, so that unused bins cost nothing.
    Float8 faces[3];
    uint32_t count[3];
    BuildBox box(int axis) const { return {faces[axis]}; }
  };
  const Bin& bin(int i) const { return bins_[i]; }

 private:
  int count_;
  Bin bins_[kMaxBins];  // The first count_ are initialized.
};

// Primitives with BinOf(axis) < bin go left. axis -1: there is no plane with something on both
// sides.
struct SahSplit {
  int axis = -1;
  int bin = 0;
  float cost = 0;  // left area · Subtree(left count) + the same of the right.
  uint32_t left_count = 0;
  BuildBox left, right;
};

// The cheapest; of equal ones that of the lowest axis, then bin.
SahSplit FindSplit(const SahBins& bins, const BinMapping& mapping, const SahCost& cost);

}  // namespace sightline::bvh_build

#endif  // SIGHTLINE_CORE_ACCEL_SAH_SPLIT_H_
