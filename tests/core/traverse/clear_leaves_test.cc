// SPDX-License-Identifier: Apache-2.0
//
// What leaves are said to be clear of is not blocked by any of their triangles, by the definition:
// for segments and rays that graze what points lie on, for every instruction set of this machine.
// And a surface is clear of what lies on it.
#include "core/traverse/clear_leaves.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/intersect/predicate.h"
#include "core/traverse/kernels.h"
#include "core/traverse/leaf_view.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr size_t kWords = PointGrounds::kMaxPoints / 16;

// Points near one another, mostly just above what is there: of triangles whose numbers follow, a
// block's of one or a few.
void PlacePoints(const SceneGeometry& geometry, NastyRays& rays, TestRng& rng,
                 PointGrounds* grounds) {
  grounds->count = 1 + static_cast<int>(rng.Below(PointGrounds::kMaxPoints));
  const size_t triangles = geometry.triangles.size();
  const uint64_t around = triangles == 0 ? 0 : rng.Below(triangles);
  const uint64_t few = uint64_t{1} << rng.Below(4);
  for (int i = 0; i < grounds->count; ++i) {
    Vec3f p = rays.Point();
    if (triangles > 0 && !rng.Chance(0.03)) {
      const auto id = static_cast<uint32_t>(
          (around + static_cast<uint64_t>(i) / 16 + rng.Below(few)) % triangles);
      const auto [a, b, c] = geometry.Corners(id);
      double v = rng.Uniform(0, 1), w = rng.Uniform(0, 1 - v);
      if (rng.Chance(0.2)) v = std::ldexp(v, -20);
      const Vec3d ad = ToDouble(a), ab = ToDouble(b) - ad, ac = ToDouble(c) - ad;
      const Vec3d normal = Cross(ab, ac);
      const double size = Length(normal);
      Vec3d at = ad + ab * v + ac * w;
      if (size > 0) {
        const double height = std::ldexp(std::sqrt(size), -6 - static_cast<int>(rng.Below(20)));
        at = at + normal * ((rng.Chance(0.1) ? -1 : 1) * height / size);
      }
      p = ToFloat(at);
    }
    if (!IsFinite(p)) p = {0, 0, 0};
    grounds->x[i] = p.x;
    grounds->y[i] = p.y;
    grounds->z[i] = p.z;
  }
}

class ClearLeavesTest : public KernelsFixture {
 protected:
  // What was said to be clear: pairs of a point and a leaf, and those in which the leaf's plane was
  // tilted, points were told to be on one side of a triangle, or asked about by themselves.
  struct Said {
    size_t pairs = 0, tilted = 0, sides = 0, own = 0;
  };

  // Puts to every triangle of a leaf all points that it is said to be clear of toward one light.
  void Check(const IndexedGeometry& scene, const PointGrounds& grounds, const ClearLeaves& clear,
             bool parallel, Vec3f common, Said* said) {
    uint16_t dark[kWords];
    alignas(64) float rises[kWords];
    (parallel ? kernels().parallel_ground_bits : kernels().ground_bits)(grounds, common, dark,
                                                                        rises);
    const auto toward = std::make_unique<ClearToward>();
    (parallel ? kernels().choose_parallel_clear : kernels().choose_clear)(clear, common, rises,
                                                                          toward.get());
    EXPECT_LE(toward->count, clear.count);
    for (uint32_t k = 0; k < toward->count; ++k) {
      const ClearLeaves::Leaf& own =
          clear.leaves[std::find(clear.leaf, clear.leaf + clear.count, toward->leaf[k]) -
                       clear.leaf];
      const LeafView leaf(scene, ChildRef::FromBits(toward->leaf[k]));
      for (int i = 0; i < grounds.count; ++i) {
        if ((toward->blocks[k] >> (i / 16) & 1) == 0 || (dark[i / 16] >> (i % 16) & 1) != 0) {
          continue;
        }
        const int b = i / 16;
        ++said->pairs;
        said->tilted += own.plane_x[b] != clear.up_x[b] || own.plane_y[b] != clear.up_y[b] ? 1 : 0;
        said->sides += own.before[b] != 0 || own.behind[b] != 0 ? 1 : 0;
        said->own += own.own_tilt[b] > 0 ? 1 : 0;
        const Vec3f p = grounds.point(i);
        const PredicateRay ray =
            parallel ? PredicateRay::Ray(p, common) : PredicateRay::Segment(common, p);
        for (uint32_t t = 0; t < leaf.count; ++t) {
          EXPECT_FALSE(Blocks(ray, leaf.corner(0, t), leaf.corner(1, t), leaf.corner(2, t)))
              << "triangle " << leaf.id(t) << ", " << Printed{TraceRay{.ray = ray}};
        }
      }
    }
  }
};
SIGHTLINE_FOR_EACH_TARGET(ClearLeavesTest);

