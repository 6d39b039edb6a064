// SPDX-License-Identifier: Apache-2.0
//
// Blocks == BlocksExactly == CGAL's exact kernel, and the properties that predicate.h promises.
#include "core/intersect/predicate.h"

#include <algorithm>
#include <cstdint>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/core/intersect/cgal_reference.h"
#include "tests/core/intersect/triangle_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::CgalBlocks;
using testing_support::CgalSideOfDirection;
using testing_support::CgalSideOfPlane;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::TriangleCase;
using testing_support::TriangleCases;

TEST(PredicateTest, AgreesWithCgalOnRandomNearDegenerateAndDegenerateInput) {
  TestRng rng;
  TriangleCases cases(rng);
  struct Tally {
    int64_t cases = 0, blocked = 0, exact = 0;
  };
  std::map<std::string, Tally> tallies;
  for (int64_t i = ScaledCount(400'000); i > 0; --i) {
    const TriangleCase c = cases.Next();
    PredicateStage stage;
    const bool blocks = Blocks(c.ray, c.a, c.b, c.c, &stage);
    ASSERT_EQ(blocks, BlocksExactly(c.ray, c.a, c.b, c.c)) << c;
    ASSERT_EQ(blocks, CgalBlocks(c.ray, c.a, c.b, c.c)) << c;
    Tally& tally = tallies[c.kind];
    ++tally.cases;
    tally.blocked += blocks;
    tally.exact += stage == PredicateStage::kExact;
  }
  std::cout << "kind: share blocked, share decided in expansions\n";
  for (const auto& [kind, tally] : tallies) {
    std::cout << "  " << kind << ": " << 100.0 * tally.blocked / tally.cases << " %, "
              << 100.0 * tally.exact / tally.cases << " %\n";
  }
  // The generator must reach what it is for.
  EXPECT_GT(tallies["through a vertex or an edge's middle exactly"].exact, 0);
  EXPECT_GT(tallies["through a vertex or an edge's middle exactly"].blocked, 0);
  EXPECT_GT(tallies["subnormal lattice"].blocked, 0);
  EXPECT_GT(tallies["at the bound"].blocked, 0);
  EXPECT_EQ(tallies["random"].exact, 0);
}

TEST(PredicateTest, SidesAgreeWithCgal) {
  TestRng rng;
  TriangleCases cases(rng);
  for (int64_t i = ScaledCount(100'000); i > 0; --i) {
    const TriangleCase c = cases.Next();
    ASSERT_EQ(SideOfPlane(c.a, c.b, c.c, c.ray.origin),
              CgalSideOfPlane(c.a, c.b, c.c, c.ray.origin))
        << c;
    ASSERT_EQ(SideOfDirection(c.a, c.b, c.c, c.ray.target),
              CgalSideOfDirection(c.a, c.b, c.c, c.ray.target))
        << c;
  }
}

TEST(PredicateTest, DoesNotDependOnTheOrderOfCornersNorOnTheSegmentsSense) {
  TestRng rng;
  TriangleCases cases(rng);
  for (int64_t i = ScaledCount(100'000); i > 0; --i) {
    const TriangleCase c = cases.Next();
    const bool blocks = Blocks(c.ray, c.a, c.b, c.c);
    ASSERT_EQ(blocks, Blocks(c.ray, c.b, c.c, c.a)) << c;
    ASSERT_EQ(blocks, Blocks(c.ray, c.c, c.a, c.b)) << c;
    ASSERT_EQ(blocks, Blocks(c.ray, c.b, c.a, c.c)) << c;
    ASSERT_EQ(blocks, Blocks(c.ray, c.a, c.c, c.b)) << c;
    ASSERT_EQ(blocks, Blocks(c.ray, c.c, c.b, c.a)) << c;
    if (c.ray.segment) {
      ASSERT_EQ(blocks, Blocks(PredicateRay::Segment(c.ray.target, c.ray.origin), c.a, c.b, c.c))
          << c;
    }
  }
}

TEST(PredicateTest, PowersOfTwoChangeNothing) {
  TestRng rng;
  TriangleCases cases(rng);
  for (int64_t i = ScaledCount(60'000); i > 0; --i) {
    const TriangleCase c = cases.Next();
    float least = 0x1p40f;  // Of the magnitudes that are not zero.
    for (const Vec3f& v : {c.a, c.b, c.c, c.ray.origin, c.ray.target}) {
      for (int k = 0; k < 3; ++k) {
        if (v[k] != 0) least = std::min(least, std::abs(v[k]));
      }
    }
    if (least < 0x1p-60f) continue;  // Would lose bits.
    const float s = 0x1p-60f;
    const PredicateRay ray{c.ray.origin * s, c.ray.target * s, c.ray.segment};
    ASSERT_EQ(Blocks(c.ray, c.a, c.b, c.c), Blocks(ray, c.a * s, c.b * s, c.c * s)) << c;
  }
}

// A segment through a shared edge or vertex of a fan meets at least one of its triangles: no leak.
TEST(PredicateTest, NothingSlipsBetweenTrianglesOfAFan) {
  TestRng rng;
  for (int64_t i = ScaledCount(40'000); i > 0; --i) {
    const int n = 3 + static_cast<int>(rng.Below(6));
    const double offset = rng.Chance(0.5) ? 0 : rng.Uniform(-1e6, 1e6);
    const Vec3f hub = ToFloat(
        Vec3d{rng.Uniform(-0.2, 0.2) + offset, rng.Uniform(-0.2, 0.2), rng.Uniform(-0.1, 0.1)});
    // Seen from above, the rim goes once around the hub, which sees all of it.
    std::vector<Vec3f> rim;
    for (int k = 0; k < n; ++k) {
      static constexpr double kCos[] = {1, 0.7071, 0, -0.7071, -1, -0.7071, 0, 0.7071};
      static constexpr double kSin[] = {0, 0.7071, 1, 0.7071, 0, -0.7071, -1, -0.7071};
      const int at = k * 8 / n;
      rim.push_back(ToFloat(Vec3d{kCos[at] * 5 + rng.Uniform(-1, 1) + offset,
                                  kSin[at] * 5 + rng.Uniform(-1, 1), rng.Uniform(-0.1, 0.1)}));
    }
    // Aimed at the hub, or at a point of a spoke.
    const Vec3f spoke = rim[rng.Below(n)];
    const double w = rng.Chance(0.5) ? 0 : rng.Uniform(0, 0.2);
    const Vec3d at = ToDouble(hub) * (1 - w) + ToDouble(spoke) * w;
    const Vec3f origin =
        ToFloat(at + Vec3d{rng.Uniform(-0.2, 0.2), rng.Uniform(-0.2, 0.2), rng.Uniform(2, 3)});
    const Vec3f target = ToFloat(at * 2.0 - ToDouble(origin));
    const PredicateRay ray = rng.Chance(0.5) ? PredicateRay::Segment(origin, target)
                                             : PredicateRay::Ray(origin, target - origin);
    int met = 0;
    for (int k = 0; k < n; ++k) met += Blocks(ray, hub, rim[k], rim[(k + 1) % n]);
    ASSERT_GE(met, 1) << "hub " << testing_support::Hex(hub) << " origin "
                      << testing_support::Hex(origin) << " target " << testing_support::Hex(target);
  }
}

TEST(PredicateTest, TouchingAnEdgeOrAVertexBlocksAndLyingInThePlaneDoesNot) {
  const Vec3f a{0, 0, 0}, b{4, 0, 0}, c{0, 4, 0};
  const auto down = [](float x, float y) { return PredicateRay::Segment({x, y, 1}, {x, y, -1}); };
  EXPECT_TRUE(Blocks(down(1, 1), a, b, c));
  EXPECT_TRUE(Blocks(down(2, 0), a, b, c)) << "on edge AB";
  EXPECT_TRUE(Blocks(down(2, 2), a, b, c)) << "on edge BC";
  EXPECT_TRUE(Blocks(down(0, 0), a, b, c)) << "at A";
  EXPECT_TRUE(Blocks(down(4, 0), a, b, c)) << "at B";
  EXPECT_FALSE(Blocks(down(-0x1p-149f, 0), a, b, c)) << "the least float beside A";
  EXPECT_FALSE(Blocks(down(2, 0x1.000002p1f), a, b, c)) << "one ulp beyond BC";
  EXPECT_FALSE(Blocks(PredicateRay::Segment({-1, 1, 0}, {5, 1, 0}), a, b, c)) << "in the plane";
  EXPECT_FALSE(Blocks(PredicateRay::Segment({1, 1, 1}, {1, 1, 0}), a, b, c)) << "ends on it";
  EXPECT_FALSE(Blocks(PredicateRay::Segment({1, 1, 0}, {1, 1, -1}), a, b, c)) << "starts on it";
  EXPECT_TRUE(Blocks(PredicateRay::Segment({1, 1, 1}, {1, 1, -0x1p-149f}), a, b, c))
      << "just through it";
  EXPECT_FALSE(Blocks(PredicateRay::Segment({1, 1, 1}, {1, 1, 1}), a, b, c)) << "empty";
  EXPECT_TRUE(Blocks(PredicateRay::Ray({1, 1, 1}, {0, 0, -0x1p-149f}), a, b, c))
      << "the least direction";
  EXPECT_FALSE(Blocks(PredicateRay::Ray({1, 1, 1}, {0, 0, 1}), a, b, c)) << "away";
  EXPECT_FALSE(Blocks(PredicateRay::Ray({1, 1, 0}, {0, 0, 1}), a, b, c)) << "from it";
  EXPECT_FALSE(Blocks(PredicateRay::Ray({1, 1, 1}, {0, 0, 0}), a, b, c)) << "nowhere";
}

}  // namespace
}  // namespace sightline
