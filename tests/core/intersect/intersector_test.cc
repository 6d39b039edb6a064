// SPDX-License-Identifier: Apache-2.0
#include "core/intersect/intersector.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iostream>
#include <limits>
#include <vector>

#include "core/intersect/predicate.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/same_bits.h"
#include "tests/core/intersect/triangle_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::MoveByUlps;
using testing_support::SameBits;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::TriangleCase;
using testing_support::TriangleCases;

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr size_t kCount = 37;  // No multiple of a register.
constexpr size_t kRoom = 64;

struct HitRows {
  float t[kRoom], u[kRoom], v[kRoom];
  uint8_t hit[kRoom];
  IntersectorHits hits() { return {t, u, v, hit}; }
  void Clear() {
    for (size_t i = 0; i < kRoom; ++i) t[i] = u[i] = v[i] = -7, hit[i] = 9;
  }
  // Element i against the answer for one ray and one triangle, and nothing beyond the count.
  void ExpectSame(size_t i, bool one_hit, const IntersectorHit& one) const {
    ASSERT_EQ(hit[i], one_hit ? 1 : 0);
    ASSERT_TRUE(SameBits(t[i], one_hit ? one.t : -7.0f)) << t[i] << " for " << one.t;
    ASSERT_TRUE(SameBits(u[i], one_hit ? one.u : -7.0f)) << u[i] << " for " << one.u;
    ASSERT_TRUE(SameBits(v[i], one_hit ? one.v : -7.0f)) << v[i] << " for " << one.v;
  }
};

void Jitter(Vec3f* v, TestRng& rng) {
  const int axis = static_cast<int>(rng.Below(3));
  (*v)[axis] = MoveByUlps((*v)[axis], static_cast<int>(rng.Below(9)) - 4);
}

float TMax(const TriangleCase& c, TestRng& rng) {
  return c.ray.segment ? 1.0f
                       : (rng.Chance(0.5) ? kInfinity : static_cast<float>(rng.Uniform(0, 4)));
}

TEST(IntersectorTest, RaysInLanesHaveOneRaysBits) {
  TestRng rng;
  TriangleCases cases(rng);
  int64_t hits_seen = 0;
  for (int64_t n = ScaledCount(6000); n > 0; --n) {
    const TriangleCase c = cases.Next();
    float rows[7][kRoom] = {};
    std::vector<std::pair<Vec3f, Vec3f>> rays;
    for (size_t i = 0; i < kCount; ++i) {
      Vec3f o = c.ray.origin, d = c.ray.RoundedDirection();
      if (i > 0) Jitter(rng.Chance(0.5) ? &o : &d, rng);
      rays.emplace_back(o, d);
      for (int k = 0; k < 3; ++k) rows[k][i] = o[k], rows[3 + k][i] = d[k];
      rows[6][i] = TMax(c, rng);
    }
    const IntersectorRays batch = {
        {rows[0], rows[1], rows[2]}, {rows[3], rows[4], rows[5]}, rows[6], kCount};
    for (const Intersector kind : kPaperIntersectors) {
      SCOPED_TRACE(IntersectorName(kind));
      const PreparedTriangle triangle = PrepareTriangle(kind, c.a, c.b, c.c);
      HitRows out;
      out.Clear();
      IntersectRays(kind, triangle, batch, out.hits());
      for (size_t i = 0; i < kCount; ++i) {
        IntersectorHit one;
        const bool hit = Intersect(kind, triangle, rays[i].first, rays[i].second, rows[6][i], &one);
        hits_seen += hit;
        ASSERT_NO_FATAL_FAILURE(out.ExpectSame(i, hit, one)) << c << ", ray " << i;
      }
      ASSERT_EQ(out.hit[kCount], 9) << "wrote beyond the count";
    }
  }
  EXPECT_GT(hits_seen, ScaledCount(6000));
}

TEST(IntersectorTest, TrianglesInLanesHaveOneTrianglesBits) {
  TestRng rng;
  TriangleCases cases(rng);
  int64_t hits_seen = 0;
  for (int64_t n = ScaledCount(4000); n > 0; --n) {
    const TriangleCase c = cases.Next();
    const Vec3f o = c.ray.origin, d = c.ray.RoundedDirection();
    const float t_max = TMax(c, rng);
    for (const Intersector kind : kPaperIntersectors) {
      SCOPED_TRACE(IntersectorName(kind));
      float rows[kPreparedFloats][kRoom] = {};
      std::vector<PreparedTriangle> prepared;
      for (size_t i = 0; i < kCount; ++i) {
        Vec3f corners[3] = {c.a, c.b, c.c};
        if (i > 2) Jitter(&corners[rng.Below(3)], rng);
        prepared.push_back(
            PrepareTriangle(kind, corners[i % 3], corners[(i + 1) % 3], corners[(i + 2) % 3]));
        for (int k = 0; k < kPreparedFloats; ++k) rows[k][i] = prepared[i].value[k];
      }
      PreparedTriangles batch = {{}, kCount};
      for (int k = 0; k < kPreparedFloats; ++k) batch.value[k] = rows[k];
      HitRows out;
      out.Clear();
      IntersectTriangles(kind, batch, o, d, t_max, out.hits());
      for (size_t i = 0; i < kCount; ++i) {
        IntersectorHit one;
        const bool hit = Intersect(kind, prepared[i], o, d, t_max, &one);
        hits_seen += hit;
        ASSERT_NO_FATAL_FAILURE(out.ExpectSame(i, hit, one)) << c << ", triangle " << i;
      }
      ASSERT_EQ(out.hit[kCount], 9) << "wrote beyond the count";
    }
  }
  EXPECT_GT(hits_seen, ScaledCount(4000));
}

