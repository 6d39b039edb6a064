// SPDX-License-Identifier: Apache-2.0
//
// HitDistance keeps what distance culling relies on, and is near the truth.
#include "core/intersect/hit.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <iostream>

#include "core/geometry/box3.h"
#include "core/geometry/box_ray.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/triangle_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::MoveByUlps;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::TriangleCase;
using testing_support::TriangleCases;

Box3f BoxOf(const TriangleCase& c) {
  Box3f box;
  box.Extend(c.a);
  box.Extend(c.b);
  box.Extend(c.c);
  return box;
}

// Calls check(case) for `count` cases that block.
template <typename Check>
void ForEachBlocking(int64_t count, const Check& check) {
  TestRng rng;
  TriangleCases cases(rng);
  while (count > 0) {
    const TriangleCase c = cases.Next();
    if (!Blocks(c.ray, c.a, c.b, c.c)) continue;
    --count;
    ASSERT_NO_FATAL_FAILURE(check(c, rng));
  }
}

TEST(HitTest, DistanceIsNotBelowTheEntryOfItsOwnBoxNorOfAnyBoxAroundIt) {
  ForEachBlocking(ScaledCount(100'000), [](const TriangleCase& c, TestRng& rng) {
    const float t = HitDistance(c.ray, c.a, c.b, c.c);
    ASSERT_GE(t, 0) << c;
    ASSERT_FALSE(std::signbit(t)) << c << ": a distance of -0";
    const BoxRay ray = BoxRay::Make(c.ray.origin, c.ray.RoundedDirection());
    Box3f box = BoxOf(c);
    float entry = BoxEntry(ray, box), exit = BoxExit(ray, box);
    ASSERT_GE(t, entry) << c;
    ASSERT_TRUE(MayMeetBox(ray, box)) << c << ": the slab test misses a hit";
    if (c.ray.segment) {
      ASSERT_LE(entry, kSegmentEnd) << c;
    }
    for (int parent = 0; parent < 6; ++parent) {
      // Some faces move outward, by an ulp or by a lot.
      for (int k = 0; k < 3; ++k) {
        if (rng.Chance(0.5)) {
          box.lo[k] = rng.Chance(0.5)
                          ? MoveByUlps(box.lo[k], -1)
                          : std::min(box.lo[k], static_cast<float>(rng.Uniform(-10, 10)));
        }
        if (rng.Chance(0.5)) {
          box.hi[k] = rng.Chance(0.5)
                          ? MoveByUlps(box.hi[k], 1)
                          : std::max(box.hi[k], static_cast<float>(rng.Uniform(-10, 10)));
        }
        if (rng.Chance(0.1))
          box.lo[k] = std::min(box.lo[k], c.ray.origin[k]);  // A face on the ray's line.
        if (rng.Chance(0.1)) box.hi[k] = std::max(box.hi[k], c.ray.origin[k]);
      }
      const float parent_entry = BoxEntry(ray, box), parent_exit = BoxExit(ray, box);
      ASSERT_LE(parent_entry, entry) << c;
      ASSERT_GE(parent_exit, exit) << c;
      ASSERT_TRUE(MayMeetBox(ray, box)) << c;
      entry = parent_entry;
      exit = parent_exit;
    }
  });
}

// Found by the random cases: N·(A-O) underflows to a zero of the other sign than N·D.
TEST(HitTest, DistanceIsNeverMinusZero) {
  const PredicateRay ray = PredicateRay::Ray({0x1.12a772p-24f, 0x1p+40f, 0x1.10aa18p-125f},
                                             {-0x1.12a8p-136f, -0x1p-72f, 0x0p+0f});
  const Vec3f a{0x1p+40f, 0x1.a8a508p-122f, 0x1p+40f}, b{0x1p+40f, 0x1.1772ep-66f, -0x1p+40f},
      c{0x1.afbaa4p-31f, 0x1p+40f, 0x1.08a098p-96f};
  ASSERT_TRUE(Blocks(ray, a, b, c));
  EXPECT_FALSE(std::signbit(HitDistance(ray, a, b, c)));
}

// Found by the random cases: N, summed in doubles, is off by its last bits, and the crossing lies
// near the end.
TEST(HitTest, DistanceDoesNotPassTheEndWhereTheNormalIsInexact) {
  const PredicateRay ray =
      PredicateRay::Segment({-0x1.eca60ap-83f, -0x1.83e868p-44f, 0x1.5b9e7ap-86f},
                            {0x1.6896fcp-65f, -0x1.708f8ep-124f, -0x1.33d636p-46f});
  const Vec3f a{-0x1.5e44p+8f, -0x1.f03516p-3f, -0x1.41d274p-46f},
      b{0x1p+40f, 0x1.eaca16p+23f, -0x1p+40f},
      c{-0x1.4c8064p-101f, -0x1.72859ap-97f, 0x1.21e8fcp-119f};
  ASSERT_TRUE(Blocks(ray, a, b, c));
  EXPECT_LE(HitDistance(ray, a, b, c), kSegmentEnd);
}

