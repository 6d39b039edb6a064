// SPDX-License-Identifier: Apache-2.0
//
// Points in rows, and results as bits, are what they were, for any number of points.
#include "core/query/point_rows.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/intersect/hit.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/support/random.h"

namespace sightline::testing_support {
namespace {

constexpr size_t kMost = 256;
struct Rows {
  alignas(64) float at[3][kMost];
};

TEST(PointRowsTest, SplitPointsAreThePointsBits) {
  TestRng rng;
  const auto rows = std::make_unique<Rows>();
  for (const SimdTarget target : AvailableTargets()) {
    for (size_t count = 0; count <= kMost; ++count) {
      std::vector<Vec3f> points(count);
      for (Vec3f& p : points) {
        for (int k = 0; k < 3; ++k) p[k] = std::bit_cast<float>(static_cast<uint32_t>(rng()));
      }
      constexpr float kUntouched = -7;
      for (auto& row : rows->at) std::fill(std::begin(row), std::end(row), kUntouched);
      PointRowKernelsFor(target).split(points, rows->at[0], rows->at[1], rows->at[2]);
      for (size_t i = 0; i < kMost; ++i) {
        for (int k = 0; k < 3; ++k) {
          ASSERT_EQ(std::bit_cast<uint32_t>(rows->at[k][i]),
                    std::bit_cast<uint32_t>(i < count ? points[i][k] : kUntouched))
              << "axis " << k << " of point " << i << " of " << count;
        }
      }
    }
  }
}

TEST(PointRowsTest, FreeIsWhatNoTriangleBlocks) {
  TestRng rng;
  alignas(64) uint32_t ids[64];
  for (const SimdTarget target : AvailableTargets()) {
    for (int i = 0; i < 1000; ++i) {
      const uint64_t free = rng();
      for (int bit = 0; bit < 64; ++bit) {
        const uint32_t kIds[] = {0, kNoTriangle - 1, static_cast<uint32_t>(rng.Below(1 << 20))};
        ids[bit] = (free >> bit & 1) != 0 ? kNoTriangle : kIds[rng.Below(3)];
      }
      ASSERT_EQ(PointRowKernelsFor(target).free_bits(ids), free);
    }
  }
}

}  // namespace
}  // namespace sightline::testing_support
