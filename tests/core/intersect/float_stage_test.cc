// SPDX-License-Identifier: Apache-2.0
//
// The SIMD float stage by itself, for every target of this machine: each linear form's real error
// against its bound (the exact value comes from 113-bit arithmetic, whose own error is 2^-80 of the
// bound), and each claim of a sign against exact arithmetic. A hill climb hunts for the input that
// comes nearest to the bound.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tests/core/intersect/float_stage_test.cc"
#ifndef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX2 | HWY_AVX3))
#endif
// clang-format off: it has to come before what it compiles for every target.
#include "hwy/foreach_target.h"
// clang-format on

#include "core/intersect/predicate-inl.h"
#include "core/intersect/predicate.h"
#include "core/intersect/ray_forms-inl.h"
#include "hwy/highway.h"

#ifndef SIGHTLINE_TESTS_FLOAT_STAGE_TYPES_
#define SIGHTLINE_TESTS_FLOAT_STAGE_TYPES_
namespace sightline {

constexpr int kStageLanes = 16;
constexpr int kForms = 5;  // Three edges, the origin's side, the target's side (segments only).

struct StageLanes {
  alignas(64) float rows[10 * kStageLanes] = {};
  alignas(64) float value[kForms][kStageLanes];
  alignas(64) float bound[kForms][kStageLanes];

  void SetTriangle(int lane, Vec3f a, Vec3f b, Vec3f c) {
    const Vec3f corners[3] = {a, b, c};
    for (int corner = 0; corner < 3; ++corner) {
      for (int k = 0; k < 3; ++k) rows[(3 * corner + k) * kStageLanes + lane] = corners[corner][k];
    }
  }
  Vec3f corner(int corner, int lane) const {
    return {rows[3 * corner * kStageLanes + lane], rows[(3 * corner + 1) * kStageLanes + lane],
            rows[(3 * corner + 2) * kStageLanes + lane]};
  }
};

}  // namespace sightline
#endif

