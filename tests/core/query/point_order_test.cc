// SPDX-License-Identifier: Apache-2.0
//
// Points are brought into an order and answered in their own places.
#include "core/query/point_order.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

#include "core/query/shadows.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

struct Points {
  std::vector<Vec3f> positions;
  std::vector<uint8_t> valid;
  std::vector<uint32_t> sources;
};

// Rows of a square, every tenth point invalid.
Points MakeRows(int side) {
  Points points;
  for (int i = 0; i < side * side; ++i) {
    const int column = i % side, row = i / side;
    points.positions.push_back({static_cast<float>(column) / static_cast<float>(side) - 0.5f,
                                static_cast<float>(row) / static_cast<float>(side) - 0.5f, 1.5f});
    points.valid.push_back(i % 10 != 3);
    points.sources.push_back(kNoTriangle);
  }
  return points;
}

std::vector<size_t> Shuffled(size_t n, TestRng& rng) {
  std::vector<size_t> order(n);
  std::iota(order.begin(), order.end(), size_t{0});
  for (size_t i = n; i > 1; --i) std::swap(order[i - 1], order[rng.Below(i)]);
  return order;
}

Points Permuted(const Points& points, const std::vector<size_t>& order) {
  Points out;
  for (size_t i : order) {
    out.positions.push_back(points.positions[i]);
    out.valid.push_back(points.valid[i]);
    out.sources.push_back(points.sources[i]);
  }
  return out;
}

TEST(PointOrderTest, OnlyScatteredPointsAreOrdered) {
  TestRng rng;
  const Points rows = MakeRows(64);
  EXPECT_FALSE(IsScattered(rows.positions, rows.valid));
  const Points mixed = Permuted(rows, Shuffled(rows.positions.size(), rng));
  EXPECT_TRUE(IsScattered(mixed.positions, mixed.valid));
  const std::vector<Vec3f> same(5000, Vec3f{1, 2, 3});
  EXPECT_FALSE(IsScattered(same, std::vector<uint8_t>(5000, 1)));
  EXPECT_FALSE(IsScattered(same, std::vector<uint8_t>(5000, 0)));
}

TEST(PointOrderTest, TheOrderHoldsEachValidPointOnceAndNeighboursTogether) {
  TestRng rng;
  const Points rows = MakeRows(64);
  const Points mixed = Permuted(rows, Shuffled(rows.positions.size(), rng));
  const std::vector<uint32_t> order = MortonOrder(mixed.positions, mixed.valid);
  std::vector<int> seen(mixed.positions.size());
  for (uint32_t i : order) ++seen[i];
  for (size_t i = 0; i < seen.size(); ++i) EXPECT_EQ(seen[i], mixed.valid[i] ? 1 : 0) << i;
  std::vector<Vec3f> walked;
  walked.reserve(order.size());
  for (uint32_t i : order) walked.push_back(mixed.positions[i]);
  EXPECT_FALSE(IsScattered(walked, std::vector<uint8_t>(walked.size(), 1)));
}

TEST(PointOrderTest, ShuffledPointsGetTheirOwnAnswers) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({0.1, 0.2, -3}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0.3, 0.1, -1}), 1, {}, &samples).ok());
  const std::vector<double> weights = {0.25, 3.5};
  const Points rows = MakeRows(64);
  const std::vector<size_t> order = Shuffled(rows.positions.size(), rng);
  const Points mixed = Permuted(rows, order);
  const ShadowOutputs outputs = {
      .bits = true, .counts = true, .weighted_sums = true, .blockers = true};
  for (const bool blockers : {false, true}) {
    ShadowOutputs asked = outputs;
    asked.blockers = blockers;
    ShadowResult in_rows, in_mixed;
    ASSERT_TRUE(ComputeShadows(scene, {rows.positions, rows.sources, rows.valid}, samples, weights,
                               {}, asked, {}, &in_rows)
                    .ok());
    ASSERT_TRUE(ComputeShadows(scene, {mixed.positions, mixed.sources, mixed.valid}, samples,
                               weights, {}, asked, {}, &in_mixed)
                    .ok());
    const size_t n = order.size(), row = (n + 7) / 8;
    size_t lit = 0;
    for (size_t i = 0; i < n; ++i) {
      const size_t p = order[i];
      EXPECT_EQ(in_mixed.lit_counts[i], in_rows.lit_counts[p]);
      EXPECT_EQ(in_mixed.weighted_sums[i], in_rows.weighted_sums[p]);
      for (size_t s = 0; s < samples.size(); ++s) {
        const int bit = in_mixed.lit_bits[s * row + i / 8] >> (i % 8) & 1;
        EXPECT_EQ(bit, in_rows.lit_bits[s * row + p / 8] >> (p % 8) & 1);
        lit += static_cast<size_t>(bit);
        if (blockers) {
          EXPECT_EQ(in_mixed.blocker[s * n + i], in_rows.blocker[s * n + p]);
          EXPECT_EQ(in_mixed.blocker_t[s * n + i], in_rows.blocker_t[s * n + p]);
        }
      }
    }
    EXPECT_GT(lit, n / 10);
    EXPECT_LT(lit, 2 * n - n / 10);
  }
}

}  // namespace
}  // namespace sightline
