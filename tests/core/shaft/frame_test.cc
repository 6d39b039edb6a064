// SPDX-License-Identifier: Apache-2.0
//
// A shaft's frame is orthonormal as far as its floats allow, however `sideways` lies to the axis.
#include "core/shaft/frame.h"

#include <cmath>

#include "gtest/gtest.h"
#include "tests/core/shaft/margin_fixture.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr double kOrthonormal = 0x1p-22;  // ShaftFrame's.

void ExpectOrthonormal(const ShaftFrame& frame) {
  const Vec3q axes[3] = {ToQuad(frame.u), ToQuad(frame.v), ToQuad(frame.w)};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j <= i; ++j) {
      EXPECT_LE(std::abs(static_cast<double>(DotQ(axes[i], axes[j])) - (i == j ? 1 : 0)),
                kOrthonormal)
          << "axes " << i << " and " << j;
    }
  }
}

Vec3d AnyDirection(TestRng& rng) {
  return {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
}

// From across the axis to all but along it, past the share at which the frame is made in another
// way, and at any scale.
TEST(FrameTest, IsOrthonormal) {
  TestRng rng;
  for (int64_t i = ScaledCount(200'000); i > 0; --i) {
    const Vec3d axis = AnyDirection(rng) * std::ldexp(1.0, static_cast<int>(rng.Below(80)) - 40);
    const Vec3d along = axis * rng.Uniform(-1, 1);
    const double off = Length(along) * std::ldexp(1.0, -static_cast<int>(rng.Below(60)));
    const Vec3d sideways =
        (along + AnyDirection(rng) * off) * std::ldexp(1.0, static_cast<int>(rng.Below(80)) - 40);
    ShaftFrame frame;
    ASSERT_TRUE(MakeShaftFrame(axis, sideways, &frame));
    ExpectOrthonormal(frame);
    if (HasFailure()) FAIL() << "axis " << axis.x << ", " << axis.y << ", " << axis.z;
  }
}

TEST(FrameTest, NeedsNoSideways) {
  const Vec3d axes[] = {{1, 0, 0}, {0, -2, 0}, {0, 0, 3}, {1, 1, 1}, {1e-30, 0, 1e30}};
  for (const Vec3d axis : axes) {
    for (const Vec3d sideways : {Vec3d{}, axis, axis * -7.0}) {
      ShaftFrame frame;
      ASSERT_TRUE(MakeShaftFrame(axis, sideways, &frame));
      ExpectOrthonormal(frame);
    }
  }
}

TEST(FrameTest, NeedsAnAxis) {
  ShaftFrame frame;
  EXPECT_FALSE(MakeShaftFrame({}, {1, 0, 0}, &frame));
  EXPECT_FALSE(MakeShaftFrame({NAN, 0, 0}, {1, 0, 0}, &frame));
  EXPECT_FALSE(MakeShaftFrame({INFINITY, 0, 0}, {1, 0, 0}, &frame));
}

}  // namespace
}  // namespace sightline::testing_support
