// SPDX-License-Identifier: Apache-2.0
//
// Points that a patch of triangles is said to hide are blocked, each of them, by brute force, for
// every instruction set of this machine: behind surfaces that are whole, torn, folded, turned or in
// several layers.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/cover_question.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

// Every triangle with vertices of its own.
void Unweld(ObjectInput* object) {
  std::vector<Vec3d> vertices;
  for (uint32_t& index : object->indices) {
    vertices.push_back(object->vertices[index]);
    index = static_cast<uint32_t>(vertices.size() - 1);
  }
  object->vertices = vertices;
}

// A surface, and at times what is wrong with it.
ObjectInput SomeSurface(TestRng& rng) {
  ObjectInput object;
  switch (rng.Below(4)) {
    case 0:
      object = MakeClosedSphere(static_cast<int>(4 + rng.Below(10)),
                                static_cast<int>(4 + rng.Below(14)), 1, Anywhere(rng, 0.2));
      break;
    case 1:
      object = MakeClosedBox(static_cast<int>(1 + rng.Below(6)), {-1, -1, -1}, {1, 1, 1});
      break;
    default:
      object = MakeGrid(static_cast<int>(2 + rng.Below(14)), rng.Chance(0.3) ? 0 : 0.1,
                        {-0.5, 0, -0.5}, rng);
      break;
  }
  const size_t triangles = object.indices.size() / 3;
  if (rng.Chance(0.3)) {  // Folds.
    for (uint64_t i = 0, n = rng.Below(4); i < n; ++i) {
      Vec3d& vertex = object.vertices[rng.Below(object.vertices.size())];
      vertex = vertex + Anywhere(rng, 0.5);
    }
  }
  if (rng.Chance(0.3)) {  // Corners that run the other way about.
    for (size_t t = 0; t < triangles; ++t) {
      if (rng.Chance(0.3)) std::swap(object.indices[3 * t], object.indices[3 * t + 1]);
    }
  }
  if (rng.Chance(0.2)) {  // Three at an edge.
    for (const Vec3d p : {Anywhere(rng, 1), Anywhere(rng, 1)}) {
      const size_t t = rng.Below(triangles);
      const auto apex = static_cast<uint32_t>(object.vertices.size());
      object.vertices.push_back(p);
      object.indices.insert(object.indices.end(),
                            {object.indices[3 * t], object.indices[3 * t + 1], apex});
    }
  }
  if (rng.Chance(0.3)) {  // A hole.
    const size_t t = rng.Below(triangles);
    object.indices.erase(object.indices.begin() + static_cast<ptrdiff_t>(3 * t),
                         object.indices.begin() + static_cast<ptrdiff_t>(3 * t + 3));
  }
  if (rng.Chance(0.3)) Unweld(&object);
  return object;
}

class PatchCoverTest : public KernelsFixture {
 protected:
  std::vector<uint32_t> Leaves(const IndexedGeometry& scene) {
    std::vector<uint32_t> leaves;
    for (const BvhNode& node : scene.bvh.nodes) {
      for (uint32_t slot = 0; slot < node.child_count; ++slot) {
        if (node.child[slot].is_leaf()) leaves.push_back(node.child[slot].bits());
      }
    }
    return leaves;
  }

  // How many triangles it took, or 0 where nothing was said.
  uint32_t Ask(const IndexedGeometry& scene, bool parallel, const CoverQuestion& question,
               const std::vector<uint32_t>& seeds) {
    WalkStats stats;
    uint32_t leaf = RayPacket::kNoLeaf;
    const uint32_t count =
        (parallel ? kernels().cover_parallel_by_patch : kernels().cover_by_patch)(
            scene, question.common, question.common_source, 0xFFFFFFFFu, question.box(),
            question.points, question.sources, seeds, &leaf, &stats);
    EXPECT_EQ(leaf != RayPacket::kNoLeaf, count > 0);
    EXPECT_EQ(stats.shaft.relevant, count);
    if (count == 0) return 0;
    EXPECT_TRUE(scene.bvh.HoldsLeaf(ChildRef::FromBits(leaf)));
    question.ExpectAllBlocked(kernels(), scene, parallel);
    return count;
  }
};

SIGHTLINE_FOR_EACH_TARGET(PatchCoverTest);

