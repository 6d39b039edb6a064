// SPDX-License-Identifier: Apache-2.0
//
// hit-inl.h gives HitDistance's bits on every lane, for every target of this machine.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/intersect/hit_simd_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/geometry/box_ray.h"
#include "core/intersect/hit-inl.h"
#include "core/intersect/predicate.h"
#include "hwy/highway.h"

#ifndef SIGHTLINE_TESTS_HIT_SIMD_TYPES_
#define SIGHTLINE_TESTS_HIT_SIMD_TYPES_
namespace sightline {

constexpr int kHitLanes = 16;

// Rays with one origin, and one triangle.
struct HitLanes {
  Vec3f origin, a, b, c;
  bool segments = true;
  alignas(64) float target[3][kHitLanes];
  alignas(64) float inv[3][kHitLanes];
  alignas(64) float distance[kHitLanes];
};

}  // namespace sightline
#endif

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

void EvaluateDistances(HitLanes& lanes) {
  const hn::CappedTag<float, kHitLanes> d;
  using V = hn::Vec<decltype(d)>;
  const TriangleDistance t = TriangleDistance::Make(lanes.origin, lanes.a, lanes.b, lanes.c);
  for (size_t i = 0; i < kHitLanes; i += hn::Lanes(d)) {
    const Vec3V<V> target = {hn::Load(d, lanes.target[0] + i), hn::Load(d, lanes.target[1] + i),
                             hn::Load(d, lanes.target[2] + i)};
    const Vec3V<V> inv = {hn::Load(d, lanes.inv[0] + i), hn::Load(d, lanes.inv[1] + i),
                          hn::Load(d, lanes.inv[2] + i)};
    hn::Store(HitDistances(d, t, lanes.origin, lanes.segments, target, inv), d, lanes.distance + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <bit>
#include <cstdint>
#include <vector>

#include "core/intersect/hit.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/triangle_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::ClampToRange;
using testing_support::MoveByUlps;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::TriangleCase;
using testing_support::TriangleCases;

TEST(HitSimdTest, EveryLaneHasTheScalarDistancesBits) {
  using Evaluate = void (*)(HitLanes&);
  std::vector<Evaluate> targets = {&N_AVX2::EvaluateDistances};
  if ((hwy::SupportedTargets() & HWY_AVX3) != 0) targets.push_back(&N_AVX3::EvaluateDistances);
  TestRng rng;
  TriangleCases cases(rng);
  int64_t compared = 0;
  for (int64_t i = ScaledCount(60'000); i > 0; --i) {
    const TriangleCase c = cases.Next();
    HitLanes lanes;
    lanes.origin = c.ray.origin;
    lanes.a = c.a;
    lanes.b = c.b;
    lanes.c = c.c;
    lanes.segments = c.ray.segment;
    for (int lane = 0; lane < kHitLanes; ++lane) {
      Vec3f target = c.ray.target;
      if (lane > 0) {
        const int axis = static_cast<int>(rng.Below(3));
        target[axis] = MoveByUlps(target[axis], static_cast<int>(rng.Below(1 + lane)) - lane / 2);
        target = ClampToRange(target);
      }
      const PredicateRay ray{c.ray.origin, target, c.ray.segment};
      const Vec3f direction = ray.RoundedDirection();
      for (int k = 0; k < 3; ++k) {
        lanes.target[k][lane] = target[k];
        lanes.inv[k][lane] = SlabReciprocal(direction[k]);
      }
    }
    for (const Evaluate evaluate : targets) {
      evaluate(lanes);
      for (int lane = 0; lane < kHitLanes; ++lane) {
        const PredicateRay ray{
            c.ray.origin,
            {lanes.target[0][lane], lanes.target[1][lane], lanes.target[2][lane]},
            c.ray.segment};
        if (!Blocks(ray, c.a, c.b, c.c)) continue;
        ++compared;
        ASSERT_EQ(std::bit_cast<uint32_t>(lanes.distance[lane]),
                  std::bit_cast<uint32_t>(HitDistance(ray, c.a, c.b, c.c)))
            << c << ", lane " << lane << ": " << lanes.distance[lane];
      }
    }
  }
  EXPECT_GT(compared, ScaledCount(60'000));
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
