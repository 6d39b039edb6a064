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

}  // namespace
}  // namespace sightline