// A blocked segment is blocked between its ends, whatever rounding makes of N·D.
TEST(HitTest, DistanceOnASegmentDoesNotExceedItsEnd) {
  ForEachBlocking(ScaledCount(300'000), [](const TriangleCase& c, TestRng&) {
    if (!c.ray.segment) return;
    ASSERT_LE(HitDistance(c.ray, c.a, c.b, c.c), kSegmentEnd) << c;
  });
}

TEST(HitTest, DistanceIsTheSameEveryTimeAndForTheSameCornersInAnyStorage) {
  ForEachBlocking(ScaledCount(20'000), [](const TriangleCase& c, TestRng&) {
    const float t = HitDistance(c.ray, c.a, c.b, c.c);
    const TriangleCase copy = c;
    ASSERT_EQ(std::bit_cast<uint32_t>(t),
              std::bit_cast<uint32_t>(HitDistance(copy.ray, copy.a, copy.b, copy.c)))
        << c;
  });
}

// Against 113-bit arithmetic, where the triangle and the crossing are well conditioned.
TEST(HitTest, DistanceIsWithinFourUlpsWhereTheCrossingIsWellConditioned) {
  TestRng rng;
  double worst = 0;
  for (int64_t i = ScaledCount(100'000), hits = 0; hits < i;) {
    const auto point = [&](double scale) {
      return ToFloat(Vec3d{rng.Uniform(-scale, scale), rng.Uniform(-scale, scale),
                           rng.Uniform(-scale, scale)});
    };
    const Vec3f base = rng.Chance(0.5) ? Vec3f{} : point(1e5);
    const Vec3f a = point(1) + base, b = point(1) + base, c = point(1) + base;
    const PredicateRay ray{point(3) + base, rng.Chance(0.5) ? point(3) + base : point(1),
                           rng.Chance(0.5)};
    const Vec3d n = Cross(ToDouble(b) - ToDouble(a), ToDouble(c) - ToDouble(a));
    const Vec3d d =
        ray.segment ? ToDouble(ray.target) - ToDouble(ray.origin) : ToDouble(ray.target);
    if (std::abs(Dot(n, d)) < 0.01 * Length(n) * Length(d) || !Blocks(ray, a, b, c)) continue;
    ++hits;
    using Quad = __float128;
    const auto det = [](Vec3d x, Vec3d y, Vec3d z) {
      return (Quad(x.y) * y.z - Quad(x.z) * y.y) * z.x + (Quad(x.z) * y.x - Quad(x.x) * y.z) * z.y +
             (Quad(x.x) * y.y - Quad(x.y) * y.x) * z.z;
    };
    const Vec3d e = ToDouble(b) - ToDouble(a), f = ToDouble(c) - ToDouble(a);
    const double truth =
        static_cast<double>(det(e, f, ToDouble(a) - ToDouble(ray.origin)) / det(e, f, d));
    const float t = HitDistance(ray, a, b, c);
    // Slab entries and exits carry the roundings that box_ray.h counts; the quotient itself carries
    // one.
    const double ulps = std::abs(t - truth) / (std::abs(truth) * 0x1p-23);
    worst = std::max(worst, ulps);
    ASSERT_LE(ulps, 4) << testing_support::Hex(a) << testing_support::Hex(b)
                       << testing_support::Hex(c);
  }
  std::cout << "largest error of a well-conditioned distance: " << worst << " ulps\n";
}

TEST(HitTest, BarycentricsLieWithinTheTriangle) {
  ForEachBlocking(ScaledCount(100'000), [](const TriangleCase& c, TestRng&) {
    float u = -1, v = -1;
    HitBarycentrics(c.ray, c.a, c.b, c.c, &u, &v);
    ASSERT_TRUE(u >= 0 && u <= 1 && v >= 0 && v <= 1) << c << ": " << u << ", " << v;
  });
  // By hand: at 1/4 of B and 1/2 of C.
  float u, v;
  HitBarycentrics(PredicateRay::Segment({1, 2, 1}, {1, 2, -1}), {0, 0, 0}, {4, 0, 0}, {0, 4, 0}, &u,
                  &v);
  EXPECT_EQ(u, 0.25f);
  EXPECT_EQ(v, 0.5f);
}

TEST(HitTest, HitsAreOrderedByDistanceThenId) {
  EXPECT_LT((Hit{1, 7}), (Hit{2, 3}));
  EXPECT_LT((Hit{1, 3}), (Hit{1, 7}));
  EXPECT_FALSE((Hit{1, 3}) < (Hit{1, 3}));
  EXPECT_LT((Hit{std::numeric_limits<float>::infinity(), 3}), Hit{}) << "a hit at +inf is one";
}

}  // namespace
}  // namespace sightline
