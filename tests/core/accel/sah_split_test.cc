// SPDX-License-Identifier: Apache-2.0
#include "core/accel/sah_split.h"

#include <bit>
#include <cfenv>
#include <cmath>
#include <limits>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::bvh_build {
namespace {

Box3f Plain(const BuildBox& box) {
  return {{box.lo(0), box.lo(1), box.lo(2)}, {box.hi(0), box.hi(1), box.hi(2)}};
}

using testing_support::TestRng;

Primitive MakePrimitive(uint32_t id, Vec3f lo, Vec3f hi) {
  return Primitive(Float8{lo.x, lo.y, lo.z, 0, -hi.x, -hi.y, -hi.z, std::bit_cast<float>(id)});
}

std::vector<Primitive> RandomPrimitives(TestRng& rng, size_t n) {
  std::vector<Primitive> primitives;
  for (uint32_t i = 0; i < n; ++i) {
    Vec3f lo, hi;
    for (int axis = 0; axis < 3; ++axis) {
      lo[axis] = static_cast<float>(rng.Uniform(-1, 1));
      hi[axis] = lo[axis] + static_cast<float>(rng.Uniform(0, 0.2));
    }
    primitives.push_back(MakePrimitive(i, lo, hi));
  }
  return primitives;
}

BuildBox Centroids(const std::vector<Primitive>& primitives) {
  BuildBox box;
  for (const Primitive& p : primitives) box.Extend(p.centroid());
  return box;
}

// A product of denormals takes some processors as long as a hundred others, and the bits of an id
// are one.
__attribute__((noinline)) float AreaElsewhere(const BuildBox& box, float scale) {
  return box.HalfArea(scale);
}
TEST(BuildBoxTest, NoIdIsMultiplied) {
  volatile uint32_t id = 12345;
  volatile float scale = 1.0f;
  BuildBox box;
  box.Extend(MakePrimitive(id, {1, 2, 3}, {2, 4, 7}));
  ASSERT_EQ(std::feclearexcept(FE_ALL_EXCEPT), 0);
  volatile const float area = AreaElsewhere(box, scale);
  EXPECT_EQ(std::fetestexcept(FE_UNDERFLOW), 0);
  EXPECT_EQ(area, 1 * 2 + 2 * 4 + 4 * 1);
}

TEST(BinMappingTest, BinsAreMonotoneAndTheEndsAreInTheEndBins) {
  TestRng rng;
  for (int count : {2, 5, 16, 256}) {
    const std::vector<Primitive> primitives = RandomPrimitives(rng, 300);
    const BuildBox centroids = Centroids(primitives);
    const BinMapping mapping(centroids, count, false);
    for (const Primitive& p : primitives) {
      const Int4 bins = mapping.BinsOf(p);
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(bins[axis], mapping.BinOf(p, axis));
        EXPECT_TRUE(bins[axis] >= 0 && bins[axis] < count);
        const int bin = static_cast<int>(rng.Below(static_cast<uint64_t>(count)));
        const Int8 below = BinMapping::Plane(mapping, axis, bin).IsBelow(p);
        for (int lane = 0; lane < 8; ++lane) EXPECT_EQ(below[lane], bins[axis] < bin ? -1 : 0);
        if (p.centroid(axis) == centroids.lo(axis)) {
          EXPECT_EQ(bins[axis], 0);
        }
        if (p.centroid(axis) == centroids.hi(axis)) {
          EXPECT_EQ(bins[axis], count - 1);
        }
        if (p.centroid(axis) <= primitives[0].centroid(axis)) {
          EXPECT_LE(bins[axis], mapping.BinOf(primitives[0], axis));
        }
      }
    }
  }
}

