// SPDX-License-Identifier: Apache-2.0
#include "core/accel/kd_clip.h"

#include <algorithm>
#include <cmath>

#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::ScaledCount;
using testing_support::TestRng;

Vec3f Point(TestRng& rng, double size) {
  return ToFloat({rng.Uniform(-size, size), rng.Uniform(-size, size), rng.Uniform(-size, size)});
}

// Points of the triangle that lie in the box lie in the result: corners, and points between them
// found in doubles (whose own rounding is far below the padding).
TEST(KdClipTest, HoldsEveryPointOfTheTriangleInTheBox) {
  TestRng rng;
  int inside = 0;
  for (int64_t round = 0; round < ScaledCount(20'000); ++round) {
    const double size = std::ldexp(1.0, static_cast<int>(rng.Below(60)) - 20);
    const double extent =
        rng.Chance(0.5) ? size : size * 0x1p-12;  // Far from the origin, and small.
    const Vec3f base = Point(rng, size);
    std::array<Vec3f, 3> corners;
    for (Vec3f& corner : corners) corner = base + Point(rng, extent);
    if (rng.Chance(0.2)) corners[2] = corners[rng.Below(2)];  // A segment.
    Box3f box;
    box.Extend(base + Point(rng, extent));
    box.Extend(base + Point(rng, rng.Chance(0.2) ? 0 : extent));
    if (rng.Chance(0.2)) box.hi[2] = box.lo[2] = corners[0][2];  // Flat, through a corner.
    const Box3f clipped = ClipToBox(corners, box);
    if (!clipped.empty()) {
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_GE(clipped.lo[axis], box.lo[axis]);
        ASSERT_LE(clipped.hi[axis], box.hi[axis]);
      }
    }
    for (int k = 0; k < 40; ++k) {
      double u = rng.Uniform(0, 1), v = rng.Uniform(0, 1);
      if (u + v > 1) u = 1 - u, v = 1 - v;
      if (k < 3) u = k == 1, v = k == 2;
      const Vec3d a = ToDouble(corners[0]), b = ToDouble(corners[1]), c = ToDouble(corners[2]);
      const Vec3d p = a + u * (b - a) + v * (c - a);
      bool in_box = true, in_clipped = true;
      const double slack = 0x1p-50 * size;
      for (int axis = 0; axis < 3; ++axis) {
        in_box &= p[axis] >= box.lo[axis] && p[axis] <= box.hi[axis];
        in_clipped &= p[axis] >= clipped.lo[axis] - slack && p[axis] <= clipped.hi[axis] + slack;
      }
      if (!in_box) continue;
      ++inside;
      ASSERT_TRUE(in_clipped) << "round " << round << ": (" << p.x << ", " << p.y << ", " << p.z
                              << ")";
    }
  }
  EXPECT_GT(inside, 1000);
}

TEST(KdClipTest, CutsWhatABoxDoesNot) {
  const std::array<Vec3f, 3> corners = {Vec3f{0, 0, 0}, Vec3f{4, 4, 0}, Vec3f{4, 4, 1}};
  // The diagonal strip meets x in 1 .. 2 where y is, too.
  const Box3f clipped = ClipToBox(corners, {{1, 0, 0}, {2, 4, 1}});
  EXPECT_NEAR(clipped.lo.y, 1, 1e-6);
  EXPECT_NEAR(clipped.hi.y, 2, 1e-6);
  EXPECT_LE(clipped.lo.y, 1);
  EXPECT_GE(clipped.hi.y, 2);
  EXPECT_TRUE(ClipToBox(corners, {{0, 3, 0}, {1, 4, 1}}).empty());
}

// What a builder keeps, cut by cut, is what a check of the whole cell asks for.
TEST(KdClipTest, WhatWasKeptPassesTheChecksOfItsCell) {
  TestRng rng;
  int kept = 0, dropped = 0;
  for (int64_t round = 0; round < ScaledCount(20'000); ++round) {
    const double size = std::ldexp(1.0, static_cast<int>(rng.Below(60)) - 20);
    const double extent = rng.Chance(0.5) ? size : size * 0x1p-18;
    const Vec3f base = Point(rng, size);
    std::array<Vec3f, 3> corners;
    for (Vec3f& corner : corners) corner = base + Point(rng, extent);
    if (rng.Chance(0.3)) corners[2] = corners[0] + Point(rng, extent * 0x1p-16);  // A needle.
    Box3f whole;
    for (const Vec3f& corner : corners) whole.Extend(corner);
    Box3f cell = whole, part = whole;  // Cut to the cell alone, and clipped on the way.
    for (int cut = 0; cut < 12 && !part.empty(); ++cut) {
      const int axis = static_cast<int>(rng.Below(3));
      float at = cell.lo[axis] + static_cast<float>(rng.Uniform(0, 1)) * cell.Extent()[axis];
      if (rng.Chance(0.2)) at = corners[rng.Below(3)][axis];
      if (rng.Chance(0.4)) at = rng.Chance(0.5) ? part.hi[axis] : part.lo[axis];
      if (!(at > cell.lo[axis] && at < cell.hi[axis])) continue;
      const bool below = rng.Chance(0.5);
      if (part.hi[axis] <= at || part.lo[axis] >= at) {
        // All on one side (kd_cell.h); a cut that takes empty space off alone may be forgotten.
        const bool stays = part.hi[axis] <= at ? below : !below;
        if (!stays) part = Box3f();
        if (stays && rng.Chance(0.5)) continue;
      } else {
        (below ? part.hi : part.lo)[axis] = at;
        part = ClipToBox(corners, part);
      }
      (below ? cell.hi : cell.lo)[axis] = at;
    }
    if (part.empty()) {
      ++dropped;
      EXPECT_TRUE(ClipMisses(corners, cell)) << "round " << round;
    } else {
      ++kept;
      EXPECT_TRUE(ClipHolds(corners, cell, part)) << "round " << round;
    }
  }
  EXPECT_GT(kept, 100);
  EXPECT_GT(dropped, 100);
}

// A box that is one float too small is noticed, wherever that is.
TEST(KdClipTest, ChecksMissNoFloat) {
  TestRng rng;
  for (int64_t round = 0; round < ScaledCount(5'000); ++round) {
    std::array<Vec3f, 3> corners;
    for (Vec3f& corner : corners) corner = Point(rng, 8);
    if (rng.Chance(0.5)) corners[0][rng.Below(3)] = 0;
    Box3f box;
    for (const Vec3f& corner : corners) box.Extend(corner);
    EXPECT_FALSE(ClipMisses(corners, box));
    EXPECT_TRUE(ClipHolds(corners, box, box));
    const int axis = static_cast<int>(rng.Below(3));
    Box3f small = box;
    if (rng.Chance(0.5)) {
      small.lo[axis] = std::nextafter(box.lo[axis], box.hi[axis]);
    } else {
      small.hi[axis] = std::nextafter(box.hi[axis], box.lo[axis]);
    }
    EXPECT_FALSE(ClipHolds(corners, box, small)) << "round " << round;
    // The corner alone.
    Box3f corner;
    corner.Extend(corners[rng.Below(3)]);
    EXPECT_FALSE(ClipMisses(corners, corner));
  }
}

}  // namespace
}  // namespace sightline
