// SPDX-License-Identifier: Apache-2.0
//
// Bits go back to the points that they were found for, whatever the order, and however many points
// and rows there are.
#include "core/query/point_bits.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <numeric>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::TestRng;

bool Bit(const std::vector<uint8_t>& rows, size_t row_bytes, size_t row, size_t i) {
  return rows[row * row_bytes + i / 8] >> (i % 8) & 1;
}

// A random order of all points but about one in `one_missing_of` (0: none is missing).
std::vector<uint32_t> SomeOrder(size_t points, uint32_t one_missing_of, TestRng& rng) {
  std::vector<uint32_t> order(points);
  std::iota(order.begin(), order.end(), 0u);
  if (one_missing_of > 0) {
    std::erase_if(order, [&](uint32_t) { return rng.Below(one_missing_of) == 0; });
  }
  std::shuffle(order.begin(), order.end(), rng);
  return order;
}

TEST(PointBitsTest, EveryPointGetsItsOwn) {
  TestRng rng;
  for (const size_t points : {1, 7, 8, 9, 31, 32, 33, 63, 64, 65, 255, 1000, 4097}) {
    const size_t row_bytes = (points + 7) / 8;
    for (const uint32_t one_missing_of : {0u, 7u, 1u}) {
      const std::vector<uint32_t> order = SomeOrder(points, one_missing_of, rng);
      const PointBits bits(order, points);
      std::vector<uint32_t> ranks((points + 7) / 8 * 8, static_cast<uint32_t>(points));
      for (size_t k = 0; k < order.size(); ++k) ranks[order[k]] = static_cast<uint32_t>(k);
      const PointBits by_ranks = PointBits::ByRanks(ranks, points);
      for (size_t row_count = 0; row_count <= 9; ++row_count) {
        std::vector<uint8_t> rows(row_count * row_bytes, 0);
        for (size_t row = 0; row < row_count; ++row) {
          for (size_t k = 0; k < order.size(); ++k) {
            rows[row * row_bytes + k / 8] |= uint8_t(rng.Below(2) << (k % 8));
          }
        }
        std::vector<uint8_t> expected(rows.size(), 0);
        for (size_t row = 0; row < row_count; ++row) {
          for (size_t k = 0; k < order.size(); ++k) {
            const size_t p = order[k];
            expected[row * row_bytes + p / 8] |= uint8_t(Bit(rows, row_bytes, row, k) << (p % 8));
          }
        }
        std::vector<uint8_t> others = rows;
        bits.PutBack(rows);
        by_ranks.PutBack(others);
        EXPECT_EQ(others, rows);
        EXPECT_EQ(rows, expected) << points << " points, " << order.size() << " in the order, "
                                  << row_count << " rows";
      }
    }
  }
}

// Rows are many: a token that fires among them is heard.
TEST(PointBitsTest, LeavesOffWhenCancelled) {
  TestRng rng;
  constexpr size_t kPoints = 1'000'000, kRows = 9;
  const PointBits bits(SomeOrder(kPoints, 0, rng), kPoints);
  std::vector<uint8_t> rows(kRows * kPoints / 8, 0x55);
  CancelToken token;
  EXPECT_TRUE(bits.PutBack(rows, &token));
  token.Cancel();
  const std::vector<uint8_t> before = rows;
  EXPECT_FALSE(bits.PutBack(rows, &token));
  EXPECT_EQ(rows, before);
  CancelToken late;  // No machine has done all in that time.
  late.set_deadline(CancelToken::Clock::now() + std::chrono::microseconds(20));
  EXPECT_FALSE(bits.PutBack(rows, &late));
}

TEST(PointBitsTest, NoPointsHaveNoBits) {
  std::vector<uint8_t> rows;
  PointBits({}, 0).PutBack(rows);
  EXPECT_TRUE(rows.empty());
}

}  // namespace
}  // namespace sightline
