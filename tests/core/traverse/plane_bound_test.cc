// SPDX-License-Identifier: Apache-2.0
//
// How far a point's side of a triangle's plane may be off where its ray runs within the triangle's
// edges, against exact arithmetic.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/traverse/plane_bound_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include <cstddef>
#include <span>

#include "core/geometry/vec3.h"
#include "core/traverse/shaft_leaf-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// values[i] is N·(P-A) of points[i], sixteen of them; what is returned bounds how far they are off.
template <bool kParallel>
float PlaneValues(Vec3f a, Vec3f b, Vec3f c, Vec3f common, std::span<const Vec3f> points,
                  float* values) {
  const ShaftD d;
  using V3 = Vec3V<ShaftV>;
  const V3 va = Broadcast(d, a.x, a.y, a.z), vb = Broadcast(d, b.x, b.y, b.z),
           vc = Broadcast(d, c.x, c.y, c.z), o = Broadcast(d, common.x, common.y, common.z);
  const V3 oa = SubV(va, o), ob = SubV(vb, o), oc = SubV(vc, o);
  const V3 ab = SubV(vb, va), bc = SubV(vc, vb), ca = SubV(va, vc);
  const V3 normal = CrossV(ab, bc), normal_bound = CrossBound(d, ab, bc);
  const ShaftV turn = DotV(normal, kParallel ? o : oa);
  const ShaftV off = BoundAlong(d, normal_bound, kParallel ? o : MostV(oa, ob, oc));
  for (size_t i = 0; i < points.size(); ++i) {
    const V3 p = Broadcast(d, points[i].x, points[i].y, points[i].z);
    values[i] = hn::GetLane(DotV(normal, SubV(p, va)));
  }
  return hn::GetLane(PlaneBound(normal_bound, ab, ca, hn::Abs(turn), off));
}

float ValuesFromOrigin(Vec3f a, Vec3f b, Vec3f c, Vec3f common, std::span<const Vec3f> points,
                       float* values) {
  return PlaneValues<false>(a, b, c, common, points, values);
}
float ValuesAlongDirection(Vec3f a, Vec3f b, Vec3f c, Vec3f common, std::span<const Vec3f> points,
                           float* values) {
  return PlaneValues<true>(a, b, c, common, points, values);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>

#include "core/intersect/predicate.h"
#include "core/traverse/simd_target.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/triangle_cases.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AvailableTargets;
using testing_support::ClampToRange;
using testing_support::MoveByUlps;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::TriangleCase;
using testing_support::TriangleCases;

constexpr size_t kPoints = 16;

auto* ValuesFor(SimdTarget target, bool parallel) {
  if (target == SimdTarget::kAvx512) {
    return parallel ? &N_AVX3::ValuesAlongDirection : &N_AVX3::ValuesFromOrigin;
  }
  return parallel ? &N_AVX2::ValuesAlongDirection : &N_AVX2::ValuesFromOrigin;
}

// A point near the triangle or far from it, whose line to or along `common` meets it but for
// rounding.
Vec3f PointThrough(const TriangleCase& c, Vec3f common, bool parallel, TestRng& rng) {
  double u = rng.Uniform(0, 1), v = rng.Uniform(0, 1);
  if (rng.Chance(0.3)) u = static_cast<double>(rng.Below(2));
  if (rng.Chance(0.3)) v = static_cast<double>(rng.Below(2));
  if (u + v > 1) {
    u = 1 - u;
    v = 1 - v;
  }
  const Vec3d a = ToDouble(c.a), ab = ToDouble(c.b) - a, ac = ToDouble(c.c) - a;
  const Vec3d hit = a + ab * u + ac * v;
  const Vec3d along = parallel ? ToDouble(common) : hit - ToDouble(common);
  const double far = std::ldexp(rng.Uniform(-1, 1), -static_cast<int>(rng.Below(40)));
  Vec3f p = ToFloat(hit + along * (far * (1 + Length(ab) / (Length(along) + 1e-30))));
  for (int k = 0; k < 3; ++k) p[k] = MoveByUlps(p[k], static_cast<int>(rng.Below(3)) - 1);
  return ClampToRange(p);
}

// Whether a point's ray runs within the edges, or on them, of a triangle that faces as `turn` says.
bool RunsWithin(const TriangleCase& c, Vec3f common, bool parallel, int turn, Vec3f p) {
  const Vec3f corners[3] = {c.a, c.b, c.c};
  int sum = 0;
  for (int e = 0; e < 3; ++e) {
    const Vec3f from = corners[e], to = corners[(e + 1) % 3];
    const int side =
        turn * (parallel ? SideOfDirection(p, from, to, common) : SideOfPlane(common, from, to, p));
    if (side < 0) return false;
    sum += side;
  }
  return sum > 0;
}

void ExpectSidesBeyondBoundsAreExact(bool parallel) {
  for (const SimdTarget target : AvailableTargets()) {
    TestRng rng;
    TriangleCases cases(rng);
    int64_t within = 0, certain = 0, wrong = 0;
    double worst = 0;
    for (int64_t i = ScaledCount(60'000); i > 0; --i) {
      const TriangleCase c = cases.Next();
      const Vec3f common = parallel ? ClampToRange(c.ray.target - c.ray.origin) : c.ray.origin;
      std::array<Vec3f, kPoints> points;
      for (Vec3f& p : points) p = PointThrough(c, common, parallel, rng);
      std::array<float, kPoints> values;
      const float bound = ValuesFor(target, parallel)(c.a, c.b, c.c, common, points, values.data());
      const int turn =
          parallel ? SideOfDirection(c.a, c.b, c.c, common) : -SideOfPlane(c.a, c.b, c.c, common);
      if (turn == 0) continue;
      for (size_t p = 0; p < kPoints; ++p) {
        if (!RunsWithin(c, common, parallel, turn, points[p])) continue;
        ++within;
        const int exact = SideOfPlane(c.a, c.b, c.c, points[p]);
        const int said = (values[p] > 0) - (values[p] < 0);
        certain += std::abs(values[p]) > bound ? 1 : 0;
        if (said == exact) continue;
        ++wrong;
        worst = std::max(worst, double{std::abs(values[p])} / bound);
        ASSERT_LE(std::abs(values[p]), bound)
            << SimdTargetName(target) << ", point " << points[p].x << ", " << points[p].y << ", "
            << points[p].z << ", " << c;
      }
    }
    std::cout << SimdTargetName(target) << ": " << within << " within the edges, "
              << 100.0 * static_cast<double>(certain) / static_cast<double>(within)
              << " % certain; " << wrong << " on the wrong side, by up to " << worst
              << " of the bound\n";
    EXPECT_GT(certain, within / 4);
    EXPECT_GT(wrong, 0);
  }
}

TEST(PlaneBoundTest, SidesBeyondItAreExactFromAnOrigin) { ExpectSidesBeyondBoundsAreExact(false); }

TEST(PlaneBoundTest, SidesBeyondItAreExactAlongADirection) {
  ExpectSidesBeyondBoundsAreExact(true);
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
