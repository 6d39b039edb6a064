// SPDX-License-Identifier: Apache-2.0
//
// Every ray begins as box_ray.h has it by itself, whatever the rays that begin beside it are, on
// each instruction set that walks are compiled for and this machine has. Bit for bit, but that one
// NaN is as good as another. Rays are finite, as all are.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/traverse/walk_starts_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <vector>

#include "core/accel/bvh.h"
#include "core/geometry/box3.h"
#include "core/geometry/box_ray.h"
#include "core/geometry/vec3.h"
#include "core/intersect/predicate.h"
#include "core/traverse/trace_ray.h"
#include "core/traverse/walk_starts-inl.h"
#include "gtest/gtest.h"
#include "hwy/highway.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

#ifndef SIGHTLINE_TESTS_CORE_TRAVERSE_WALK_STARTS_TEST_ONCE_
#define SIGHTLINE_TESTS_CORE_TRAVERSE_WALK_STARTS_TEST_ONCE_
namespace sightline {
namespace {

using testing_support::TestRng;

// Often a face's, a ray's origin's and its end's alike.
float Coordinate(TestRng& rng) {
  if (rng.Chance(0.7)) return static_cast<float>(rng.Below(5)) - 2;
  return static_cast<float>(rng.Uniform(-3, 3));
}

// None, of either sign; one whose reciprocal overflows; one of any size.
float Component(TestRng& rng) {
  constexpr float kOdd[] = {0.0f, -0.0f, 1e-40f, -1e-40f, 0x1p-126f, -0x1p-126f, 1e30f, 1.0f};
  if (rng.Chance(0.5)) return kOdd[rng.Below(std::size(kOdd))];
  return static_cast<float>(rng.Uniform(-1, 1) * std::exp2(rng.Uniform(-30, 30)));
}

BvhNode RandomRoot(TestRng& rng) {
  BvhNode root = {};
  root.child_count = static_cast<uint32_t>(1 + rng.Below(kBvhWidth));
  for (int c = 0; c < kBvhWidth; ++c) {
    const bool used = c < static_cast<int>(root.child_count);
    root.child[c] = used ? ChildRef::Inner(static_cast<uint32_t>(c + 1)) : ChildRef::Empty();
    for (int k = 0; k < 3; ++k) {
      const float a = Coordinate(rng), b = Coordinate(rng);
      root.bounds[k][c] = std::min(a, b);
      root.bounds[k + 3][c] = std::max(a, b);
    }
  }
  return root;
}

TraceRay RandomQuery(TestRng& rng) {
  const auto vector = [&rng](auto coordinate) {
    const float x = coordinate(rng), y = coordinate(rng), z = coordinate(rng);
    return Vec3f{x, y, z};
  };
  const Vec3f origin = vector(Coordinate);
  return {.ray = rng.Chance(0.5) ? PredicateRay::Segment(origin, vector(Coordinate))
                                 : PredicateRay::Ray(origin, vector(Component))};
}

// Those of the root's children that a ray meets before `limit`.
uint32_t Met(const BvhNode& root, const BoxRay& ray, float limit) {
  uint32_t met = 0;
  for (uint32_t c = 0; c < root.child_count; ++c) {
    const auto face = [&](int row) { return root.bounds[row][c]; };
    const Box3f box = {{face(0), face(1), face(2)}, {face(3), face(4), face(5)}};
    const float last = std::fma(BoxExit(ray, box), kBoxExitScale, kBoxExitShift);
    if (std::max(BoxEntry(ray, box), 0.0f) <= std::min(last, limit)) met |= 1u << c;
  }
  return met;
}

void ExpectSame(float got, float wanted) {
  if (std::isnan(wanted)) {
    EXPECT_TRUE(std::isnan(got)) << got;
  } else {
    EXPECT_EQ(std::bit_cast<uint32_t>(got), std::bit_cast<uint32_t>(wanted))
        << got << ' ' << wanted;
  }
}

}  // namespace
}  // namespace sightline
#endif  // SIGHTLINE_TESTS_CORE_TRAVERSE_WALK_STARTS_TEST_ONCE_

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {
namespace {

// Adds how many children were met, and how many were not.
template <bool kAny>
void ExpectAsAlone(const BvhNode& root, const std::vector<TraceRay>& rays, uint64_t (*counts)[2]) {
  WalkStarts<kAny> starts(root, rays);
  for (size_t i = 0; i < rays.size(); ++i) {
    SCOPED_TRACE(i);
    ASSERT_TRUE(starts.any_left());
    ASSERT_EQ(starts.count(), i);
    RayTerms terms;
    ASSERT_EQ(&starts.Take(&terms), &rays[i]);
    const PredicateRay& ray = rays[i].ray;
    const BoxRay wanted = BoxRay::Make(ray.origin, ray.RoundedDirection());
    ExpectSame(terms.limit, ray.segment ? kSegmentEnd : std::numeric_limits<float>::infinity());
    for (uint32_t k = 0; k < 3; ++k) {
      ExpectSame(terms.origin[k], ray.origin[k]);
      ExpectSame(terms.minus_inv[k], -wanted.inv[k]);
      if (std::isnan(wanted.inv[k])) {  // Either face: the axis never culls.
        EXPECT_EQ(terms.near[k] + terms.far[k], (2 * k + 3) * sizeof(root.bounds[0]));
        continue;
      }
      const bool down = std::signbit(wanted.inv[k]);
      EXPECT_EQ(terms.near[k], (down ? k + 3 : k) * sizeof(root.bounds[0]));
      EXPECT_EQ(terms.far[k], (down ? k : k + 3) * sizeof(root.bounds[0]));
    }
    if constexpr (kAny) {
      EXPECT_EQ(terms.root, Met(root, wanted, terms.limit));
      (*counts)[1] += static_cast<uint64_t>(std::popcount(terms.root));
      (*counts)[0] += root.child_count - static_cast<uint64_t>(std::popcount(terms.root));
    }
    if (testing::Test::HasFailure()) return;
  }
  EXPECT_FALSE(starts.any_left());
}

void ExpectAllAsAlone(const BvhNode& root, const std::vector<TraceRay>& rays,
                      uint64_t (*counts)[2]) {
  ExpectAsAlone<true>(root, rays, counts);
  ExpectAsAlone<false>(root, rays, counts);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace sightline {
namespace {

HWY_EXPORT(ExpectAllAsAlone);

TEST(WalkStartsTest, EachRayBeginsAsItWouldAlone) {
  TestRng rng;
  for (const int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    hwy::SetSupportedTargetsForTest(target);
    uint64_t counts[2] = {0, 0};
    for (int64_t left = testing_support::ScaledCount(2000); left > 0 && !HasFailure(); --left) {
      const BvhNode root = RandomRoot(rng);
      std::vector<TraceRay> rays(1 + rng.Below(70));
      for (TraceRay& ray : rays) ray = RandomQuery(rng);
      HWY_DYNAMIC_DISPATCH(ExpectAllAsAlone)(root, rays, &counts);
    }
    EXPECT_GT(counts[0], 1000u);
    EXPECT_GT(counts[1], 1000u);
  }
  hwy::SetSupportedTargetsForTest(0);
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
