// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/peer_order.h"

#include <utility>
#include <vector>

#include "gtest/gtest.h"
#include "tests/bench/test_scene.h"
#include "tests/bench/workload.h"
#include "tests/support/random.h"

namespace sightline::bench {
namespace {

std::vector<Vec3f> RandomPoints(size_t count, testing_support::TestRng& rng) {
  std::vector<Vec3f> points;
  for (size_t i = 0; i < count; ++i) {
    points.push_back({static_cast<float>(rng.Uniform(-3, 5)), static_cast<float>(rng.Uniform(0, 1)),
                      static_cast<float>(rng.Uniform(100, 108))});
  }
  return points;
}

TEST(PeerOrderTest, EveryPointStandsOnceAndNeighboursAreNear) {
  testing_support::TestRng rng;
  const std::vector<Vec3f> points = RandomPoints(20'000, rng);
  PeerOrder order;
  order.Sort(points);
  ASSERT_EQ(order.positions().size(), points.size());
  std::vector<bool> seen(points.size(), false);
  double steps = 0, steps_before = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    const uint32_t number = order.number(i);
    ASSERT_LT(number, points.size());
    EXPECT_FALSE(seen[number]);
    seen[number] = true;
    EXPECT_EQ(order.positions()[i].x, points[number].x);
    EXPECT_EQ(order.positions()[i].z, points[number].z);
    if (i == 0) continue;
    steps += Length(ToDouble(order.positions()[i] - order.positions()[i - 1]));
    steps_before += Length(ToDouble(points[i] - points[i - 1]));
  }
  EXPECT_LT(steps, steps_before / 8);
}

TEST(PeerOrderTest, CodesAreTheBitsOfTheCellsInTurn) {
  // The corners of the box, and its lower half along x: the first bit that differs decides, of z
  // before y before x.
  const std::vector<Vec3f> points = {{1, 1, 1}, {0, 0, 1}, {0, 1, 0}, {1, 0, 0},
                                     {0, 0, 0}, {0, 1, 1}, {1, 1, 0}, {0.25f, 0, 0}};
  PeerOrder order;
  order.Sort(points);
  const std::vector<uint32_t> expected = {4, 7, 3, 2, 6, 1, 5, 0};
  for (size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(order.number(i), expected[i]) << i;
}

TEST(PeerOrderTest, BitsGoBackToWhereTheirPointsStood) {
  testing_support::TestRng rng;
  for (const size_t count : {size_t{1}, size_t{7}, size_t{8}, size_t{1000}}) {
    const std::vector<Vec3f> points = RandomPoints(count, rng);
    PeerOrder order;
    order.Sort(points);
    // A bit says whether a point lies in the lower part; handed back in two portions.
    std::vector<uint8_t> row((count + 7) / 8, 0);
    const size_t half = count / 16 * 8;
    for (const auto& [first, end] : {std::pair(size_t{0}, half), std::pair(half, count)}) {
      std::vector<uint8_t> bits((end - first + 7) / 8, 0);
      for (size_t i = first; i < end; ++i) {
        if (!(order.positions()[i].x < 1)) continue;
        uint8_t& byte = bits[(i - first) / 8];
        byte = static_cast<uint8_t>(byte | 1u << ((i - first) % 8));
      }
      order.PutBack(bits.data(), first, end - first, row.data());
    }
    for (size_t i = 0; i < count; ++i) {
      EXPECT_EQ((row[i / 8] >> (i % 8) & 1) != 0, points[i].x < 1) << i << " of " << count;
    }
  }
}

TEST(PeerOrderTest, EqualAndFlatPointsKeepTheirOrder) {
  PeerOrder order;
  order.Sort({});
  EXPECT_TRUE(order.positions().empty());
  const std::vector<Vec3f> same(100, Vec3f{1, 2, 3});
  order.Sort(same);
  for (size_t i = 0; i < same.size(); ++i) EXPECT_EQ(order.number(i), i);
}

// Sorted or not, in any mode, the peer says the same of every point.
TEST(PeerOrderTest, SortedModesGiveTheSameBits) {
  TestScene sphere("builtin:sphere:3000");
  const auto device = EmbreeDevice::Open(2, SimdTarget::kBest);
  ASSERT_TRUE(device.ok()) << device.status();
  const PeerMesh mesh(sphere.scene.geometry);
  const auto peer = EmbreeScene::Build(**device, mesh, {});
  ASSERT_TRUE(peer.ok()) << peer.status();
  WorkloadSpec spec;
  spec.name = "points";
  spec.points = 1001;
  spec.lights = "lights";
  spec.shuffled = true;
  const auto workload = MakeWorkload(spec, sphere.source, sphere.scene, sphere.pool);
  ASSERT_TRUE(workload.ok()) << workload.status();
  size_t sorted = 0;
  for (const PeerMode mode : (*workload)->peer_modes()) {
    if (mode.coherent) continue;
    sorted += mode.sorted;
    for (size_t unit = 0; unit < (*workload)->units(); ++unit) {
      Agreement agreement{.settle = false};
      (*workload)->RunOurs(unit);
      (*workload)->RunPeer(**peer, mode, unit, Share::kSample);  // Leaves nothing behind.
      (*workload)->RunPeer(**peer, mode, unit, Share::kAll);
      (*workload)->Compare(unit, &agreement);
      // A few rays in a hundred go by rounding; of bits gone astray it would be a third.
      EXPECT_LT(agreement.disagreements, agreement.queries / 10) << mode.Name();
    }
  }
  EXPECT_EQ(sorted, 10u);
}

}  // namespace
}  // namespace sightline::bench
