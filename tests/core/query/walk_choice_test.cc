// SPDX-License-Identifier: Apache-2.0
//
// What AUTO walks next follows what walks cost, and never changes an answer.
#include "core/query/walk_choice.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using testing_support::MakeScene;
using testing_support::TestRng;
using Others = WalkChoice::Others;

constexpr size_t kRays = 256;

// What a walk of so many rays counts that took so many cycles a ray, or as few as there can be, if
// all it did was to visit leaves.
WalkStats Costing(Others others, Strategy walk, float cycles, size_t rays) {
  const auto cost = [&](uint64_t leaves) {
    WalkStats after;
    after.leaves = leaves * kRays;
    return WalkChoice(others).Learn(walk, {}, after, kRays) / kRays;
  };
  const float least = cost(0);
  WalkStats stats;
  stats.leaves = static_cast<uint64_t>(std::max(0.0f, (cycles - least) / (cost(1) - least)) *
                                       static_cast<float>(rays));
  return stats;
}

void Teach(WalkChoice& choice, Others others, Strategy walk, float cycles, size_t rays = kRays) {
  WalkStats before;
  before.nodes = 7;
  before.leaves = 5;
  WalkStats after = Costing(others, walk, cycles, rays);
  after.nodes = before.nodes;
  after.leaves += before.leaves;
  choice.Learn(walk, before, after, rays);
}

// How often each walk was taken in `blocks` blocks, given how many cycles each costs a ray.
struct Taken {
  int shafts = 0, packets = 0, singles = 0;
};
Taken Take(WalkChoice& choice, Others others, int blocks, float shaft, float packet, float single) {
  Taken taken;
  for (int i = 0; i < blocks; ++i) {
    const Strategy walk = choice.Next();
    ++(walk == Strategy::kShaft    ? taken.shafts
       : walk == Strategy::kPacket ? taken.packets
                                   : taken.singles);
    Teach(choice, others, walk,
          walk == Strategy::kShaft    ? shaft
          : walk == Strategy::kPacket ? packet
                                      : single);
  }
  return taken;
}

TEST(WalkChoiceTest, CheapShaftsAreNotComparedWithAnything) {
  WalkChoice choice(Others::kOneOrigin);
  EXPECT_EQ(Take(choice, Others::kOneOrigin, 200, 60, 20, 200).shafts, 200);
  EXPECT_FALSE(choice.ShaftsAreRare());
}

TEST(WalkChoiceTest, DearShaftsGiveWayToWhatIsCheapest) {
  WalkChoice singles(Others::kOneOrigin);
  Taken taken = Take(singles, Others::kOneOrigin, 200, 1000, 1000, 500);
  EXPECT_TRUE(singles.ShaftsAreRare());
  EXPECT_GT(taken.singles, 180);
  EXPECT_GE(taken.shafts, 2);  // Asked again now and then.
  EXPECT_LE(taken.packets, 10);
  WalkChoice packets(Others::kOneOrigin);
  taken = Take(packets, Others::kOneOrigin, 200, 1000, 100, 1000);
  EXPECT_GT(taken.packets, 180);
}

// A picture of sixteen blocks over a million triangles: one of them tells, and one is asked whether
// that was an accident.
TEST(WalkChoiceTest, LostShaftsGiveWayToSingleRaysAtOnce) {
  for (const Others others : {Others::kClosest, Others::kOneOrigin, Others::kParallel}) {
    WalkChoice choice(others);
    const Taken taken = Take(choice, others, 16, 9000, 9000, 1500);
    EXPECT_EQ(taken.shafts, 2);
    EXPECT_EQ(taken.packets, 0);
    EXPECT_EQ(taken.singles, 14);
  }
}

TEST(WalkChoiceTest, DearShaftsStayWhereNothingIsCheaper) {
  WalkChoice choice(Others::kOneOrigin);
  const Taken taken = Take(choice, Others::kOneOrigin, 1000, 1000, 1000, 2000);
  EXPECT_FALSE(choice.ShaftsAreRare());
  // Trials of either become rare: after 16 and 32 blocks, then every 64.
  EXPECT_GT(taken.shafts, 950);
  EXPECT_GT(taken.packets, 10);
  EXPECT_GT(taken.singles, 10);
}

TEST(WalkChoiceTest, ReturnsToShaftsWhereRaysShareTheirWayAgain) {
  WalkChoice choice(Others::kOneOrigin);
  Take(choice, Others::kOneOrigin, 300, 1000, 1000, 500);
  EXPECT_TRUE(choice.ShaftsAreRare());
  // The longest wait, and some more until what was dear is forgotten.
  EXPECT_GT(Take(choice, Others::kOneOrigin, 300, 20, 1000, 500).shafts, 200);
  EXPECT_FALSE(choice.ShaftsAreRare());
}