HWY_BEFORE_NAMESPACE();
namespace sightline {
namespace HWY_NAMESPACE {

// The forms and bounds of rays with one origin, as walks of packets compute them
// (core/traverse/packet_lanes-inl.h).
void EvaluateOriginStage(const PredicateRay& ray, StageLanes& lanes) {
  const hn::CappedTag<float, kStageLanes> d;
  using V = hn::Vec<decltype(d)>;
  const Vec3f direction = ray.RoundedDirection();
  const Vec3V<V> o = Broadcast(d, ray.origin.x, ray.origin.y, ray.origin.z);
  const Vec3V<V> dir = Broadcast(d, direction.x, direction.y, direction.z);
  const Vec3V<V> p = Broadcast(d, ray.target.x, ray.target.y, ray.target.z);
  const V dir_inf = NormInfV(dir), underflow = hn::Set(d, kFloatUnderflow);
  for (size_t first = 0; first < kStageLanes; first += hn::Lanes(d)) {
    const OriginTriangles<V> t = PrepareTriangles(d, lanes.rows + first, kStageLanes, o);
    for (int e = 0; e < 3; ++e) {
      hn::Store(DotV(t.edge[e], dir), d, lanes.value[e] + first);
      hn::Store(hn::MulAdd(t.edge_bound[e], dir_inf, underflow), d, lanes.bound[e] + first);
    }
    hn::Store(t.origin_side, d, lanes.value[3] + first);
    hn::Store(t.origin_bound, d, lanes.bound[3] + first);
    const Vec3V<V> ap = SubV(p, t.a);
    hn::Store(DotV(t.normal, ap), d, lanes.value[4] + first);
    hn::Store(BoundAlong(d, t.normal_bound, ap), d, lanes.bound[4] + first);
  }
}

// Those of one ray (core/traverse/single-inl.h).
void EvaluateRayStage(const PredicateRay& ray, StageLanes& lanes) {
  const hn::CappedTag<float, kStageLanes> d;
  using V = hn::Vec<decltype(d)>;
  const auto ray_lanes = RayLanes<V>::Of(d, ray);
  for (size_t first = 0; first < kStageLanes; first += hn::Lanes(d)) {
    const RayForms<V> forms =
        EvaluateForms(d, lanes.rows + first, kStageLanes, ray_lanes, ray.segment);
    for (int e = 0; e < 3; ++e) {
      hn::Store(forms.edge[e], d, lanes.value[e] + first);
      hn::Store(forms.edge_bound, d, lanes.bound[e] + first);
    }
    hn::Store(forms.origin_side, d, lanes.value[3] + first);
    hn::Store(forms.origin_bound, d, lanes.bound[3] + first);
    if (!ray.segment) continue;
    hn::Store(forms.target_side, d, lanes.value[4] + first);
    hn::Store(forms.target_bound, d, lanes.bound[4] + first);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace sightline
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <cmath>
#include <cstdint>
#include <iostream>
#include <map>
#include <string>
#include <vector>

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

using Quad = __float128;

struct Vec3q {
  Quad x, y, z;
};
Vec3q Difference(Vec3f a, Vec3f b) { return {Quad(a.x) - b.x, Quad(a.y) - b.y, Quad(a.z) - b.z}; }
Quad Determinant(Vec3q x, Vec3q y, Vec3q z) {
  return (x.y * y.z - x.z * y.y) * z.x + (x.z * y.x - x.x * y.z) * z.y +
         (x.x * y.y - x.y * y.x) * z.z;
}

// The stages: of rays with one origin, and of one ray.
enum class Stage { kOneOrigin, kOneRay };

// The form's value, to 113 bits of the permanents that the stage's bound is made of, and its exact
// sign.
struct Truth {
  Quad value;
  int sign;
};
Truth TruthOf(Stage stage, const PredicateRay& ray, const StageLanes& lanes, int form, int lane) {
  const Vec3f o = ray.origin, t = ray.target;
  const Vec3f a = lanes.corner(0, lane), b = lanes.corner(1, lane), c = lanes.corner(2, lane);
  const Vec3q d = ray.segment ? Difference(t, o) : Vec3q{t.x, t.y, t.z};
  if (form < 3) {
    const Vec3f p = lanes.corner(form, lane), q = lanes.corner((form + 1) % 3, lane);
    const int sign = ray.segment ? SideOfPlane(o, p, q, t) : SideOfDirection(o, p, q, t);
    if (stage == Stage::kOneOrigin) {
      return {Determinant(Difference(p, o), Difference(q, p), d), sign};
    }
    const Vec3q oa = Difference(a, o), ab = Difference(b, a), ac = Difference(c, a);
    const Quad first = Determinant(oa, ab, d), last = Determinant(ac, oa, d);
    const Quad edges[3] = {first, Determinant(ab, ac, d) - first - last, last};
    return {edges[form], sign};
  }
  const Vec3q ab = Difference(b, a);
  const Vec3q other = stage == Stage::kOneOrigin ? Difference(c, b) : Difference(c, a);
  if (form == 3) {  // N·(A-O): the origin's side, turned.
    return {Determinant(ab, other, Difference(a, o)), -SideOfPlane(a, b, c, o)};
  }
  return {Determinant(ab, other, Difference(t, a)), SideOfPlane(a, b, c, t)};
}

struct Target {
  const char* name;
  Stage stage;
  void (*evaluate)(const PredicateRay&, StageLanes&);
};

std::vector<Target> Targets() {
  std::vector<Target> targets = {
      {"AVX2, one origin", Stage::kOneOrigin, &N_AVX2::EvaluateOriginStage},
      {"AVX2, one ray", Stage::kOneRay, &N_AVX2::EvaluateRayStage}};
  if ((hwy::SupportedTargets() & HWY_AVX3) != 0) {
    targets.push_back({"AVX-512, one origin", Stage::kOneOrigin, &N_AVX3::EvaluateOriginStage});
    targets.push_back({"AVX-512, one ray", Stage::kOneRay, &N_AVX3::EvaluateRayStage});
  }
  return targets;
}

double Ratio(Stage stage, const PredicateRay& ray, const StageLanes& lanes, int form, int lane) {
  const Quad error = Quad(lanes.value[form][lane]) - TruthOf(stage, ray, lanes, form, lane).value;
  return static_cast<double>((error < 0 ? -error : error) / lanes.bound[form][lane]);
}

// Lane 0 holds the case's triangle, the next two its rotations, the rest are moved by ulps.
void FillLanes(const TriangleCase& c, TestRng& rng, StageLanes& lanes) {
  for (int lane = 0; lane < kStageLanes; ++lane) {
    Vec3f corners[3] = {c.a, c.b, c.c};
    if (lane >= 3) {
      Vec3f& v = corners[rng.Below(3)];
      const int axis = static_cast<int>(rng.Below(3));
      v[axis] = MoveByUlps(v[axis], static_cast<int>(rng.Below(5)) - 2);
      v = ClampToRange(v);
    }
    const int turn = lane % 3;
    lanes.SetTriangle(lane, corners[turn], corners[(turn + 1) % 3], corners[(turn + 2) % 3]);
  }
}

// True where the walks would send the lane to Blocks().
bool InDoubt(const PredicateRay& ray, const StageLanes& lanes, int lane) {
  const auto sign = [&](int form) {
    const float value = lanes.value[form][lane], bound = lanes.bound[form][lane];
    return value > bound ? 1 : value < -bound ? -1 : 0;
  };
  bool any_positive = false, any_negative = false, all = true;
  for (int e = 0; e < 3; ++e) {
    any_positive |= sign(e) > 0;
    any_negative |= sign(e) < 0;
    all &= sign(e) != 0;
  }
  const int behind = sign(3);
  if (any_positive && any_negative) return false;
  if ((behind > 0 && any_negative) || (behind < 0 && any_positive)) return false;
  if (!ray.segment) return !(all && behind != 0);
  const int target = sign(4);
  if (behind != 0 && target == -behind) return false;
  return !(all && behind != 0 && target != 0);
}

TEST(FloatStageTest, ErrorsStayWithinTheirBoundsAndCertainSignsAreExact) {
  for (const Target& target : Targets()) {
    SCOPED_TRACE(target.name);
    TestRng rng;
    TriangleCases cases(rng);
    StageLanes lanes;
    double worst[kForms] = {};
    std::map<std::string, std::pair<int64_t, int64_t>> doubt;  // In doubt, of lanes.
    for (int64_t i = ScaledCount(25'000); i > 0; --i) {
      const TriangleCase c = cases.Next();
      FillLanes(c, rng, lanes);
      target.evaluate(c.ray, lanes);
      for (int lane = 0; lane < kStageLanes; ++lane) {
        for (int form = 0; form < (c.ray.segment ? kForms : kForms - 1); ++form) {
          const float value = lanes.value[form][lane], bound = lanes.bound[form][lane];
          ASSERT_TRUE(std::isfinite(value) && std::isfinite(bound)) << c << ", form " << form;
          const double ratio = Ratio(target.stage, c.ray, lanes, form, lane);
          ASSERT_LE(ratio, 1.0) << c << ", form " << form << ", lane " << lane;
          worst[form] = std::max(worst[form], ratio);
          if (value > bound || value < -bound) {
            ASSERT_EQ(TruthOf(target.stage, c.ray, lanes, form, lane).sign, value > 0 ? 1 : -1)
                << c << ", form " << form << ", lane " << lane;
          }
        }
        auto& tally = doubt[c.kind];
        tally.first += InDoubt(c.ray, lanes, lane);
        ++tally.second;
      }
    }
    std::cout << target.name << ": largest error over bound, edges " << worst[0] << " " << worst[1]
              << " " << worst[2] << ", origin " << worst[3] << ", target " << worst[4]
              << "\n  lanes in doubt by kind of input:\n";
    for (const auto& [kind, tally] : doubt) {
      std::cout << "    " << kind << ": " << 100.0 * tally.first / tally.second << " %\n";
    }
  }
}

// What the stage is for: ordinary triangles and ordinary rays are decided here.
TEST(FloatStageTest, OrdinaryTrianglesAreSeldomInDoubt) {
  for (const Target& target : Targets()) {
    TestRng rng;
    StageLanes lanes;
    int64_t in_doubt = 0, all = 0;
    const auto point = [&](double scale) {
      return ToFloat(Vec3d{rng.Uniform(-scale, scale), rng.Uniform(-scale, scale),
                           rng.Uniform(-scale, scale)});
    };
    for (int64_t i = ScaledCount(50'000); i > 0; --i) {
      const PredicateRay ray{point(10), point(10), rng.Chance(0.5)};
      for (int lane = 0; lane < kStageLanes; ++lane) {
        const Vec3f at = point(10);
        lanes.SetTriangle(lane, at + point(0.1), at + point(0.1), at + point(0.1));
      }
      target.evaluate(ray, lanes);
      for (int lane = 0; lane < kStageLanes; ++lane) in_doubt += InDoubt(ray, lanes, lane);
      all += kStageLanes;
    }
    std::cout << target.name << ": "
              << 100.0 * static_cast<double>(in_doubt) / static_cast<double>(all)
              << " % of ordinary lanes are in doubt\n";
    EXPECT_LT(in_doubt, all / 1000) << target.name;
  }
}

// Points next to a level or upright plane, however far along it: what the bounds are made of says
// that nothing there is rounded which matters.
TEST(FloatStageTest, PlanesAcrossAnAxisAreNotInDoubtBesideThem) {
  for (const Target& target : Targets()) {
    if (target.stage != Stage::kOneOrigin) continue;
    SCOPED_TRACE(target.name);
    TestRng rng;
    StageLanes lanes;
    for (int64_t i = ScaledCount(2'000); i > 0; --i) {
      const int axis = static_cast<int>(rng.Below(3));
      const auto height = static_cast<float>(rng.Uniform(-1000, 1000));
      const auto along = [&] {
        Vec3f v;
        for (int k = 0; k < 3; ++k) v[k] = static_cast<float>(rng.Uniform(-1000, 1000));
        return v;
      };
      for (int lane = 0; lane < kStageLanes; ++lane) {
        Vec3f corners[3] = {along(), along(), along()};
        for (Vec3f& corner : corners) corner[axis] = height;
        lanes.SetTriangle(lane, corners[0], corners[1], corners[2]);
      }
      PredicateRay ray{along(), along(), true};
      ray.target[axis] = MoveByUlps(height, rng.Chance(0.5) ? 1 : -1);
      target.evaluate(ray, lanes);
      for (int lane = 0; lane < kStageLanes; ++lane) {
        const float value = lanes.value[4][lane];
        ASSERT_GT(std::abs(value), lanes.bound[4][lane]) << "axis " << axis << ", lane " << lane;
        ASSERT_EQ(TruthOf(target.stage, ray, lanes, 4, lane).sign, value > 0 ? 1 : -1);
      }
    }
  }
}

// Moves coordinates by ulps and by random steps, keeping what brings an error nearer to its bound.
TEST(FloatStageTest, AHillClimbFindsNoErrorBeyondItsBound) {
  for (const Target& target : Targets()) {
    SCOPED_TRACE(target.name);
    TestRng rng;
    StageLanes lanes;
    double best_of_all = 0;
    for (int64_t climb = ScaledCount(200); climb > 0; --climb) {
      const int form = static_cast<int>(rng.Below(kForms));
      // Vectors of one sign and like components make the permanent fill the product of norms.
      const auto start = [&](float base) {
        Vec3f v;
        for (int k = 0; k < 3; ++k) v[k] = base * static_cast<float>(rng.Uniform(-1, 1));
        return v;
      };
      TriangleCase c;
      const float far = std::ldexp(1.0f, static_cast<int>(rng.Below(12)));
      c.a = start(1);
      c.b = start(far);
      c.c = start(1);
      c.ray = PredicateRay{start(far), start(far), form == 4 || rng.Chance(0.5)};
      double best = 0;
      for (int step = 0; step < 400; ++step) {
        TriangleCase next = c;
        Vec3f* const vectors[] = {&next.a, &next.b, &next.c, &next.ray.origin, &next.ray.target};
        for (int changes = 1 + static_cast<int>(rng.Below(4)); changes > 0; --changes) {
          float& x = (*vectors[rng.Below(5)])[static_cast<int>(rng.Below(3))];
          x = rng.Chance(0.7) ? MoveByUlps(x, static_cast<int>(rng.Below(9)) - 4)
                              : x * static_cast<float>(rng.Uniform(0.5, 1.5));
        }
        FillLanes(next, rng, lanes);
        target.evaluate(next.ray, lanes);
        int at = 0;
        double ratio = 0;
        for (int lane = 0; lane < kStageLanes; ++lane) {
          const double r = Ratio(target.stage, next.ray, lanes, form, lane);
          ASSERT_LE(r, 1.0) << next << ", form " << form << ", lane " << lane;
          if (r > ratio) ratio = r, at = lane;
        }
        if (ratio > best) {
          best = ratio;
          c = next;
          c.a = lanes.corner(0, at);
          c.b = lanes.corner(1, at);
          c.c = lanes.corner(2, at);
        }
      }
      best_of_all = std::max(best_of_all, best);
    }
    std::cout << target.name << ": the climb came to " << best_of_all << " of a bound\n";
    EXPECT_GT(best_of_all, 0.02) << "the hunt is not hunting";
  }
}

// Directions as short as floats go, past triangles as far off as scenes reach: a share of the one
// that underflows is scaled by the other.
TEST(FloatStageTest, BoundsHoldForShortDirectionsPastFarTriangles) {
  for (const Target& target : Targets()) {
    SCOPED_TRACE(target.name);
    TestRng rng;
    StageLanes lanes;
    for (int64_t i = ScaledCount(4'000); i > 0; --i) {
      const auto about = [&rng](int exponent) {
        Vec3f v;
        for (int k = 0; k < 3; ++k) {
          v[k] = static_cast<float>(std::ldexp(rng.Uniform(-1, 1), exponent));
        }
        return v;
      };
      const int far = 20 + static_cast<int>(rng.Below(20));
      const int near = -148 + static_cast<int>(rng.Below(60));
      const PredicateRay ray{about(near), about(near), rng.Chance(0.5)};
      for (int lane = 0; lane < kStageLanes; ++lane) {
        // Two corners that are close to each other, or on either side of the origin.
        const Vec3f a = about(far), beside = about(far - static_cast<int>(rng.Below(24)));
        const Vec3f b = rng.Chance(0.5) ? about(far) : a * -0.5f;
        lanes.SetTriangle(lane, a, b, ClampToRange(a + beside));
      }
      target.evaluate(ray, lanes);
      for (int lane = 0; lane < kStageLanes; ++lane) {
        for (int form = 0; form < (ray.segment ? kForms : kForms - 1); ++form) {
          const float value = lanes.value[form][lane], bound = lanes.bound[form][lane];
          ASSERT_LE(Ratio(target.stage, ray, lanes, form, lane), 1.0)
              << "2^" << far << ", 2^" << near << ", form " << form << ", lane " << lane;
          if (value > bound || value < -bound) {
            ASSERT_EQ(TruthOf(target.stage, ray, lanes, form, lane).sign, value > 0 ? 1 : -1)
                << "2^" << far << ", 2^" << near << ", form " << form << ", lane " << lane;
          }
        }
      }
    }
  }
}

// The largest coordinates there are, and what placing points may make of them: nothing overflows
// among the first, no sign is wrong among the second.
TEST(FloatStageTest, SignsAreRightAtTheCornersOfTheRange) {
  for (const Target& target : Targets()) {
    for (const float most : {0x1p40f, 0x1.8p40f}) {
      SCOPED_TRACE(testing::Message() << target.name << " at " << most);
      StageLanes lanes;
      const auto corner = [&](uint64_t bits) {
        return Vec3f{bits & 1 ? most : -most, bits & 2 ? most : -most, bits & 4 ? most : -most};
      };
      for (uint64_t bits = 0; bits < 8 * 8; ++bits) {
        const Vec3f o = corner(bits), t = corner(bits >> 3);
        for (const bool segment : {true, false}) {
          const PredicateRay ray{o, t, segment};
          for (uint64_t triangles = 0; triangles < 512; triangles += kStageLanes) {
            for (int lane = 0; lane < kStageLanes; ++lane) {
              const uint64_t id = triangles + lane;
              lanes.SetTriangle(lane, corner(id), corner(id >> 3), corner(id >> 6));
            }
            target.evaluate(ray, lanes);
            for (int lane = 0; lane < kStageLanes; ++lane) {
              for (int form = 0; form < (segment ? kForms : kForms - 1); ++form) {
                const float value = lanes.value[form][lane], bound = lanes.bound[form][lane];
                ASSERT_TRUE(std::isfinite(bound) && !std::isnan(value));
                ASSERT_TRUE(std::isfinite(value) || most > 0x1p40f);
                const int sign = value > bound ? 1 : value < -bound ? -1 : 0;
                if (sign != 0) {
                  ASSERT_EQ(sign, TruthOf(target.stage, ray, lanes, form, lane).sign);
                }
              }
            }
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace sightline
#endif  // HWY_ONCE