TEST_P(PatchCoverTest, WhatIsSaidToHideAllHidesEach) {
  TestRng rng;
  int64_t asked = 0, one = 0, some = 0, many = 0;
  for (int64_t i = 0, n = ScaledCount(4000, 300); i < n && !HasFailure(); ++i) {
    std::vector<ObjectInput> objects = {SomeSurface(rng)};
    if (rng.Chance(0.3)) objects.push_back(SomeSurface(rng));
    for (size_t k = 0; k < objects.size(); ++k) objects[k].name = std::string(k + 1, 'a');
    const IndexedGeometry scene =
        IndexObjects(objects, Vec3d{}, static_cast<int>(1 + rng.Below(16)));
    const std::vector<uint32_t> leaves = Leaves(scene);
    if (leaves.empty()) continue;
    for (int j = 0; j < 20; ++j) {
      const bool parallel = rng.Chance(0.5);
      const auto triangles = static_cast<uint32_t>(scene.geometry.triangles.size());
      // Points behind somewhere on a triangle, on its edge or at its corner, in a box of any size.
      const auto [a, b, c] = scene.geometry.Corners(static_cast<uint32_t>(rng.Below(triangles)));
      const double u = rng.Chance(0.2) ? 0 : rng.Uniform(0, 1);
      const double v = rng.Chance(0.2) ? 0 : rng.Uniform(0, 1 - u);
      const Vec3d on =
          ToDouble(a) + (ToDouble(b) - ToDouble(a)) * u + (ToDouble(c) - ToDouble(a)) * v;
      Vec3d light = on + Anywhere(rng, 4);
      if (rng.Chance(0.05)) {  // In its plane, as nearly as can be.
        light = on + (ToDouble(b) - ToDouble(a)) * rng.Uniform(-3, 3) +
                (ToDouble(c) - ToDouble(a)) * rng.Uniform(-3, 3);
      }
      const Vec3d middle = light + (on - light) * rng.Uniform(1, 2);
      const double size = std::exp2(rng.Uniform(-8, 0));
      CoverQuestion question;
      question.common = ToFloat(parallel ? light - on : light);
      if (rng.Chance(0.05)) question.common_source = static_cast<uint32_t>(rng.Below(triangles));
      const size_t count = 1 + rng.Below(70);
      const bool level = rng.Chance(0.3);
      for (size_t p = 0; p < count; ++p) {
        Vec3d at = middle + Anywhere(rng, size);
        if (level) at.y = middle.y;
        // Some straight behind a vertex or an edge's middle, to the last bit that can be had.
        if (rng.Chance(0.1)) {
          const Vec3d vertex = ToDouble(rng.Chance(0.5) ? a : b);
          const Vec3d through = rng.Chance(0.5) ? vertex : (vertex + ToDouble(c)) * 0.5;
          const Vec3d way = parallel ? ToDouble(question.common) * -1.0 : through - light;
          at = through + way * rng.Uniform(0, 1);
        }
        question.points.push_back(ToFloat(at));
      }
      if (rng.Chance(0.1)) {
        question.sources.assign(count, kNoTriangle);
        question.sources[rng.Below(count)] = static_cast<uint32_t>(rng.Below(triangles + 2));
      }
      std::vector<uint32_t> seeds(1 + rng.Below(4), RayPacket::kNoLeaf);
      for (uint32_t& seed : seeds) {
        if (rng.Chance(0.8)) seed = leaves[rng.Below(leaves.size())];
      }
      ++asked;
      const uint32_t took = Ask(scene, parallel, question, seeds);
      one += took == 1 ? 1 : 0;
      some += took > 1 && took <= 8 ? 1 : 0;
      many += took > 8 ? 1 : 0;
    }
  }
  EXPECT_GT(one, asked / 40);
  EXPECT_GT(some, asked / 40);
  EXPECT_GT(many, asked / 200);
  EXPECT_LT(one + some + many, asked * 9 / 10);
}

