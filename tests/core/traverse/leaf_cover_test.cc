// SPDX-License-Identifier: Apache-2.0
//
// What is said to block points together, from the box around them, blocks each of them: triangles
// and pairs that share an edge, of one leaf, for every instruction set of this machine, against
// brute force.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
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

// Quadrangles, flat and bent, in two triangles each, whose corners run either way about; at times
// on a lattice, where much is level and touches.
std::vector<ObjectInput> SomeTriangles(TestRng& rng) {
  ObjectInput object;
  const bool lattice = rng.Chance(0.4);
  const auto place = [&](Vec3d p) {
    if (lattice) {
      for (int k = 0; k < 3; ++k) p[k] = std::round(p[k] * 2) / 2;
    }
    object.vertices.push_back(p);
  };
  const auto triangle = [&](uint32_t a, uint32_t b, uint32_t c) {
    if (rng.Chance(0.5)) std::swap(b, c);
    for (const uint32_t corner : {a, b, c}) object.indices.push_back(corner);
  };
  const size_t quadrangles = 1 + rng.Below(5);
  for (size_t q = 0; q < quadrangles; ++q) {
    const auto first = static_cast<uint32_t>(object.vertices.size());
    const Vec3d corner = Anywhere(rng, 2), along = Anywhere(rng, 2), up = Anywhere(rng, 2);
    const double bend = rng.Chance(0.7) ? 0 : 0.2;
    place(corner);
    place(corner + along);
    place(corner + along + up + Anywhere(rng, bend));
    place(corner + up);
    triangle(first, first + 1, first + 2);
    triangle(first, first + 2, first + 3);
  }
  return {object};
}

class LeafCoverTest : public KernelsFixture {
 protected:
  // How many triangles it took, or 0 where nothing was said.
  int Ask(const IndexedGeometry& scene, bool parallel, const CoverQuestion& question) {
    std::optional<ChildRef> leaf;
    for (uint32_t i = 0; i < scene.bvh.nodes[0].child_count; ++i) {
      const ChildRef child = scene.bvh.nodes[0].child[i];
      if (child.is_leaf()) leaf = child;
    }
    if (!leaf) return 0;
    WalkStats stats;
    const bool covered = (parallel ? kernels().cover_parallel_points : kernels().cover_points)(
        scene, *leaf, question.common, question.common_source, 0xFFFFFFFFu, question.box(),
        question.sources, &stats);
    if (!covered) return 0;
    question.ExpectAllBlocked(kernels(), scene, parallel);
    return static_cast<int>(stats.shaft.relevant);
  }
};

SIGHTLINE_FOR_EACH_TARGET(LeafCoverTest);

TEST_P(LeafCoverTest, WhatIsSaidToBlockAllBlocksEach) {
  TestRng rng;
  int64_t by_one = 0, by_two = 0, asked = 0;
  for (int64_t i = 0, n = ScaledCount(40000, 1000); i < n && !HasFailure(); ++i) {
    const IndexedGeometry scene = IndexObjects(SomeTriangles(rng), Vec3d{});
    if (scene.bvh.empty()) continue;
    const bool parallel = rng.Chance(0.5);
    const auto triangles = static_cast<uint32_t>(scene.geometry.triangles.size());
    // Points behind somewhere on a triangle, or on its edge, in a box of any size.
    const auto [a, b, c] = scene.geometry.Corners(static_cast<uint32_t>(rng.Below(triangles)));
    double u = rng.Uniform(0, 1), v = rng.Chance(0.3) ? 0 : rng.Uniform(0, 1 - u);
    const Vec3d on =
        ToDouble(a) + (ToDouble(b) - ToDouble(a)) * u + (ToDouble(c) - ToDouble(a)) * v;
    const Vec3d light = Anywhere(rng, 6);
    const double behind = rng.Chance(0.2) ? 1 : rng.Uniform(1, 2);
    const Vec3d middle = light + (on - light) * behind;
    const double size = std::exp2(rng.Uniform(-24, 0));
    CoverQuestion question;
    question.common = ToFloat(parallel ? light - on : light);
    question.common_source =
        rng.Chance(0.1) ? static_cast<uint32_t>(rng.Below(triangles)) : kNoTriangle;
    const size_t count = 1 + rng.Below(70);
    const bool level = rng.Chance(0.3);
    for (size_t p = 0; p < count; ++p) {
      Vec3d at = middle + Anywhere(rng, size);
      if (level) at.z = middle.z;
      question.points.push_back(ToFloat(at));
    }
    if (rng.Chance(0.3)) {
      question.sources.assign(count, kNoTriangle);
      question.sources[rng.Below(count)] = static_cast<uint32_t>(rng.Below(triangles + 2));
    }
    ++asked;
    const int took = Ask(scene, parallel, question);
    by_one += took == 1;
    by_two += took == 2;
  }
  EXPECT_GT(by_one, asked / 20);
  EXPECT_GT(by_two, asked / 200);
  EXPECT_LT(by_one + by_two, asked * 9 / 10);
}

// The wall before a light is never its own point's blocker, and masks and culling are asked
// elsewhere.
TEST_P(LeafCoverTest, SourcesAndObjectsKeepTheirSay) {
  const ObjectInput wall = {.vertices = {{-8, -8, 1}, {8, -8, 1}, {0, 8, 1}}, .indices = {0, 1, 2}};
  CoverQuestion question = {.common = {0, 0, 4}, .points = {{0, 0, 0}, {0.5f, 0.25f, 0}}};
  const IndexedGeometry scene = IndexObjects({wall}, Vec3d{});
  EXPECT_EQ(Ask(scene, false, question), 1);
  question.common = {0, 0, 1};
  EXPECT_EQ(Ask(scene, true, question), 1);
  question.sources = {kNoTriangle, 0};
  EXPECT_EQ(Ask(scene, true, question), 0);
  question.sources = {};
  question.common_source = 0;
  EXPECT_EQ(Ask(scene, true, question), 0);
  question.common_source = kNoTriangle;
  ObjectInput masked = wall;
  masked.mask = 2;
  ObjectInput culled = wall;
  culled.culling = Culling::kBack;
  EXPECT_EQ(Ask(IndexObjects({masked}, Vec3d{}), true, question), 0);
  EXPECT_EQ(Ask(IndexObjects({culled}, Vec3d{}), true, question), 0);
  question.points = {};
  EXPECT_EQ(Ask(scene, true, question), 0);
}

}  // namespace
}  // namespace sightline::testing_support
