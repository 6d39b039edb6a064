// SPDX-License-Identifier: Apache-2.0
#include "core/traverse/gradual_fetch.h"

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/geometry/vec3.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"

namespace sightline::testing_support {
namespace {

// How often Some() has to be called.
size_t Steps(GradualFetch fetch) {
  size_t steps = 0;
  for (; !fetch.done(); ++steps) fetch.Some();
  return steps;
}

// As many points a step, up to the one that is named, or the last.
TEST(GradualFetchTest, AsksForPointsUpToOne) {
  constexpr size_t kStep = GradualFetch::kPointsAtOnce;
  const std::vector<Vec3f> positions(10 * kStep);
  const std::vector<uint32_t> sources(positions.size());
  const std::vector<uint8_t> valid(positions.size());
  GradualFetch none;
  none.Until(100);
  EXPECT_TRUE(none.done());
  EXPECT_TRUE(none.empty());
  none.Some();
  EXPECT_EQ(none.at(), 0u);
  for (const bool all : {false, true}) {
    using Sources = std::span<const uint32_t>;
    using Valid = std::span<const uint8_t>;
    GradualFetch fetch(positions, all ? Sources(sources) : Sources(), all ? Valid(valid) : Valid());
    EXPECT_TRUE(fetch.done());
    EXPECT_FALSE(fetch.empty());
    fetch.Until(1);
    EXPECT_EQ(Steps(fetch), 1u);
    fetch.Until(2 * kStep);
    EXPECT_EQ(Steps(fetch), 2u);
    fetch.Until(2 * kStep + 1);
    EXPECT_EQ(Steps(fetch), 3u);
    fetch.Some();
    EXPECT_EQ(Steps(fetch), 2u);
    EXPECT_EQ(fetch.at(), reinterpret_cast<uintptr_t>(&positions[kStep]));
    fetch.Until(1);
    EXPECT_TRUE(fetch.done());
    fetch.Until(100 * kStep);
    EXPECT_EQ(Steps(fetch), 9u);
    while (!fetch.done()) fetch.Some();
    EXPECT_EQ(fetch.at(), reinterpret_cast<uintptr_t>(positions.data() + positions.size()));
  }
}

// What is left to the caller is not asked for again, and is not handed out where it is not whole.
TEST(GradualFetchTest, LeavesPointsToTheCaller) {
  constexpr size_t kStep = GradualFetch::kPointsAtOnce;
  const std::vector<Vec3f> positions(10 * kStep);
  const std::vector<uint32_t> sources(positions.size());
  const std::vector<uint8_t> valid(positions.size());
  EXPECT_EQ(GradualFetch().Take(1), nullptr);
  GradualFetch fetch(positions, sources, valid);
  EXPECT_EQ(fetch.Take(1), nullptr);
  fetch.Until(4 * kStep);
  EXPECT_EQ(fetch.Take(4 * kStep + 1), nullptr);
  EXPECT_EQ(fetch.Take(kStep + 5), positions.data());
  EXPECT_EQ(fetch.at(), reinterpret_cast<uintptr_t>(&positions[kStep + 5]));
  EXPECT_EQ(fetch.Take(3 * kStep), nullptr);
  fetch.Some();
  EXPECT_EQ(fetch.Take(2 * kStep - 5), &positions[2 * kStep + 5]);
  EXPECT_TRUE(fetch.done());
  EXPECT_EQ(fetch.Take(1), nullptr);
}

// From where another was, if that is one of these points, not too far on, or just behind them.
TEST(GradualFetchTest, GoesOnWhereAnotherWas) {
  const std::vector<Vec3f> positions(3 * GradualFetch::kPointsAtOnce);
  const auto address = [&](size_t i) { return reinterpret_cast<uintptr_t>(positions.data() + i); };
  const auto resumed = [&](uintptr_t at, size_t most = 1000) {
    GradualFetch fetch(std::span<const Vec3f>(positions).subspan(7), {}, {});
    fetch.Resume(at, most);
    return fetch.at();
  };
  EXPECT_EQ(resumed(address(9)), address(9));
  EXPECT_EQ(resumed(address(positions.size())), address(positions.size()));
  EXPECT_EQ(resumed(address(6)), address(7));
  EXPECT_EQ(resumed(address(positions.size()) + sizeof(Vec3f)), address(7));
  EXPECT_EQ(resumed(0), address(7));
  EXPECT_EQ(resumed(address(27), 20), address(27));
  EXPECT_EQ(resumed(address(28), 20), address(7));
}

class WalkThatFetchesTest : public KernelsFixture {};
SIGHTLINE_FOR_EACH_TARGET(WalkThatFetchesTest);

// Segments and parallel rays over random triangles, with something to fetch and without.
TEST_P(WalkThatFetchesTest, AnswersAsOneThatDoesNot) {
  TestRng rng;
  ObjectInput object;
  for (uint32_t i = 0; i < 3 * 200; ++i) {
    object.indices.push_back(i);
    object.vertices.push_back({rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-0.1, 0.1)});
    // Small ones, so that some rays pass.
    const size_t first = i / 3 * 3;
    object.vertices[i] =
        object.vertices[first] + (object.vertices[i] - object.vertices[first]) * 0.1;
  }
  const IndexedGeometry scene = IndexObjects({object}, Vec3d{}, 4);
  const auto segments = std::make_unique<RayPacket>();
  const auto rays = std::make_unique<ParallelPacket>();
  segments->origin = {0, 0, 4};
  rays->direction = {0, 0, 1};
  segments->count = rays->count = RayPacket::kMaxRays;
  for (int lane = 0; lane < RayPacket::kMaxRays; ++lane) {
    const Vec3f p = {static_cast<float>(rng.Uniform(-1, 1)), static_cast<float>(rng.Uniform(-1, 1)),
                     -0.5f};
    segments->target_x[lane] = rays->origin_x[lane] = p.x;
    segments->target_y[lane] = rays->origin_y[lane] = p.y;
    segments->target_z[lane] = rays->origin_z[lane] = p.z;
    segments->target_source[lane] = rays->origin_source[lane] = kNoTriangle;
  }
  const std::vector<Vec3f> coming(1 << 16);
  const auto check = [&](auto& packet, const auto& trace) {
    packet.first_leaf = RayPacket::kNoLeaf;
    trace();
    const std::vector<uint32_t> without(packet.triangle, packet.triangle + packet.count);
    GradualFetch fetch(coming, {}, {});
    fetch.Until(coming.size());
    const size_t before = Steps(fetch);
    packet.first_leaf = RayPacket::kNoLeaf;
    packet.meanwhile = &fetch;
    trace();
    packet.meanwhile = nullptr;
    EXPECT_LT(Steps(fetch), before);
    int lit = 0;
    for (int lane = 0; lane < packet.count; ++lane) {
      ASSERT_EQ(packet.triangle[lane] == kNoTriangle, without[lane] == kNoTriangle);
      lit += without[lane] == kNoTriangle ? 1 : 0;
    }
    EXPECT_GT(lit, packet.count / 10);
    EXPECT_LT(lit, packet.count - packet.count / 10);
  };
  WalkStats stats;
  check(*segments,
        [&] { ASSERT_TRUE(kernels().occluded_shaft(scene, *segments, nullptr, nullptr, &stats)); });
  check(*rays, [&] {
    ASSERT_TRUE(kernels().occluded_parallel_shaft(scene, *rays, nullptr, nullptr, &stats));
  });
}

}  // namespace
}  // namespace sightline::testing_support