// A level wall between a light and points that lie on it: the least that a float can be beyond its
// plane is enough, and on it, or before it, is not.
TEST_P(PatchCoverTest, PointsOnTheFarSideOfALevelWall) {
  TestRng rng;
  const IndexedGeometry scene = IndexObjects({MakeGrid(6, 0, {-3, 0.3, -3}, rng)}, Vec3d{});
  const std::vector<uint32_t> leaves = Leaves(scene);
  const float wall = scene.geometry.Corners(0)[0].y;
  for (const bool parallel : {false, true}) {
    CoverQuestion question = {.common = {0.2f, parallel ? 3.0f : wall + 3, -0.1f}};
    const auto put = [&](float height) {
      question.points.clear();
      for (int i = 0; i < 40; ++i) {
        question.points.push_back({static_cast<float>(rng.Uniform(-1, 1)), height,
                                   static_cast<float>(rng.Uniform(-1, 1))});
      }
      return Ask(scene, parallel, question, leaves);
    };
    EXPECT_GT(put(std::nextafter(wall, -1.0f)), 2u);
    EXPECT_GT(put(wall - 0.5f), 2u);
    EXPECT_EQ(put(wall), 0u);
    EXPECT_EQ(put(std::nextafter(wall, 1.0f)), 0u);
    // One point before it is enough.
    put(wall - 0.5f);
    question.points[rng.Below(40)].y = wall;
    EXPECT_EQ(Ask(scene, parallel, question, leaves), 0u);
  }
}

// Points are asked one by one where their box reaches over a slanted wall's plane.
TEST_P(PatchCoverTest, PointsOnTheFarSideOfASlantedWall) {
  ObjectInput wall = {.vertices = {{-8, -8, -8}, {8, -8, 0}, {8, 8, 8}, {-8, 8, 0}},
                      .indices = {0, 1, 2, 0, 2, 3}};
  const IndexedGeometry scene = IndexObjects({wall}, Vec3d{});
  const std::vector<uint32_t> leaves = Leaves(scene);
  CoverQuestion question = {.common = {0, 0, 20}};
  TestRng rng;
  for (int i = 0; i < 37; ++i) {
    const double x = rng.Uniform(-2, 2), y = rng.Uniform(-2, 2);
    question.points.push_back(ToFloat(Vec3d{x, y, (x + y) / 2 - 1e-5}));
  }
  EXPECT_GT(Ask(scene, false, question, leaves), 0u);
  question.points[rng.Below(37)].z += 1e-3f;
  EXPECT_EQ(Ask(scene, false, question, leaves), 0u);
}

TEST_P(PatchCoverTest, SourcesAndObjectsKeepTheirSay) {
  TestRng rng;
  const ObjectInput roof = MakeGrid(4, 0, {-2, 1, -2}, rng);
  CoverQuestion question = {.common = {0, 4, 0},
                            .points = {{-0.6f, 0, -0.55f}, {0.8f, 0.25f, 0.6f}}};
  const IndexedGeometry scene = IndexObjects({roof}, Vec3d{});
  const std::vector<uint32_t> leaves = Leaves(scene);
  for (const bool parallel : {false, true}) {
    const uint32_t all = Ask(scene, parallel, question, leaves);
    EXPECT_GT(all, 2u);
    EXPECT_EQ(Ask(scene, parallel, question, {RayPacket::kNoLeaf}), 0u);
    // Of 32 triangles those that it takes are nobody's own.
    uint32_t taken = 0;
    for (uint32_t id = 0; id < 32; ++id) {
      question.sources = {kNoTriangle, id};
      const bool by_source = Ask(scene, parallel, question, leaves) == 0;
      question.sources = {};
      question.common_source = id;
      EXPECT_EQ(Ask(scene, parallel, question, leaves) == 0, by_source);
      question.common_source = kNoTriangle;
      taken += by_source ? 1 : 0;
    }
    EXPECT_EQ(taken, all);
    ObjectInput masked = roof, culled = roof;
    masked.mask = 2;
    culled.culling = Culling::kBack;
    EXPECT_EQ(Ask(IndexObjects({masked}, Vec3d{}), parallel, question, leaves), 0u);
    EXPECT_EQ(Ask(IndexObjects({culled}, Vec3d{}), parallel, question, leaves), 0u);
    IndexedGeometry without = IndexObjects({roof}, Vec3d{});
    without.bvh.mates = {};
    EXPECT_EQ(Ask(without, parallel, question, leaves), 0u);
  }
  question.points = {};
  EXPECT_EQ(Ask(scene, true, question, leaves), 0u);
}

}  // namespace
}  // namespace sightline::testing_support
