// SPDX-License-Identifier: Apache-2.0
//
// A packet's corner rays never miss a box that the slab test's own floats say its ray comes to, at
// one parameter along every axis: closest-hit walks of kd-trees need such cells, hit or not
// (core/accel/kd_tree.h, 2).
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/traverse/packet_frustum_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/accel/indexed_geometry.h"
#include "core/geometry/box3.h"
#include "core/traverse/packet_frustum-inl.h"
#include "core/traverse/packet_lanes-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// Whether the packet's frustum misses a box that is given relative to its origin.
bool FrustumMisses(const IndexedGeometry& scene, RayPacket& packet, const Box3f& box) {
  WalkStats stats;
  const PacketLanes<false> lanes(scene, packet, &stats);
  const PacketSlopes slopes(lanes, /*first_axis=*/false);
  const float lo[3] = {box.lo.x, box.lo.y, box.lo.z}, hi[3] = {box.hi.x, box.hi.y, box.hi.z};
  return slopes.valid() && slopes.MissesBox(lo, hi);
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>

#include "core/geometry/box_ray.h"
#include "core/traverse/simd_target.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AvailableTargets;
using testing_support::ScaledCount;
using testing_support::TestRng;

auto* MissesFor(SimdTarget target) {
  return target == SimdTarget::kAvx512 ? &N_AVX3::FrustumMisses : &N_AVX2::FrustumMisses;
}

float AnyFloat(TestRng& rng, int least, int most) {
  const float x = std::ldexp(static_cast<float>(rng.Uniform(1, 2)),
                             least + static_cast<int>(rng.Below(most - least + 1)));
  return rng.Chance(0.5) ? x : -x;
}

// Faces about the ray's point at `e`, each as far on the wrong side of it as its float parameter
// lets it be, or well on the right one. Axes whose reciprocal is not to be trusted have any.
Box3f BoxAt(const BoxRay& ray, Vec3f direction, float e, TestRng& rng) {
  constexpr double kUnit = 0x1p-24;
  Box3f box;
  for (int k = 0; k < 3; ++k) {
    const double at = double{e} * direction[k];
    float near_face = static_cast<float>(at), far_face = near_face;
    if (std::isnan(ray.inv[k])) {
      near_face = far_face = AnyFloat(rng, -140, 30);
    } else {
      const bool tight_near = rng.Chance(0.6), tight_far = rng.Chance(0.6);
      const auto place = [&](bool is_near, bool tight) {
        const double beyond = is_near ? 1 : -1;
        for (const double by : {0.5, 0.3, 0.1, 9 * kUnit, 6 * kUnit, 4 * kUnit, 2 * kUnit, kUnit}) {
          const float face = static_cast<float>(at * (1 + beyond * by));
          const float t = face * ray.inv[k];
          if (tight && (is_near ? t <= e : t >= e)) return face;
        }
        return static_cast<float>(at * (1 - beyond * 0.5));
      };
      near_face = place(true, tight_near);
      far_face = place(false, tight_far);
    }
    // Turned the way the axis runs, a cell's faces are in order.
    box.lo[k] = std::min(near_face, far_face);
    box.hi[k] = std::max(near_face, far_face);
  }
  return box;
}

// Whether the float slab test has the ray within the box at `e`.
bool IsWithin(const BoxRay& ray, const Box3f& box, float e) {
  return BoxEntry(ray, box) <= e && e <= BoxExit(ray, box);
}

std::unique_ptr<RayPacket> PacketOfOneRay() {
  auto packet = std::make_unique<RayPacket>();
  packet->segments = false;
  packet->count = 1;
  packet->sourceless = true;
  return packet;
}

TEST(PacketFrustumTest, NeverMissesABoxThatFloatsComeTo) {
  const IndexedGeometry scene;
  const auto packet = PacketOfOneRay();
  for (const SimdTarget target : AvailableTargets()) {
    TestRng rng;
    int64_t asked = 0;
    for (int64_t i = ScaledCount(60'000); i > 0; --i) {
      // Ordinary directions; long ones, along which parameters underflow; and subnormal parts.
      const int most = rng.Chance(0.5) ? 39 : 3;
      Vec3f direction;
      for (int k = 0; k < 3; ++k) {
        direction[k] = AnyFloat(rng, rng.Chance(0.1) ? -148 : most - 6, most);
        if (rng.Chance(0.05)) direction[k] = 0;
      }
      const float e =
          std::abs(AnyFloat(rng, rng.Chance(0.5) ? -149 : -40, rng.Chance(0.5) ? -144 : 1));
      const BoxRay ray = BoxRay::Make({}, direction);
      const Box3f box = BoxAt(ray, direction, e, rng);
      if (!IsWithin(ray, box, e)) continue;
      ++asked;
      packet->target_x[0] = direction.x;
      packet->target_y[0] = direction.y;
      packet->target_z[0] = direction.z;
      ASSERT_FALSE(MissesFor(target)(scene, *packet, box))
          << SimdTargetName(target) << std::hexfloat << ": e " << e << ", direction " << direction.x
          << ' ' << direction.y << ' ' << direction.z << ", box " << box.lo.x << ' ' << box.lo.y
          << ' ' << box.lo.z << " to " << box.hi.x << ' ' << box.hi.y << ' ' << box.hi.z;
    }
    EXPECT_GT(asked, ScaledCount(60'000) / 10);
  }
}

// It does tell what lies beside.
TEST(PacketFrustumTest, MissesWhatLiesBeside) {
  const IndexedGeometry scene;
  const auto packet = PacketOfOneRay();
  packet->target_x[0] = 1;
  packet->target_y[0] = packet->target_z[0] = 0.5f;
  for (const SimdTarget target : AvailableTargets()) {
    EXPECT_TRUE(MissesFor(target)(scene, *packet, {{1, 1.01f, 0}, {2, 3, 3}}));
    EXPECT_TRUE(MissesFor(target)(scene, *packet, {{1, -3, 0}, {2, 0.49f, 3}}));
    EXPECT_TRUE(MissesFor(target)(scene, *packet, {{-2, -3, -3}, {-1, 3, 3}}));
    EXPECT_FALSE(MissesFor(target)(scene, *packet, {{1, 0.9f, 0.9f}, {2, 3, 3}}));
  }
}

}  // namespace
}  // namespace sightline

#endif  // HWY_ONCE