TEST(WalkChoiceTest, KeepsToWhatThereIs) {
  WalkChoice shafts(Others::kNone);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(shafts.Next(), Strategy::kShaft);
    Teach(shafts, Others::kOneOrigin, Strategy::kShaft, 1000);
  }
}

TEST(WalkChoiceTest, ALeafCostsPacketsForAnyHitLess) {
  const auto leaf = [](Others others) {
    WalkStats after;
    after.leaves = kRays;
    return WalkChoice(others).Learn(Strategy::kPacket, {}, after, kRays) -
           WalkChoice(others).Learn(Strategy::kPacket, {}, {}, kRays);
  };
  EXPECT_LT(leaf(Others::kOneOrigin), leaf(Others::kClosest));
  EXPECT_LT(leaf(Others::kParallel), leaf(Others::kClosest));
}

// Packets for any hit are tried sooner than those for closest hits, along one direction the
// soonest.
TEST(WalkChoiceTest, PacketsForAnyHitAreTriedSooner) {
  const auto packets = [](Others others, float shaft) {
    WalkChoice choice(others);
    return Take(choice, others, 200, shaft, 20, 1000).packets;
  };
  EXPECT_EQ(packets(Others::kOneOrigin, 60), 0);
  EXPECT_GT(packets(Others::kParallel, 60), 150);
  EXPECT_EQ(packets(Others::kClosest, 120), 0);
  EXPECT_GT(packets(Others::kOneOrigin, 120), 150);
  EXPECT_GT(packets(Others::kClosest, 300), 150);
}

TEST(WalkChoiceTest, AFewRaysTeachNothing) {
  constexpr Others kOthers = Others::kOneOrigin;
  WalkChoice choice(kOthers);
  for (int i = 0; i < 10; ++i) Teach(choice, kOthers, Strategy::kShaft, 1000, /*rays=*/31);
  EXPECT_EQ(choice.Next(), Strategy::kShaft);
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(choice.Next(), Strategy::kShaft);
    Teach(choice, kOthers, Strategy::kShaft, 1000, /*rays=*/32);
  }
  EXPECT_NE(choice.Next(), Strategy::kShaft);
}

// One dear block among shafts' first is an accident; its like in all of them is not.
TEST(WalkChoiceTest, WhatShaftsCostIsTheMeanOfTheirFirstBlocks) {
  constexpr Others kOthers = Others::kOneOrigin;
  for (const float others : {200.0f, 4500.0f}) {
    WalkChoice choice(kOthers);
    for (const float cost : {4500.0f, others, others, others}) {
      EXPECT_EQ(choice.Next(), Strategy::kShaft);
      Teach(choice, kOthers, Strategy::kShaft, cost);
    }
    EXPECT_EQ(choice.Next(), Strategy::kPacket);
    Teach(choice, kOthers, Strategy::kPacket, 2500);
    const int packets = Take(choice, kOthers, 10, others, 2500, 9000).packets;
    if (others < 2500) {
      EXPECT_EQ(packets, 0);
    } else {
      EXPECT_GT(packets, 5);
    }
  }
}

TEST(WalkChoicesTest, EachLightLearnsForItselfAndBeginsWhereTheLastLeftOff) {
  constexpr Others kOthers = Others::kOneOrigin;
  WalkChoices choices(kOthers);
  EXPECT_EQ(Take(choices.Of(0), kOthers, 100, 60, 20, 200).shafts, 100);
  EXPECT_GT(Take(choices.Of(1), kOthers, 100, 1000, 1000, 500).singles, 80);
  EXPECT_EQ(choices.Of(0).Next(), Strategy::kShaft);
  EXPECT_EQ(choices.Of(1).Next(), Strategy::kSingle);
  // New ones know what the one before knows, and are their own from then on.
  EXPECT_EQ(choices.Of(7).Next(), Strategy::kSingle);
  EXPECT_GT(Take(choices.Of(7), kOthers, 300, 20, 1000, 500).shafts, 100);
  EXPECT_EQ(choices.Of(1).Next(), Strategy::kSingle);
  EXPECT_EQ(choices.Of(0).Next(), Strategy::kShaft);
  EXPECT_EQ(choices.Of(2).Next(), Strategy::kShaft);
}

// Small triangles all over a cube, and points thinly scattered among them.
IndexedGeometry MakeSoup(int triangles, TestRng& rng) {
  ObjectInput soup;
  soup.name = "soup";
  for (int i = 0; i < triangles; ++i) {
    const Vec3d centre = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
    for (int k = 0; k < 3; ++k) {
      soup.indices.push_back(static_cast<uint32_t>(soup.vertices.size()));
      soup.vertices.push_back(
          centre + Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)} * 0.02);
    }
  }
  return MakeScene({soup});
}

LightSample MakeSample(Vec3f value, bool directional, uint32_t light) {
  LightSample sample;
  sample.light = light;
  sample.value = value;
  sample.directional = directional;
  return sample;
}

