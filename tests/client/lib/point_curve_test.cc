// SPDX-License-Identifier: Apache-2.0
//
// The curve holds every point once, with all that belongs to it, and neighbours together.
#include "client/lib/point_curve.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline::client {
namespace {

using testing_support::TestRng;

TEST(PointCurveTest, CarriesAllThatBelongsToAPoint) {
  TestRng rng;
  constexpr uint32_t kPoints = 5000;
  std::vector<double> positions, normals;
  std::vector<uint32_t> objects, triangles;
  for (uint32_t i = 0; i < kPoints; ++i) {
    for (int k = 0; k < 3; ++k) {
      positions.push_back(1e6 + rng.Uniform(-1, 1));
      normals.push_back(rng.Uniform(-1, 1));
    }
    objects.push_back(i % 7);
    triangles.push_back(i);
  }
  positions[3 * 77] = std::numeric_limits<double>::quiet_NaN();
  positions[3 * 78 + 2] = std::numeric_limits<double>::infinity();
  const PointCurve curve({positions, objects, triangles, normals});
  const Points sent = curve.points();
  ASSERT_EQ(sent.positions.size(), positions.size());
  ASSERT_EQ(sent.normals.size(), normals.size());
  std::vector<int> seen(kPoints);
  for (uint32_t i = 0; i < kPoints; ++i) {
    const uint32_t at = curve.index(i);
    ++seen[at];
    EXPECT_EQ(sent.source_triangles[i], at);
    EXPECT_EQ(sent.source_objects[i], at % 7);
    for (uint32_t k = 0; k < 3; ++k) {
      if (!std::isnan(positions[3 * at + k])) {
        EXPECT_EQ(sent.positions[3 * i + k], positions[3 * at + k]);
      }
      EXPECT_EQ(sent.normals[3 * i + k], normals[3 * at + k]);
    }
  }
  for (const int times : seen) EXPECT_EQ(times, 1);
}

TEST(PointCurveTest, BringsNeighboursTogether) {
  TestRng rng;
  std::vector<double> positions(3 * 20'000);
  for (double& x : positions) x = rng.Uniform(-5, 5);
  const auto step = [](std::span<const double> p) {
    double sum = 0;
    for (size_t i = 3; i < p.size(); ++i) sum += std::abs(p[i] - p[i - 3]);
    return sum;
  };
  const PointCurve curve({.positions = positions});
  EXPECT_TRUE(curve.points().normals.empty());
  EXPECT_TRUE(curve.points().source_triangles.empty());
  EXPECT_LT(step(curve.points().positions), 0.1 * step(positions));
}

TEST(PointCurveTest, TakesFlatAndEmptySets) {
  const std::vector<double> same(30, 4.0);
  const PointCurve flat({.positions = same});
  for (uint32_t i = 0; i < 10; ++i) EXPECT_EQ(flat.index(i), i);
  const PointCurve none{Points{}};
  EXPECT_TRUE(none.points().positions.empty());
}

}  // namespace
}  // namespace sightline::client
