// SPDX-License-Identifier: Apache-2.0
#include "client/import/mesh_checks.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "client/import/position_table.h"
#include "core/base/mix_bits.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(HasZeroAreaTest, FindsTrianglesThatWereFlatBeforeTheirDecimalsWereRounded) {
  // Points on a line by construction, with each coordinate off by at most half an ulp, as reading
  // decimals leaves it: the stated bound must cover them all.
  testing_support::TestRng rng;
  for (int i = 0; i < 100000; ++i) {
    const double scale = std::exp2(rng.Uniform(-20, 20));
    const Vec3d origin{rng.Uniform(-scale, scale), rng.Uniform(-scale, scale),
                       rng.Uniform(-scale, scale)};
    const double size = scale * std::exp2(rng.Uniform(-20, 0));
    const Vec3d along{rng.Uniform(-size, size), rng.Uniform(-size, size), rng.Uniform(-size, size)};
    const auto at = [&](double t) {  // In extended precision, then rounded once.
      const auto axis = [t](double o, double d) {
        return static_cast<double>(static_cast<long double>(o) +
                                   static_cast<long double>(t) * static_cast<long double>(d));
      };
      return Vec3d{axis(origin.x, along.x), axis(origin.y, along.y), axis(origin.z, along.z)};
    };
    ASSERT_TRUE(
        HasZeroArea(at(rng.Uniform(-1, 1)), at(rng.Uniform(-1, 1)), at(rng.Uniform(-1, 1))));
  }
}

TEST(HasZeroAreaTest, LeavesSliversAlone) {
  EXPECT_FALSE(HasZeroArea({0, 0, 0}, {1, 0, 0}, {0.5, 1e-12, 0}));
  EXPECT_FALSE(HasZeroArea({1e6, 0, 0}, {1e6 + 1, 0, 0}, {1e6, 1e-6, 0}));
  EXPECT_TRUE(HasZeroArea({1, 2, 3}, {1, 2, 3}, {4, 5, 6}));
  EXPECT_FALSE(HasZeroArea({kNaN, 0, 0}, {1, 0, 0}, {0, 1, 0}));
  EXPECT_FALSE(HasZeroArea({1e200, 0, 0}, {0, 1e200, 0}, {0, 0, 1e200}));  // Overflows.
}

TEST(CountDefectsTest, CountsEachKind) {
  ObjectInput object;
  object.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {2, 0, 0}, {kNaN, kNaN, kNaN}, {-0.0, 0, 0}};
  object.indices = {0, 1, 2,   // Good.
                    2, 5, 1,   // The same, turned, with -0.
                    0, 1, 3,   // Flat.
                    0, 0, 1,   // Degenerate, therefore flat.
                    0, 5, 1,   // Degenerate by position; a copy of the one before.
                    0, 1, 4};  // Not finite.
  ObjectInput moved;
  moved.vertices = {{10, 0, 0}, {11, 0, 0}, {10, 1, 0}};
  moved.indices = {0, 1, 2};
  moved.transform.m[3] = -10;  // Onto the first triangle.
  ImportReport report;
  ASSERT_TRUE(CountDefects(std::vector<ObjectInput>{object, moved}, &report).ok());
  EXPECT_EQ(report.triangles, 7u);
  EXPECT_EQ(report.non_finite_triangles, 1u);
  EXPECT_EQ(report.degenerate_triangles, 2u);
  EXPECT_EQ(report.zero_area_triangles, 3u);
  EXPECT_EQ(report.duplicate_triangles, 3u);
}

// More triangles than are sorted at once, half of which share a corner.
TEST(CountDefectsTest, FindsTheCopiesAmongMany) {
  constexpr uint32_t kVertices = 1000, kTriangles = 400'000;
  ObjectInput object;
  for (uint32_t i = 0; i < kVertices; ++i) {
    object.vertices.push_back({i * 1.0, i * i * 1.0, i % 7 * 1.0});
  }
  std::vector<std::array<uint32_t, 3>> triples;
  for (uint32_t i = 0; i < kTriangles; ++i) {
    const uint32_t a = i % 2 == 0 ? 0 : i / 2 % (kVertices - 2);
    triples.push_back({a, a + 1 + i % 3, a + 5 + i % 11});
    for (uint32_t& corner : triples.back()) corner = std::min(corner, kVertices - 1);
    object.indices.insert(object.indices.end(), triples.back().rbegin(), triples.back().rend());
  }
  std::sort(triples.begin(), triples.end());
  const auto distinct = std::unique(triples.begin(), triples.end()) - triples.begin();
  ImportReport report;
  CancelToken cancel;
  ASSERT_TRUE(CountDefects(std::vector<ObjectInput>{object}, &report, &cancel).ok());
  EXPECT_EQ(report.duplicate_triangles, kTriangles - static_cast<uint64_t>(distinct));
  cancel.Cancel();
  EXPECT_EQ(CountDefects(std::vector<ObjectInput>{object}, &report, &cancel).code(),
            absl::StatusCode::kCancelled);
}

TEST(PositionTableTest, NumbersDistinctPositionsInOrder) {
  PositionTable table;
  for (int round = 0; round < 2; ++round) {
    for (uint32_t i = 0; i < 5000; ++i) {
      ASSERT_EQ(table.Insert({static_cast<double>(i % 71), static_cast<double>(i), -0.0}), i);
    }
  }
  EXPECT_EQ(table.Insert({0, 0, 0}), 0u);
  EXPECT_EQ(table.Insert({kNaN, kNaN, kNaN}), 5000u);
  EXPECT_EQ(table.Insert({kNaN, kNaN, kNaN}), 5000u);
  EXPECT_EQ(table.positions().size(), 5001u);
}

// Finite positions that all hash to 0 under this salt: z undoes what x and y have come to.
std::vector<Vec3d> CollidingPositions(uint64_t salt, size_t count) {
  std::vector<Vec3d> positions;
  for (double i = 1; positions.size() < count; ++i) {
    const auto bits = [](double d) { return std::bit_cast<uint64_t>(d); };
    const Vec3d p{i, 0.5, std::bit_cast<double>(-MixBits(MixBits(bits(i) + salt) + bits(0.5)))};
    if (IsFinite(p)) positions.push_back(p);
  }
  return positions;
}

TEST(PositionTableTest, PositionsCollideUnderASaltThatIsKnownAlone) {
  constexpr uint64_t kSalt = 12345, kCount = 4000;
  const std::vector<Vec3d> made_for_none = CollidingPositions(0, kCount);
  const std::vector<Vec3d> made_for_one = CollidingPositions(kSalt, kCount);
  const auto longest_probe = [](PositionTable table, const std::vector<Vec3d>& positions) {
    for (uint32_t round = 0; round < 2; ++round) {
      for (uint32_t i = 0; i < positions.size(); ++i) EXPECT_EQ(table.Insert(positions[i]), i);
    }
    return table.LongestProbe();
  };
  EXPECT_EQ(longest_probe(PositionTable(0), made_for_none), kCount);
  EXPECT_EQ(longest_probe(PositionTable(kSalt), made_for_one), kCount);
  // Half full at most, so chance makes runs of some tens: longer ones by e^-0.19 for each slot.
  constexpr uint64_t kByChance = 200;
  EXPECT_LT(longest_probe(PositionTable(kSalt), made_for_none), kByChance);
  EXPECT_LT(longest_probe(PositionTable(), made_for_none), kByChance);
  EXPECT_LT(longest_probe(PositionTable(), made_for_one), kByChance);
}

}  // namespace
}  // namespace sightline
