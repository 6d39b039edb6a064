// SPDX-License-Identifier: Apache-2.0
//
// Segments in the world and in their stored form are one and the same.
#include "core/query/segments.h"

#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <vector>

#include "core/mesh/rebase.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr Vec3d kOrigin = {447'422.999, -5'411'932.5, 0.1};

IndexedGeometry Scene() {
  return IndexObjects({MakeClosedSphere(8, 12, 0.4, kOrigin + Vec3d{0, 0, 0.5})}, kOrigin);
}

// Bit for bit, -0 apart from +0.
template <typename T>
bool SameBits(const std::vector<T>& a, const std::vector<T>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0;
}

void ExpectSame(const PreparedSegments& a, const PreparedSegments& b) {
  EXPECT_TRUE(SameBits(a.from, b.from));
  EXPECT_TRUE(SameBits(a.to, b.to));
  EXPECT_EQ(a.from_source, b.from_source);
  EXPECT_EQ(a.to_source, b.to_source);
  EXPECT_EQ(a.valid, b.valid);
  EXPECT_EQ(a.invalid, b.invalid);
}

// What Rebase makes of the ends is what the stored form holds, the invalid ones among them.
TEST(SegmentsTest, StoredEndsAreWhatTheWorldsBecome) {
  TestRng rng;
  const IndexedGeometry scene = Scene();
  const double awkward[] = {kNaN, std::numeric_limits<double>::infinity(), 2 * kMaxCoordinate,
                            -kMaxCoordinate, std::nextafter(kMaxCoordinate, 1e30)};
  std::vector<std::array<Vec3d, 2>> world(3000);
  std::vector<std::array<Vec3f, 2>> stored(world.size());
  for (size_t i = 0; i < world.size(); ++i) {
    bool valid = true;
    for (size_t end = 0; end < 2; ++end) {
      Vec3d& p = world[i][end];
      for (int axis = 0; axis < 3; ++axis) {
        p[axis] = rng.Chance(0.02)  ? awkward[rng.Below(5)]
                  : rng.Chance(0.1) ? kOrigin[axis]
                                    : kOrigin[axis] + rng.Uniform(-1, 1);
      }
      valid &= Rebase(p, kOrigin, &stored[i][end]);
      for (int axis = 0; axis < 3; ++axis) {
        if (stored[i][end][axis] == 0 && rng.Chance(0.5)) stored[i][end][axis] = -0.0f;
      }
    }
    if (!valid) stored[i][rng.Below(2)].y = static_cast<float>(kNaN);
  }
  PreparedSegments of_world, of_stored;
  ASSERT_TRUE(PrepareSegments(scene, world, {}, {}, &of_world).ok());
  ASSERT_TRUE(PrepareStoredSegments(scene, stored, {}, {}, &of_stored).ok());
  EXPECT_GT(of_world.invalid, 100u);
  EXPECT_LT(of_world.invalid, 1000u);
  ExpectSame(of_world, of_stored);
  for (const Vec3f& end : of_stored.from) {
    for (int axis = 0; axis < 3; ++axis) EXPECT_FALSE(end[axis] == 0 && std::signbit(end[axis]));
  }
  SegmentResult a, b;
  ASSERT_TRUE(TestSegments(scene, of_world, {.bits = true, .first_hits = true}, {}, &a).ok());
  ASSERT_TRUE(TestSegments(scene, of_stored, {.bits = true, .first_hits = true}, {}, &b).ok());
  EXPECT_EQ(a.blocked_bits, b.blocked_bits);
  EXPECT_EQ(a.triangle, b.triangle);
}

// The bound holds for stored values as for those of the world: 2^40 is one, what follows is not.
TEST(SegmentsTest, StoredEndsBeyondTheBoundAreInvalid) {
  const auto most = static_cast<float>(kMaxCoordinate);
  const float more = std::nextafter(most, std::numeric_limits<float>::infinity());
  const std::vector<std::array<Vec3f, 2>> ends = {
      {{{most, -most, most}, {0, 0, 0}}},
      {{{0, 0, 0}, {0, more, 0}}},
      {{{-more, 0, 0}, {0, 0, 0}}},
      {{{0, 0, 0}, {0, 0, std::numeric_limits<float>::infinity()}}},
      {{{0, static_cast<float>(kNaN), 0}, {0, 0, 0}}},
      {{{1, 2, 3}, {1, 2, 3}}}};
  PreparedSegments prepared;
  ASSERT_TRUE(PrepareStoredSegments(Scene(), ends, {}, {}, &prepared).ok());
  EXPECT_EQ(prepared.valid, (std::vector<uint8_t>{1, 0, 0, 0, 0, 1}));
  EXPECT_EQ(prepared.invalid, 4u);
  for (size_t i = 1; i < 5; ++i) {
    EXPECT_EQ(prepared.from[i], Vec3f{});
    EXPECT_EQ(prepared.to[i], Vec3f{});
  }
}

// What was prepared before leaves nothing behind, sources neither.
TEST(SegmentsTest, MemoryIsUsedAgainAndNothingElse) {
  const IndexedGeometry scene = Scene();
  const std::vector<std::array<Vec3d, 2>> many(5, {{{kNaN, 0, 0}, {0, 0, 0}}});
  const std::vector<std::array<Vec3d, 2>> few(2, {{kOrigin, kOrigin + Vec3d{1, 1, 1}}});
  const std::vector<uint32_t> sources = {3, 1, 4, 1, 5};
  PreparedSegments again, fresh;
  ASSERT_TRUE(PrepareSegments(scene, many, sources, sources, &again).ok());
  EXPECT_EQ(again.from_source, sources);
  EXPECT_EQ(again.invalid, 5u);
  ASSERT_TRUE(PrepareSegments(scene, few, {}, {}, &again).ok());
  ASSERT_TRUE(PrepareSegments(scene, few, {}, {}, &fresh).ok());
  ExpectSame(again, fresh);
  EXPECT_EQ(again.from_source, std::vector<uint32_t>(2, kNoTriangle));
}

TEST(SegmentsTest, SourcesThatDoNotFitAreRefused) {
  const IndexedGeometry scene = Scene();
  const std::vector<std::array<Vec3f, 2>> ends(2);
  const std::vector<uint32_t> one = {0};
  const std::vector<uint32_t> beyond = {0, static_cast<uint32_t>(scene.geometry.triangles.size())};
  PreparedSegments prepared;
  for (const auto& sources : {one, beyond}) {
    EXPECT_EQ(PrepareStoredSegments(scene, ends, sources, {}, &prepared).code(),
              absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(PrepareStoredSegments(scene, ends, {}, sources, &prepared).code(),
              absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace sightline