class MixedWalksTest : public testing::Test {
 protected:
  TestRng rng_;
  const IndexedGeometry scene_ = MakeSoup(12'000, rng_);
};

TEST_F(MixedWalksTest, OfSegmentsAndRaysAnswerAsBruteForceDoes) {
  PreparedPoints points;
  for (int i = 0; i < 2'000; ++i) {
    points.positions.push_back({static_cast<float>(rng_.Uniform(-1, 1)),
                                static_cast<float>(rng_.Uniform(-1, 1)),
                                static_cast<float>(rng_.Uniform(-1, 1))});
    points.valid.push_back(i % 50 != 7);
    points.sources.push_back(kNoTriangle);
  }
  const PointRange range = PointRange::Slice(points, 0, points.size());
  for (const bool directional : {false, true}) {
    for (const bool blockers : {false, true}) {
      SCOPED_TRACE(testing::Message() << directional << blockers);
      std::vector<LightSample> samples;
      for (const Vec3f at : {Vec3f{0.3f, 0.2f, 1.5f}, Vec3f{-0.4f, 0.5f, 0.9f}}) {
        // Lights of their own, each with a choice.
        samples.push_back(MakeSample(at, directional, static_cast<uint32_t>(samples.size())));
      }
      const ShadowOutputs outputs = {
          .bits = true, .counts = true, .blockers = blockers, .answered_by = true};
      ShadowResult truth, found;
      ASSERT_TRUE(ComputeShadows(scene_, range, samples, {}, {}, outputs,
                                 {.strategy = Strategy::kBruteForce}, &truth)
                      .ok());
      ASSERT_TRUE(ComputeShadows(scene_, range, samples, {}, {}, outputs, {}, &found).ok());
      EXPECT_EQ(found.lit_bits, truth.lit_bits);
      EXPECT_EQ(found.lit_counts, truth.lit_counts);
      EXPECT_EQ(found.blocker, truth.blocker);
      EXPECT_EQ(found.blocker_t, truth.blocker_t);
      const auto answered = [&](AnsweredBy by) {
        return std::count(found.answered_by.begin(), found.answered_by.end(), by);
      };
      EXPECT_EQ(answered(AnsweredBy::kNoRay), 2 * 40);
      if (directional && blockers) {
        EXPECT_EQ(found.stats.strategy, Strategy::kSingle);
        continue;
      }
      // More than one walk was taken: what this test is for.
      EXPECT_EQ(found.stats.strategy, Strategy::kAuto);
      EXPECT_GT(answered(AnsweredBy::kPacket), 0);
      EXPECT_LT(answered(AnsweredBy::kPacket), static_cast<int64_t>(2 * points.size()) - 2 * 40);
      // And with shafts or packets alone it is the same.
      ShadowResult packets;
      ASSERT_TRUE(ComputeShadows(scene_, range, samples, {}, {}, outputs,
                                 {.strategy = Strategy::kPacket, .packet_side = 4}, &packets)
                      .ok());
      EXPECT_EQ(packets.stats.strategy, Strategy::kPacket);
      EXPECT_EQ(packets.lit_bits, found.lit_bits);
      ShadowResult shafts;
      ASSERT_TRUE(ComputeShadows(scene_, range, samples, {}, {}, outputs,
                                 {.strategy = Strategy::kShaft}, &shafts)
                      .ok());
      EXPECT_EQ(shafts.stats.strategy, Strategy::kShaft);
      EXPECT_EQ(shafts.lit_bits, found.lit_bits);
    }
  }
}

TEST_F(MixedWalksTest, OfPixelsAnswerAsBruteForceDoes) {
  const auto camera = LookAt({3, 0.4, 0.2}, {0, 0, 0}, {0, 0, 1}, 40, 64, 48);
  ASSERT_TRUE(camera.ok()) << camera.status();
  const TileOutputs outputs = {
      .hits = true, .ids = true, .depth = true, .uv = true, .answered_by = true};
  const auto trace = [&](Strategy strategy) {
    TileResult result;
    EXPECT_TRUE(
        TraceTile(scene_, *camera, {0, 0, 64, 48}, {}, outputs, {.strategy = strategy}, &result)
            .ok());
    return result;
  };
  const TileResult truth = trace(Strategy::kBruteForce), found = trace(Strategy::kAuto);
  EXPECT_EQ(found.primary.strategy, Strategy::kAuto);
  EXPECT_GT(std::count(found.answered_by.begin(), found.answered_by.end(), AnsweredBy::kPacket), 0);
  EXPECT_EQ(found.hit_bits, truth.hit_bits);
  EXPECT_EQ(found.triangle, truth.triangle);
  EXPECT_EQ(found.depth, truth.depth);
  EXPECT_EQ(found.u, truth.u);
  EXPECT_EQ(found.v, truth.v);
}

}  // namespace
}  // namespace sightline
