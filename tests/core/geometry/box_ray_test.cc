// SPDX-License-Identifier: Apache-2.0
//
// The slab test against exact rational arithmetic (GMP): it never rejects a box that the ray meets.
#include "core/geometry/box_ray.h"

#include <gmpxx.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <iostream>
#include <limits>
#include <ostream>

#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::ScaledCount;
using testing_support::TestRng;

struct Case {
  Vec3f origin, target;
  bool segment = true;
  Box3f box;
};

std::ostream& operator<<(std::ostream& out, const Case& c) {
  char text[320];
  std::snprintf(text, sizeof(text), "%s {%a, %a, %a} {%a, %a, %a} box {%a, %a, %a} .. {%a, %a, %a}",
                c.segment ? "segment" : "ray", c.origin.x, c.origin.y, c.origin.z, c.target.x,
                c.target.y, c.target.z, c.box.lo.x, c.box.lo.y, c.box.lo.z, c.box.hi.x, c.box.hi.y,
                c.box.hi.z);
  return out << text;
}

// Exactly: does {O + tD : t >= 0 (and t <= 1 for a segment)} meet the closed box?
bool MeetsExactly(const Case& c) {
  mpq_class entry = 0, exit = 0;
  bool bounded = c.segment;
  if (bounded) exit = 1;
  for (int k = 0; k < 3; ++k) {
    const mpq_class o(double{c.origin[k]}), lo(double{c.box.lo[k]}), hi(double{c.box.hi[k]});
    const mpq_class d =
        c.segment ? mpq_class(double{c.target[k]}) - o : mpq_class(double{c.target[k]});
    if (d == 0) {
      if (o < lo || o > hi) return false;
      continue;
    }
    const mpq_class near = ((d > 0 ? lo : hi) - o) / d, far = ((d > 0 ? hi : lo) - o) / d;
    if (near > entry) entry = near;
    if (!bounded || far < exit) exit = far;
    bounded = true;
  }
  return !bounded || entry <= exit;
}

float Nudge(float x, int steps) {
  const float end =
      std::copysign(std::numeric_limits<float>::infinity(), static_cast<float>(steps));
  for (int i = 0; i < std::abs(steps); ++i) x = std::nextafter(x, end);
  return x;
}

class Cases {
 public:
  explicit Cases(TestRng& rng) : rng_(rng) {}

  Case Next() {
    Case c;
    const int kind = next_++ % 6;
    const double scale = std::ldexp(1.0, static_cast<int>(rng_.Below(60)) - 30);
    c.segment = rng_.Chance(0.5);
    c.origin = Point(scale);
    c.target = Point(scale);
    if (kind == 1) {  // Any bits.
      for (int k = 0; k < 3; ++k) {
        c.origin[k] = Bounded();
        c.target[k] = Bounded();
      }
    }
    if (kind == 2) {  // A lattice, subnormal at times.
      const float unit = rng_.Chance(0.5) ? 1.0f : 0x1p-149f;
      c.origin = Lattice(unit);
      c.target = Lattice(unit);
    }
    for (int k = 0; k < 3; ++k) {
      if (rng_.Chance(0.15))
        c.target[k] = c.segment ? c.origin[k] : rng_.Chance(0.5) ? 0.0f : -0.0f;
      if (!c.segment && rng_.Chance(0.05))
        c.target[k] = static_cast<float>(rng_.Below(8)) * 0x1p-149f;
      if (!c.segment && rng_.Chance(0.05))
        c.target[k] = Nudge(0x1p-126f, static_cast<int>(rng_.Below(5)) - 2);
    }
    // A point of the line, and the least box that surely holds it, at times wider on some sides.
    const double t = rng_.Chance(0.2) ? 0 : rng_.Chance(0.2) ? 1 : rng_.Uniform(0, 1.2);
    for (int k = 0; k < 3; ++k) {
      const double o = c.origin[k], d = c.segment ? double{c.target[k]} - o : double{c.target[k]};
      const float at = static_cast<float>(o + d * t);
      c.box.lo[k] = Clamp(Nudge(at, -static_cast<int>(rng_.Below(3))));
      c.box.hi[k] = Clamp(Nudge(at, static_cast<int>(rng_.Below(3))));
      if (rng_.Chance(0.2)) c.box.lo[k] = std::min(c.box.lo[k], Bounded());
      if (rng_.Chance(0.2)) c.box.hi[k] = std::max(c.box.hi[k], Bounded());
      if (rng_.Chance(0.1))
        c.box.lo[k] = std::min(c.box.lo[k], c.origin[k]);  // The origin on a face.
      if (rng_.Chance(0.1)) c.box.hi[k] = std::max(c.box.hi[k], c.origin[k]);
    }
    return c;
  }

 private:
  static float Clamp(float x) { return std::fmin(std::fmax(x, -0x1p40f), 0x1p40f); }
  float Bounded() { return Clamp(rng_.AnyFloat()); }
  Vec3f Point(double scale) {
    return ToFloat(Vec3d{rng_.Uniform(-scale, scale), rng_.Uniform(-scale, scale),
                         rng_.Uniform(-scale, scale)});
  }
  Vec3f Lattice(float unit) {
    Vec3f v;
    for (int k = 0; k < 3; ++k) v[k] = (static_cast<float>(rng_.Below(9)) - 4) * unit;
    return v;
  }