TEST_P(ClearLeavesTest, NothingOfThemBlocksWhatTheyAreClearOf) {
  TestRng rng;
  Said said;
  for (int64_t round = 0, n = ScaledCount(6, 3); round < n; ++round) {
    for (const NastyScene& scene : MakeNastyScenes(rng)) {
      SCOPED_TRACE(scene.name);
      if (!scene.indexed.geometry.uniform) continue;
      NastyRays rays(scene.indexed, rng);
      const auto grounds = std::make_unique<PointGrounds>();
      const auto clear = std::make_unique<ClearLeaves>();
      PlacePoints(scene.indexed.geometry, rays, rng, grounds.get());
      WalkStats stats;
      kernels().find_grounds(scene.indexed, nullptr, grounds.get(), clear.get(), &stats);
      for (int ask = 0; ask < 24 && clear->count > 0; ++ask) {
        // Along the surface beneath some point, or a plane of some leaf and its block, or one of
        // its triangles, a little up or down from it; or anywhere.
        const bool parallel = rng.Chance(0.5);
        const int some = static_cast<int>(rng.Below(static_cast<uint64_t>(grounds->count)));
        Vec3d up = ToDouble(grounds->normal(some));
        const ClearLeaves::Leaf& leaf = clear->leaves[rng.Below(clear->count)];
        if (rng.Chance(0.5)) {
          const int b = some / 16;
          up = {leaf.plane_x[b], leaf.plane_y[b], leaf.plane_z[b]};
        } else if (rng.Chance(0.3)) {
          const uint64_t t = rng.Below(4);
          up = {leaf.normal_x[t], leaf.normal_y[t], leaf.normal_z[t]};
        }
        Vec3d along;
        for (int k = 0; k < 3; ++k) along[k] = rng.Uniform(-1, 1);
        along = along - up * Dot(along, up);
        Vec3d lead =
            along + up * std::ldexp(rng.Uniform(-0.1, 1), -static_cast<int>(rng.Below(24)));
        lead = lead * std::ldexp(1, static_cast<int>(rng.Below(16)) - 8);
        Vec3f common = ToFloat(parallel ? lead : ToDouble(grounds->point(some)) + lead);
        if (rng.Chance(0.2)) common = parallel ? rays.Target({0, 0, 0}, false) : rays.Point();
        Check(scene.indexed, *grounds, *clear, parallel, common, &said);
      }
      if (HasFailure()) return;
    }
  }
  EXPECT_GT(said.pairs, 10000u);
  EXPECT_GT(said.tilted, 1000u);
  EXPECT_GT(said.sides, 100u);
  EXPECT_GT(said.own, 100u);
}