// One ray and one triangle: in lanes both are the one test.
TEST(IntersectorTest, TheDotProductInstructionGivesTheSameBits) {
  TestRng rng;
  TriangleCases cases(rng);
  int64_t hits_seen = 0;
  for (int64_t n = ScaledCount(200'000); n > 0; --n) {
    const TriangleCase c = cases.Next();
    const PreparedTriangle triangle = PrepareTriangle(Intersector::kHavelHerout, c.a, c.b, c.c);
    const PreparedTriangle same =
        PrepareTriangle(Intersector::kHavelHeroutDotProduct, c.a, c.b, c.c);
    for (int k = 0; k < kPreparedFloats; ++k) {
      ASSERT_TRUE(SameBits(triangle.value[k], same.value[k])) << c << ", row " << k;
    }
    const Vec3f o = c.ray.origin, d = c.ray.RoundedDirection();
    const float t_max = TMax(c, rng);
    IntersectorHit one, dotted;
    const bool hit = Intersect(Intersector::kHavelHerout, triangle, o, d, t_max, &one);
    ASSERT_EQ(Intersect(Intersector::kHavelHeroutDotProduct, same, o, d, t_max, &dotted), hit) << c;
    if (!hit) continue;
    ++hits_seen;
    ASSERT_TRUE(SameBits(one.t, dotted.t) && SameBits(one.u, dotted.u) && SameBits(one.v, dotted.v))
        << c;
  }
  EXPECT_GT(hits_seen, ScaledCount(20'000));
}

// What can be seen without any arithmetic: a unit triangle from both sides, and its weights.
TEST(IntersectorTest, HitsAUnitTriangleFromBothSidesWithTheRightWeights) {
  const Vec3f a{0, 0, 2}, b{1, 0, 2}, c{0, 1, 2};
  for (const Intersector kind : kPaperIntersectors) {
    SCOPED_TRACE(IntersectorName(kind));
    for (const bool turned : {false, true}) {
      const PreparedTriangle t =
          turned ? PrepareTriangle(kind, a, c, b) : PrepareTriangle(kind, a, b, c);
      IntersectorHit hit;
      ASSERT_TRUE(Intersect(kind, t, {0.25f, 0.5f, 0}, {0, 0, 1}, kInfinity, &hit));
      EXPECT_EQ(hit.t, 2);
      EXPECT_EQ(hit.u, turned ? 0.5f : 0.25f);
      EXPECT_EQ(hit.v, turned ? 0.25f : 0.5f);
      EXPECT_TRUE(Intersect(kind, t, {0.25f, 0.5f, 4}, {0, 0, -1}, 2, &hit));
      EXPECT_FALSE(Intersect(kind, t, {0.25f, 0.5f, 4}, {0, 0, -1}, 1.9f, &hit)) << "ends before";
      EXPECT_FALSE(Intersect(kind, t, {0.25f, 0.5f, 4}, {0, 0, 1}, kInfinity, &hit)) << "behind";
      EXPECT_FALSE(Intersect(kind, t, {0.75f, 0.5f, 0}, {0, 0, 1}, kInfinity, &hit)) << "beside";
      EXPECT_FALSE(Intersect(kind, t, {-0.25f, 0.5f, 0}, {0, 0, 1}, kInfinity, &hit)) << "beside";
      EXPECT_FALSE(Intersect(kind, t, {0.25f, 0.5f, 0}, {1, 0, 0}, kInfinity, &hit)) << "parallel";
      EXPECT_FALSE(Intersect(kind, t, {0.25f, 0.5f, 2}, {1, 0, 0}, kInfinity, &hit)) << "in plane";
    }
  }
}

TEST(IntersectorTest, TrianglesWithoutAreaAreMissed) {
  TestRng rng;
  for (const Intersector kind : kPaperIntersectors) {
    SCOPED_TRACE(IntersectorName(kind));
    for (int i = 0; i < 1000; ++i) {
      const auto integer = [&] { return static_cast<float>(rng.Below(9)) - 4; };
      const Vec3f a{integer(), integer(), integer()}, step{integer(), integer(), integer()};
      const PreparedTriangle t = PrepareTriangle(kind, a, a + step, a + step * 2.0f);
      const Vec3f o{integer(), integer(), integer()}, at = a + step * 0.5f;
      IntersectorHit hit;
      EXPECT_FALSE(Intersect(kind, t, o, at - o, kInfinity, &hit)) << "through its middle";
    }
  }
}

// Nearly in the plane, from in it and from a denormal below it: the determinant's reciprocal is
// +inf, and what is multiplied by it no number, or no distance. Scaled weights lie within the
// triangle.
TEST(IntersectorTest, DeterminantsWithoutAReciprocalMiss) {
  const Vec3f a{0, 0, 0}, b{1, 0, 0}, c{0, 1, 0}, direction{1, 0, 0x1p-140f};
  for (const float below : {0.0f, 0x1p-145f}) {
    const Vec3f origin{0.25f, 0.25f, -below};
    for (const Intersector kind : kPaperIntersectors) {
      SCOPED_TRACE(IntersectorName(kind));
      const PreparedTriangle t = PrepareTriangle(kind, a, b, c);
      for (const float t_max : {1.0f, kInfinity}) {
        IntersectorHit hit;
        EXPECT_FALSE(Intersect(kind, t, origin, direction, t_max, &hit))
            << hit.t << " " << hit.u << " " << hit.v;
        float rows[7][kRoom];
        const float values[] = {origin.x,    origin.y,    origin.z, direction.x,
                                direction.y, direction.z, t_max};
        for (int i = 0; i < 7; ++i) std::fill_n(rows[i], kRoom, values[i]);
        HitRows lanes;
        lanes.Clear();
        IntersectRays(kind, t,
                      {.origin = {rows[0], rows[1], rows[2]},
                       .direction = {rows[3], rows[4], rows[5]},
                       .t_max = rows[6],
                       .count = kCount},
                      lanes.hits());
        for (size_t i = 0; i < kCount; ++i) EXPECT_EQ(lanes.hit[i], 0);
      }
    }
  }
}

// Paper 003, section V A: the mean square relative error of the hits' coordinates is about 1e-8 for
// every test. Triangles and rays as its benchmark has them: corners in a unit box, rays from
// around it to points in it.
TEST(IntersectorTest, TheMeanSquareRelativeErrorIsNoWorseThanThePapers) {
  TestRng rng;
  const auto in_box = [&] {
    return Vec3f{static_cast<float>(rng.Uniform(0, 1)), static_cast<float>(rng.Uniform(0, 1)),
                 static_cast<float>(rng.Uniform(0, 1))};
  };
  for (const Intersector kind : kPaperIntersectors) {
    double sum = 0;
    int64_t hits = 0;
    for (int64_t n = ScaledCount(200'000); n > 0; --n) {
      const Vec3f a = in_box(), b = in_box(), c = in_box(), at = in_box();
      const Vec3f o{static_cast<float>(rng.Uniform(-2, 3)), static_cast<float>(rng.Uniform(-2, 3)),
                    -1.5f};
      const Vec3f d = at - o;
      IntersectorHit hit;
      if (!Intersect(kind, PrepareTriangle(kind, a, b, c), o, d, kInfinity, &hit)) continue;
      const Vec3d od = ToDouble(o), dd = ToDouble(d), ad = ToDouble(a);
      const Vec3d normal = Cross(ToDouble(b) - ad, ToDouble(c) - ad);
      const double t = Dot(normal, ad - od) / Dot(normal, dd);
      const Vec3d truth = od + dd * t, error = dd * (static_cast<double>(hit.t) - t);
      sum += Dot(error, error) / Dot(truth, truth);
      ++hits;
    }
    ASSERT_GT(hits, ScaledCount(2000));
    const double mean = sum / static_cast<double>(hits);
    std::cout << IntersectorName(kind) << ": mean square relative error " << mean << " over "
              << hits << " hits\n";
    EXPECT_LT(mean, 1e-8) << IntersectorName(kind);
    EXPECT_GT(mean, 1e-18) << IntersectorName(kind) << ": floats cannot be as good";
  }
}

TEST(IntersectorTest, NamesAreReadBackInAnyCase) {
  for (const Intersector kind : kPaperIntersectors) {
    const auto parsed = ParseIntersector(IntersectorName(kind));
    ASSERT_TRUE(parsed.ok());
    EXPECT_EQ(*parsed, kind);
  }
  EXPECT_EQ(*ParseIntersector("exact"), Intersector::kExact);
  EXPECT_EQ(*ParseIntersector("Wald"), Intersector::kWald);
  const auto unknown = ParseIntersector("BADOUEL");
  EXPECT_EQ(unknown.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(unknown.status().message().find("SHEVTSOV"), absl::string_view::npos);
}

}  // namespace
}  // namespace sightline
