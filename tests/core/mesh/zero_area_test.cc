// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/zero_area.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::ScaledCount;
using testing_support::TestRng;

TEST(ZeroAreaTest, CoincidentCorners) {
  const Vec3f a{1, 2, 3}, b{4, 5, 7};
  EXPECT_TRUE(IsZeroArea(a, a, a));
  EXPECT_TRUE(IsZeroArea(a, a, b));
  EXPECT_TRUE(IsZeroArea(a, b, a));
  EXPECT_TRUE(IsZeroArea(b, a, a));
}

TEST(ZeroAreaTest, OneUlpOffALineIsNotZero) {
  const Vec3f a{1, 1, 1}, b{2, 2, 2}, c{3, 3, 3};
  EXPECT_TRUE(IsZeroArea(a, b, c));
  EXPECT_FALSE(IsZeroArea(a, b, {3, 3, std::nextafter(3.0f, 4.0f)}));
  EXPECT_FALSE(IsZeroArea(a, {std::nextafter(2.0f, 0.0f), 2, 2}, c));
}

// 2^40 and 2^-100 differ by more than a double holds: the edges are rounded, the answer is not.
TEST(ZeroAreaTest, CornersFarApartInSize) {
  const float huge = 0x1p40f, tiny = 0x1p-100f;
  EXPECT_FALSE(IsZeroArea({0, 0, 0}, {huge, huge, 0}, {tiny, 0, 0}));
  EXPECT_TRUE(IsZeroArea({0, 0, 0}, {huge, huge, 0}, {tiny, tiny, 0}));
  EXPECT_FALSE(IsZeroArea({huge, huge, 0}, {-huge, -huge, 0}, {0, tiny, 0}));
  EXPECT_TRUE(IsZeroArea({huge, huge, 0}, {-huge, -huge, 0}, {tiny, tiny, 0}));
}

TEST(ZeroAreaTest, Denormals) {
  const float d = std::numeric_limits<float>::denorm_min();
  EXPECT_FALSE(IsZeroArea({0, 0, 0}, {d, 0, 0}, {0, d, 0}));
  EXPECT_TRUE(IsZeroArea({0, 0, 0}, {d, 0, 0}, {2 * d, 0, 0}));
}

// Corners a, a + p·d, a + q·d in small integers lie on a line exactly; moved by one unit off it
// they do not, unless the move is along it. Scaled by powers of two, up to the coordinate limit and
// far down.
TEST(ZeroAreaTest, RandomIntegerLines) {
  TestRng rng;
  for (int64_t i = 0, n = ScaledCount(200'000); i < n; ++i) {
    int64_t a[3], d[3], c[3];
    const int64_t p = static_cast<int64_t>(rng.Below(2001)) - 1000;
    const int64_t q = static_cast<int64_t>(rng.Below(2001)) - 1000;
    const int move = static_cast<int>(rng.Below(4));  // 3: none.
    const float scale = std::ldexp(1.0f, static_cast<int>(rng.Below(100)) - 80);
    Vec3f corner[3];
    for (int axis = 0; axis < 3; ++axis) {
      a[axis] = static_cast<int64_t>(rng.Below(20001)) - 10000;
      d[axis] = static_cast<int64_t>(rng.Below(2001)) - 1000;
      c[axis] = a[axis] + q * d[axis] + (axis == move ? 1 : 0);
      corner[0][axis] = static_cast<float>(a[axis]) * scale;
      corner[1][axis] = static_cast<float>(a[axis] + p * d[axis]) * scale;
      corner[2][axis] = static_cast<float>(c[axis]) * scale;
    }
    bool zero = true;
    for (int k = 0; k < 3; ++k) {
      const int s = (k + 1) % 3, t = (k + 2) % 3;
      zero = zero && p * d[s] * (c[t] - a[t]) == p * d[t] * (c[s] - a[s]);
    }
    ASSERT_EQ(IsZeroArea(corner[0], corner[1], corner[2]), zero) << "case " << i;
  }
}

// Whichever corners are no numbers.
TEST(ZeroAreaTest, NothingIsSureOfCornersThatAreNoNumbers) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  for (int bad = 0; bad < 8; ++bad) {
    Vec3f v[3] = {{0, 0, 0}, {1, 2, 4}, {3, 5, 9}};
    for (int k = 0; k < 3; ++k) {
      if ((bad >> k & 1) != 0) v[k] = {kNan, kNan, kNan};
    }
    EXPECT_EQ(SurelyHasArea(LoadVertex(v[0]), LoadVertex(v[1]), LoadVertex(v[2])), bad == 0);
  }
}

}  // namespace
}  // namespace sightline