// Of gentle hills each block sees what leads up steeply, and nothing that leads down.
TEST_P(ClearLeavesTest, ASurfaceIsClearOfWhatLiesOnIt) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeGrid(32, 0.05, {0, 0, 0}, rng)}, std::nullopt);
  const auto grounds = std::make_unique<PointGrounds>();
  grounds->count = PointGrounds::kMaxPoints;
  for (int i = 0; i < grounds->count; ++i) {
    // Above the middle of triangles of the middle, by rows of sixteen.
    const auto id = static_cast<uint32_t>(2 * (32 * (8 + i / 32) + i % 32));
    const auto [a, b, c] = scene.geometry.Corners(id);
    const Vec3d ad = ToDouble(a), bd = ToDouble(b), cd = ToDouble(c);
    Vec3d normal = Cross(bd - ad, cd - ad);
    if (normal.y < 0) normal = normal * -1.0;
    const Vec3f p = ToFloat((ad + bd + cd) * (1.0 / 3) + normal * (1e-5 / Length(normal)));
    grounds->x[i] = p.x;
    grounds->y[i] = p.y;
    grounds->z[i] = p.z;
  }
  const auto clear = std::make_unique<ClearLeaves>();
  WalkStats stats;
  ASSERT_EQ(kernels().find_grounds(scene, nullptr, grounds.get(), clear.get(), &stats), 256u);
  ASSERT_GT(clear->count, 0u);
  const auto cleared = [&](bool parallel, Vec3f common) {
    uint16_t dark[kWords];
    alignas(64) float rises[kWords];
    const auto toward = std::make_unique<ClearToward>();
    (parallel ? kernels().parallel_ground_bits : kernels().ground_bits)(*grounds, common, dark,
                                                                        rises);
    (parallel ? kernels().choose_parallel_clear : kernels().choose_clear)(*clear, common, rises,
                                                                          toward.get());
    size_t blocks = 0;
    for (uint32_t k = 0; k < toward->count; ++k) {
      blocks += static_cast<size_t>(std::popcount(toward->blocks[k]));
    }
    return blocks;
  };
  EXPECT_GT(cleared(true, {0.1f, 1, 0.1f}), size_t{8} * clear->count);
  EXPECT_GT(cleared(false, {16, 1000, 16}), size_t{8} * clear->count);
  EXPECT_EQ(cleared(true, {0.3f, 0.01f, 0.1f}), cleared(true, {3, 0.1f, 1}));
}

// A wall beside the last of some points on a floor, so small that the square of its normal is no
// normal number: how long that is is not known well enough to say on which side a light is.
TEST_P(ClearLeavesTest, WallsWhoseNormalsUnderflowHideNothingUnseen) {
  TestRng rng;
  Said said;
  for (int k = 18; k <= 44; ++k) {
    const double s = std::ldexp(1, -k), most = 10 * s;
    ObjectInput floor, wall;
    floor.vertices = {{-32 * s, 0, -20 * s}, {0, 0, 43 * s}, {32 * s, 0, -20 * s}};
    floor.indices = {0, 1, 2};
    const double x = most - 0.15 * s;
    wall.vertices = {{x, 0, -s / 2}, {x, 0, s / 2}, {x, 0.848 * s, 0}};
    wall.indices = {0, 1, 2};
    const IndexedGeometry scene = IndexObjects({floor, wall}, Vec3d{});
    ASSERT_EQ(scene.geometry.triangles.size(), 2u);
    const auto grounds = std::make_unique<PointGrounds>();
    grounds->count = PointGrounds::kMaxPoints;
    for (int i = 0; i < grounds->count; ++i) {
      const bool last = i >= grounds->count - 16;
      const double at = last ? most - 0.1 * s * (grounds->count - 1 - i) / 15
                             : -most + 2 * most * i / grounds->count;
      grounds->x[i] = static_cast<float>(at);
      grounds->y[i] = static_cast<float>(0.01 * s);
      grounds->z[i] = 0;
    }
    const auto clear = std::make_unique<ClearLeaves>();
    WalkStats stats;
    kernels().find_grounds(scene, nullptr, grounds.get(), clear.get(), &stats);
    if (k == 18) {
      ASSERT_GT(clear->count, 0u);
    }
    if (clear->count == 0) continue;
    for (int ask = 0; ask < 200; ++ask) {
      const double from = ask == 0 ? 0.9 : rng.Uniform(0.5, 1.1);
      const Vec3d light = {from * most, s * (ask == 0 ? 0.5 : rng.Uniform(0.01, 1)),
                           ask == 0 ? 0 : 0.1 * s * rng.Uniform(-1, 1)};
      Check(scene, *grounds, *clear, /*parallel=*/false, ToFloat(light), &said);
      ASSERT_FALSE(HasFailure()) << "s = 2^-" << k;
    }
  }
  EXPECT_GT(said.sides, 100u);
}

}  // namespace
}  // namespace sightline::testing_support
