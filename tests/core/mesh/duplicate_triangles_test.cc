// SPDX-License-Identifier: Apache-2.0
#include "core/mesh/duplicate_triangles.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <numeric>
#include <set>
#include <vector>

#include "core/base/mix_bits.h"
#include "core/base/parallel.h"
#include "core/mesh/position_hash.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::ScaledCount;
using testing_support::TestRng;
using Triangle = std::array<uint32_t, 3>;

uint64_t CountByASet(const std::vector<Vec3f>& vertices, const std::vector<Triangle>& triangles,
                     const std::vector<uint32_t>& inert) {
  std::set<std::array<std::array<float, 3>, 3>> seen;
  uint64_t duplicates = 0;
  for (uint32_t id = 0; id < triangles.size(); ++id) {
    if (std::binary_search(inert.begin(), inert.end(), id)) continue;
    std::array<std::array<float, 3>, 3> key;
    for (int k = 0; k < 3; ++k) {
      const Vec3f v = vertices[triangles[id][k]];
      key[k] = {v.x, v.y, v.z};
    }
    std::sort(key.begin(), key.end());
    duplicates += seen.insert(key).second ? 0 : 1;
  }
  return duplicates;
}

TEST(DuplicateTrianglesTest, NoneAndFew) {
  EXPECT_EQ(CountDuplicateTriangles({}, {}, {}), 0u);
  // Vertex 3 stands where vertex 0 does.
  const std::vector<Vec3f> v = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 0}, {0, 0, 1}};
  const std::vector<Triangle> t = {{0, 1, 2}, {2, 3, 1}, {1, 0, 2}, {0, 1, 4}};
  EXPECT_EQ(CountDuplicateTriangles(v, {t.data(), 1}, {}), 0u);
  EXPECT_EQ(CountDuplicateTriangles(v, t, {}), 2u);
  EXPECT_EQ(CountDuplicateTriangles(v, t, std::vector<uint32_t>{1}), 1u);
  EXPECT_EQ(CountDuplicateTriangles(v, t, std::vector<uint32_t>{0, 1, 2, 3}), 0u);
}

TEST(DuplicateTrianglesTest, AgreesWithASetOnRandomMeshesAndAnyNumberOfThreads) {
  TestRng rng;
  for (uint64_t triangles : {3u, 100u, 20'000u, 150'000u}) {
    std::vector<Vec3f> v(40);
    for (Vec3f& x : v) {
      x = {static_cast<float>(rng.Below(4)), static_cast<float>(rng.Below(4)), 0};
    }
    std::vector<Triangle> t(static_cast<size_t>(ScaledCount(static_cast<int64_t>(triangles), 4)));
    std::vector<uint32_t> inert;
    for (uint32_t i = 0; i < t.size(); ++i) {
      for (uint32_t& k : t[i]) k = static_cast<uint32_t>(rng.Below(v.size()));
      if (rng.Chance(0.05)) inert.push_back(i);
    }
    const uint64_t expected = CountByASet(v, t, inert);
    for (int threads : {1, 2, 4}) {
      ThreadPool pool(threads);
      uint64_t count = 0;
      pool.ParallelFor(1, 1, [&](size_t, size_t) { count = CountDuplicateTriangles(v, t, inert); });
      EXPECT_EQ(count, expected) << t.size() << " triangles, " << threads << " threads";
    }
  }
}

// All in one place of the table.
TEST(DuplicateTrianglesTest, ManyIdenticalAndManyDistinct) {
  const size_t n = static_cast<size_t>(ScaledCount(300'000));
  const std::vector<Vec3f> corner = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const std::vector<Triangle> same(n, Triangle{0, 1, 2});
  EXPECT_EQ(CountDuplicateTriangles(corner, same, {}), n - 1);

  std::vector<Vec3f> strip(n + 2);
  std::vector<Triangle> distinct(n);
  for (uint32_t i = 0; i < strip.size(); ++i) strip[i] = {static_cast<float>(i), 0.5f, 0};
  for (uint32_t i = 0; i < n; ++i) distinct[i] = {i, i + 1, i + 2};
  EXPECT_EQ(CountDuplicateTriangles(strip, distinct, {}), 0u);
}

// The inverse of MixBits: h ^ h >> n is undone by as many more steps of n bits as there are, an odd
// factor by its own inverse.
uint64_t Unmix(uint64_t h) {
  const auto unshift = [](uint64_t x, int n) {
    uint64_t y = x;
    for (int known = n; known < 64; known += n) y = x ^ (y >> n);
    return y;
  };
  const auto inverse = [](uint64_t x) {
    uint64_t y = x;  // Right in three bits, then in twice as many each time.
    for (int i = 0; i < 5; ++i) y *= 2 - x * y;
    return y;
  };
  h = unshift(h, 31) * inverse(0x94D049BB133111EBu);
  h = unshift(h, 27) * inverse(0xBF58476D1CE4E5B9u);
  return unshift(h, 30);
}

// Triangles over vertices of one hash meet in every round: only sorting tells them apart.
TEST(DuplicateTrianglesTest, HashesMadeToCollide) {
  TestRng rng;
  ASSERT_EQ(Unmix(MixBits(123456789)), 123456789u);
  constexpr uint32_t kHash = 7;
  std::vector<Vec3f> v;
  while (v.size() < 40) {
    const uint32_t z = std::bit_cast<uint32_t>(static_cast<float>(rng.Uniform(-1, 1)));
    const uint64_t xy = Unmix(rng.Below(uint64_t{1} << 32) << 32 | kHash) ^ MixBits(z);
    const Vec3f p = {std::bit_cast<float>(static_cast<uint32_t>(xy >> 32)),
                     std::bit_cast<float>(static_cast<uint32_t>(xy)), std::bit_cast<float>(z)};
    if (IsFinite(p) && p.x != 0 && p.y != 0 && p.z != 0) v.push_back(p);
  }
  for (const Vec3f& p : v) ASSERT_EQ(static_cast<uint32_t>(HashPosition(p)), kHash);
  // One run of what is sorted, and several to be merged.
  for (const size_t n : {3'000, 50'000}) {
    std::vector<Triangle> t(n);
    for (Triangle& corners : t) {
      for (uint32_t& k : corners) k = static_cast<uint32_t>(rng.Below(v.size()));
    }
    EXPECT_EQ(CountDuplicateTriangles(v, t, {}), CountByASet(v, t, {}));
  }
}

}  // namespace
}  // namespace sightline