TEST(BinMappingTest, AxesWithoutExtentCannotBeSplit) {
  std::vector<Primitive> primitives = {MakePrimitive(0, {1, 0, 2}, {1, 5, 2}),
                                       MakePrimitive(1, {1, 2, 1}, {1, 3, 3})};
  EXPECT_FALSE(BinMapping(Centroids(primitives), 16, false).CanSplit());
  primitives.push_back(MakePrimitive(2, {0, 0, 5}, {2, 5, 5}));
  const BinMapping mapping(Centroids(primitives), 16, false);
  EXPECT_TRUE(mapping.CanSplit(2) && !mapping.CanSplit(0) && !mapping.CanSplit(1));
  // So little extent that bins per extent would overflow.
  const float d = std::numeric_limits<float>::denorm_min();
  primitives = {MakePrimitive(0, {0, 0, 0}, {0, 0, 0}), MakePrimitive(1, {d, d, d}, {d, d, d})};
  EXPECT_FALSE(BinMapping(Centroids(primitives), 256, false).CanSplit());
}

TEST(BinMappingTest, LongestAxisOnly) {
  const std::vector<Primitive> primitives = {MakePrimitive(0, {0, 0, 0}, {1, 1, 1}),
                                             MakePrimitive(1, {1, 3, 2}, {2, 4, 3})};
  const BinMapping mapping(Centroids(primitives), 16, true);
  EXPECT_TRUE(!mapping.CanSplit(0) && mapping.CanSplit(1) && !mapping.CanSplit(2));
}

// Few and many: with one table and with two.
TEST(SahBinsTest, OneAxisAloneGivesItsBins) {
  TestRng rng;
  for (const size_t n : {1u, 2u, 63u, 64u, 65u, 500u}) {
    const std::vector<Primitive> primitives = RandomPrimitives(rng, n);
    const BinMapping mapping(Centroids(primitives), 8, false);
    SahBins all(8);
    all.Add(primitives, mapping);
    for (int axis = 0; axis < 3; ++axis) {
      SahBins one(8);
      one.AddAxis(primitives, mapping, axis);
      for (int b = 0; b < 8; ++b) {
        EXPECT_EQ(one.bin(b).count[axis], all.bin(b).count[axis]);
        EXPECT_EQ(Plain(one.bin(b).box(axis)), Plain(all.bin(b).box(axis)));
      }
    }
  }
}

// The split found is the cheapest of all planes between bins, each evaluated from scratch.
TEST(FindSplitTest, IsTheCheapestPlane) {
  TestRng rng;
  for (int i = 0; i < 200; ++i) {
    const std::vector<Primitive> primitives = RandomPrimitives(rng, 2 + rng.Below(100));
    const int count = static_cast<int>(2 + rng.Below(20));
    const BinMapping mapping(Centroids(primitives), count, false);
    // Filled in two parts, merged: as the parallel builder does.
    SahBins bins(count), rest(count);
    const std::span<const Primitive> all(primitives);
    const size_t cut = rng.Below(primitives.size());
    bins.Add(all.first(cut), mapping);
    rest.Add(all.subspan(cut), mapping);
    bins.Merge(rest);
    const SahCost cost;
    const SahSplit found = FindSplit(bins, mapping, cost);
    float best = std::numeric_limits<float>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      for (int plane = 1; plane < count; ++plane) {
        BuildBox box[2];
        uint32_t n[2] = {0, 0};
        for (const Primitive& p : primitives) {
          const int side = mapping.BinOf(p, axis) < plane ? 0 : 1;
          box[side].Extend(p);
          ++n[side];
        }
        if (n[0] == 0 || n[1] == 0) continue;
        const float c =
            box[0].HalfArea(1) * cost.Subtree(n[0]) + box[1].HalfArea(1) * cost.Subtree(n[1]);
        best = std::min(best, c);
        if (axis != found.axis || plane != found.bin) continue;
        EXPECT_EQ(c, found.cost);
        EXPECT_EQ(n[0], found.left_count);
        EXPECT_EQ(Plain(box[0]), Plain(found.left));
        EXPECT_EQ(Plain(box[1]), Plain(found.right));
      }
    }
    EXPECT_EQ(found.cost, best);
    EXPECT_GE(found.axis, 0);
  }
}

}  // namespace
}  // namespace sightline::bvh_build