  TestRng& rng_;
  int next_ = 0;
};

BoxRay RayOf(const Case& c) {
  return BoxRay::Make(c.origin, c.segment ? c.target - c.origin : c.target);
}

TEST(BoxRayTest, NeverRejectsABoxThatTheRayMeets) {
  TestRng rng;
  Cases cases(rng);
  int64_t met = 0, missed = 0, falsely = 0;
  for (int64_t i = ScaledCount(150'000); i > 0; --i) {
    const Case c = cases.Next();
    const BoxRay ray = RayOf(c);
    if (!MeetsExactly(c)) {
      ++missed;
      falsely += MayMeetBox(ray, c.box);
      continue;
    }
    ++met;
    ASSERT_TRUE(MayMeetBox(ray, c.box)) << c;
    if (c.segment) {
      ASSERT_LE(BoxEntry(ray, c.box), kSegmentEnd) << c;
    }
  }
  std::cout << met << " met, " << missed << " missed, of which " << falsely << " are not culled\n";
  EXPECT_GT(met, missed / 10);
  EXPECT_GT(missed, met / 100);
}

// Entries never grow and exits never shrink as a box grows: distance culling rests on it.
TEST(BoxRayTest, IsMonotone) {
  TestRng rng;
  Cases cases(rng);
  for (int64_t i = ScaledCount(150'000); i > 0; --i) {
    const Case c = cases.Next();
    const BoxRay ray = RayOf(c);
    Box3f box = c.box;
    for (int grow = 0; grow < 4; ++grow) {
      const float entry = BoxEntry(ray, box), exit = BoxExit(ray, box);
      ASSERT_FALSE(std::isnan(entry) || std::isnan(exit)) << c;
      const int k = static_cast<int>(rng.Below(3));
      switch (rng.Below(4)) {
        case 0:
          box.lo[k] = Nudge(box.lo[k], -1);
          break;
        case 1:
          box.hi[k] = Nudge(box.hi[k], 1);
          break;
        case 2:
          box.lo[k] = std::min(box.lo[k], c.origin[k]);
          break;
        default:
          box.hi[k] = std::max(box.hi[k], c.origin[k]);
          break;
      }
      ASSERT_LE(BoxEntry(ray, box), entry) << c;
      ASSERT_GE(BoxExit(ray, box), exit) << c;
    }
  }
}

TEST(BoxRayTest, AxisParallelRaysWithZerosOfBothSigns) {
  const Box3f box{{0, 0, 0}, {1, 1, 1}};
  for (const float zero : {0.0f, -0.0f}) {
    for (const float other : {0.0f, -0.0f}) {
      EXPECT_TRUE(MayMeetBox(BoxRay::Make({0.5f, 0.5f, -1}, {zero, other, 1}), box));
      EXPECT_TRUE(MayMeetBox(BoxRay::Make({0, 0.5f, -1}, {zero, other, 1}), box))
          << "in a face's plane";
      EXPECT_TRUE(MayMeetBox(BoxRay::Make({1, 1, -1}, {zero, other, 1}), box)) << "along an edge";
      EXPECT_TRUE(MayMeetBox(BoxRay::Make({1, 1, 1}, {zero, other, 1}), box)) << "from a corner";
      EXPECT_FALSE(MayMeetBox(BoxRay::Make({2, 0.5f, -1}, {zero, other, 1}), box));
      EXPECT_FALSE(MayMeetBox(BoxRay::Make({-0x1p-149f, 0.5f, -1}, {zero, other, 1}), box));
      EXPECT_FALSE(MayMeetBox(BoxRay::Make({0.5f, 0.5f, 2}, {zero, other, 1}), box)) << "behind";
    }
  }
}

// A slot that is not in use, or a scene without triangles, has an inverted box: nothing meets it,
// unless no axis says anything at all.
TEST(BoxRayTest, AnEmptyBoxIsMetByNoRayWithADirection) {
  TestRng rng;
  Cases cases(rng);
  for (int64_t i = ScaledCount(20'000); i > 0; --i) {
    const Case c = cases.Next();
    const BoxRay ray = RayOf(c);
    bool silent = true;
    for (int k = 0; k < 3; ++k) silent &= std::isnan(ray.inv[k]);
    if (!silent) {
      ASSERT_FALSE(MayMeetBox(ray, Box3f{})) << c;
    }
  }
}

TEST(BoxRayTest, SubnormalDirectionsCullNothingOnTheirAxis) {
  EXPECT_TRUE(std::isnan(SlabReciprocal(0x1p-149f)));
  EXPECT_TRUE(std::isnan(SlabReciprocal(-0x1.fffffcp-127f)));
  EXPECT_EQ(SlabReciprocal(0x1p-126f), 0x1p126f);
  EXPECT_EQ(SlabReciprocal(0.0f), std::numeric_limits<float>::infinity());
  EXPECT_EQ(SlabReciprocal(-0.0f), -std::numeric_limits<float>::infinity());
}

}  // namespace
}  // namespace sightline
