// SPDX-License-Identifier: Apache-2.0
//
// The sides of planes and edges in doubles, sixteen points at a time, against exact arithmetic.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/traverse/plane_side_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include <cstddef>
#include <span>

#include "core/geometry/vec3.h"
#include "core/traverse/plane_side-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// sides[i] of points[i], sixteen of them.
void SidesInDoubles(Vec3d v, Vec3d w, float sign, const Vec3f* base, std::span<const Vec3f> points,
                    float* sides) {
  const ShaftD d;
  alignas(64) float rows[3][kShaftBlockRays], out[kShaftBlockRays];
  for (size_t i = 0; i < points.size(); ++i) {
    for (int k = 0; k < 3; ++k) rows[k][i] = points[i][k];
  }
  for (size_t at = 0; at < points.size(); at += hn::Lanes(d)) {
    const Vec3V<ShaftV> some = {hn::Load(d, rows[0] + at), hn::Load(d, rows[1] + at),
                                hn::Load(d, rows[2] + at)};
    hn::Store(SideInDoubles(v, w, sign, base, some), d, out + at);
  }
  for (size_t i = 0; i < points.size(); ++i) sides[i] = out[i];
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
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
using testing_support::Hex;
using testing_support::MoveByUlps;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::TriangleCase;
using testing_support::TriangleCases;

constexpr size_t kPoints = 16;

auto* SidesFor(SimdTarget target) {
  return target == SimdTarget::kAvx512 ? &N_AVX3::SidesInDoubles : &N_AVX2::SidesInDoubles;
}

// The case's own end, and others beside it.
std::array<Vec3f, kPoints> PointsAround(const TriangleCase& c, TestRng& rng) {
  std::array<Vec3f, kPoints> points;
  for (size_t i = 0; i < kPoints; ++i) {
    Vec3f p = c.ray.target;
    for (int k = 0; i > 0 && k < 3; ++k) {
      p[k] = MoveByUlps(p[k], static_cast<int>(rng.Below(5)) - 2);
    }
    points[i] = ClampToRange(p);
  }
  return points;
}

// fn(target, sides, exact sides) for many cases, `is_plane`: of a triangle's plane, from its first
// corner; else of the plane through the origin and an edge, along directions.
template <class Fn>
void ForManyCases(bool is_plane, const Fn& fn) {
  for (const SimdTarget target : AvailableTargets()) {
    TestRng rng;
    TriangleCases cases(rng);
    for (int64_t i = ScaledCount(40'000); i > 0; --i) {
      const TriangleCase c = cases.Next();
      const std::array<Vec3f, kPoints> points = PointsAround(c, rng);
      const float sign = rng.Chance(0.5) ? 1 : -1;
      const Vec3d a = ToDouble(c.a), ab = ToDouble(c.b) - a;
      std::array<float, kPoints> sides;
      std::array<int, kPoints> exact;
      if (is_plane) {
        SidesFor(target)(ab, ToDouble(c.c) - a, sign, &c.a, points, sides.data());
      } else {
        SidesFor(target)(a - ToDouble(c.ray.origin), ab, sign, nullptr, points, sides.data());
      }
      for (size_t p = 0; p < kPoints; ++p) {
        exact[p] = static_cast<int>(sign) *
                   (is_plane ? SideOfPlane(c.a, c.b, c.c, points[p])
                             : SideOfDirection(c.ray.origin, c.a, c.b, points[p]));
      }
      fn(target, c, sides, exact);
    }
  }
}

void ExpectCertainSidesAreExact(bool is_plane) {
  int64_t certain = 0, all = 0;
  ForManyCases(is_plane,
               [&](SimdTarget target, const TriangleCase& c, const auto& sides, const auto& exact) {
                 for (size_t p = 0; p < kPoints; ++p) {
                   ++all;
                   if (sides[p] == 0) continue;
                   ++certain;
                   ASSERT_EQ(static_cast<int>(sides[p]), exact[p])
                       << SimdTargetName(target) << ", point " << p << ", " << c;
                 }
               });
  std::cout << 100.0 * static_cast<double>(certain) / static_cast<double>(all) << " % certain\n";
  EXPECT_GT(certain, all / 4);
}

TEST(PlaneSideTest, CertainSidesOfTrianglesAreExact) { ExpectCertainSidesAreExact(true); }

TEST(PlaneSideTest, CertainSidesOfEdgesAreExact) { ExpectCertainSidesAreExact(false); }

// The predicate takes a determinant for zero, without exact arithmetic, where all of its products
// have a factor that is zero.
TEST(PlaneSideTest, PlanesAcrossAnAxisAreToldExactly) {
  TestRng rng;
  for (int64_t i = ScaledCount(20'000); i > 0; --i) {
    const int axis = static_cast<int>(rng.Below(3));
    const int exponent = static_cast<int>(rng.Below(190)) - 149;
    const auto any = [&] {
      Vec3f v;
      for (int k = 0; k < 3; ++k)
        v[k] = std::ldexp(static_cast<float>(rng.Uniform(-1, 1)), exponent);
      return v;
    };
    Vec3f a = any(), b = any(), c = any(), p = any(), way = any();
    b[axis] = c[axis] = a[axis];
    const int steps = static_cast<int>(rng.Below(3)) - 1;
    p[axis] = MoveByUlps(a[axis], steps);
    if (steps == 0) way[axis] = 0;
    // On which side the axis leads.
    const int i1 = (axis + 1) % 3, i2 = (axis + 2) % 3;
    const auto turn = [&] {
      const auto exact = [](float x, float y) { return static_cast<__float128>(x) - y; };
      const __float128 area =
          exact(b[i1], a[i1]) * exact(c[i2], a[i2]) - exact(b[i2], a[i2]) * exact(c[i1], a[i1]);
      return area > 0 ? 1 : area < 0 ? -1 : 0;
    }();
    const int beyond = p[axis] > a[axis] ? 1 : p[axis] < a[axis] ? -1 : 0;
    ASSERT_EQ(SideOfPlane(a, b, c, p), turn * beyond) << Hex(a) << Hex(b) << Hex(c) << Hex(p);
    const int leads = way[axis] > 0 ? 1 : way[axis] < 0 ? -1 : 0;
    ASSERT_EQ(SideOfDirection(a, b, c, way), turn * leads)
        << Hex(a) << Hex(b) << Hex(c) << Hex(way);
  }
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
