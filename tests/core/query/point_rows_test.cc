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
      Box3f box;
      PointRowKernelsFor(target).split(points, rows->at[0], rows->at[1], rows->at[2], &box);
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

TEST(PointRowsTest, TheBoxIsThePoints) {
  TestRng rng;
  const std::vector<Vec3f> coming(kMost);
  const auto rows = std::make_unique<Rows>();
  for (const SimdTarget target : AvailableTargets()) {
    for (size_t count = 0; count <= kMost; ++count) {
      std::vector<Vec3f> points(count);
      Box3f truth;
      for (Vec3f& p : points) {
        for (int k = 0; k < 3; ++k) p[k] = static_cast<float>(rng.Uniform(-1, 1));
        truth.Extend(p);
      }
      Box3f split, alone = {{1, 2, 3}, {4, 5, 6}}, asking = alone;
      PointRowKernelsFor(target).split(points, rows->at[0], rows->at[1], rows->at[2], &split);
      PointRowKernelsFor(target).box(points, /*coming=*/nullptr, &alone);
      ASSERT_EQ(split, truth) << count << " points";
      PointRowKernelsFor(target).box(points, coming.data(), &asking);
      ASSERT_EQ(alone, truth) << count << " points";
      ASSERT_EQ(asking, truth) << count << " points";
    }
  }
}

TEST(PointRowsTest, FreeIsWhatNoTriangleBlocks) {
  TestRng rng;
  alignas(64) uint32_t ids[kMost];
  for (const SimdTarget target : AvailableTargets()) {
    for (size_t count = 0; count <= kMost; ++count) {
      for (uint32_t& id : ids) {
        const uint32_t kIds[] = {0, kNoTriangle - 1, kNoTriangle, kNoTriangle,
                                 static_cast<uint32_t>(rng.Below(1 << 20))};
        id = kIds[rng.Below(std::size(kIds))];
      }
      constexpr uint8_t kUntouched = 0x5A;
      uint8_t bits[kMost / 8 + 1];
      std::fill(std::begin(bits), std::end(bits), kUntouched);
      PointRowKernelsFor(target).free_bits({ids, count}, bits);
      const size_t bytes = (count + 7) / 8;
      for (size_t i = 0; i < 8 * bytes; ++i) {
        ASSERT_EQ(bits[i / 8] >> (i % 8) & 1, i < count && ids[i] == kNoTriangle)
            << "id " << i << " of " << count;
      }
      ASSERT_EQ(bits[bytes], kUntouched) << count << " ids";
    }
  }
}

TEST(PointRowsTest, ABitOfEachFlag) {
  TestRng rng;
  alignas(64) uint16_t flags[kMost];
  for (const SimdTarget target : AvailableTargets()) {
    for (size_t count = 0; count <= kMost; ++count) {
      for (uint16_t& flag : flags) flag = static_cast<uint16_t>(rng());
      constexpr uint16_t kUntouched = 0x5AA5;
      uint16_t bits[kMost / 16 + 1];
      std::fill(std::begin(bits), std::end(bits), kUntouched);
      const auto bit = static_cast<uint32_t>(rng.Below(16));
      size_t set = 0;
      for (size_t i = 0; i < count; ++i) set += flags[i] >> bit & 1;
      ASSERT_EQ(PointRowKernelsFor(target).flag_bits({flags, count}, bit, bits), set);
      const size_t words = (count + 15) / 16;
      for (size_t i = 0; i < 16 * words; ++i) {
        ASSERT_EQ(bits[i / 16] >> (i % 16) & 1, i < count ? flags[i] >> bit & 1 : 0)
            << "bit " << bit << " of flag " << i << " of " << count;
      }
      ASSERT_EQ(bits[words], kUntouched) << count << " flags";
    }
  }
}

TEST(PointRowsTest, IdsAreSetWhereBitsAre) {
  TestRng rng;
  alignas(64) uint32_t ids[kMost];
  for (const SimdTarget target : AvailableTargets()) {
    for (size_t words = 0; words <= kMost / 16; ++words) {
      std::fill(std::begin(ids), std::end(ids), kNoTriangle);
      uint16_t bits[kMost / 16];
      for (uint16_t& word : bits) word = static_cast<uint16_t>(rng());
      PointRowKernelsFor(target).set_where({bits, words}, 7, ids);
      for (size_t i = 0; i < kMost; ++i) {
        const bool set = i < 16 * words && (bits[i / 16] >> (i % 16) & 1) != 0;
        ASSERT_EQ(ids[i], set ? 7u : kNoTriangle) << "id " << i << ", " << words << " words";
      }
    }
  }
}

}  // namespace
}  // namespace sightline::testing_support
