// SPDX-License-Identifier: Apache-2.0
//
// What AUTO walks next follows what walks cost, and never changes an answer.
#include "core/query/walk_choice.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
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
constexpr float kAlike = 1;  // Blocks of one extent.

// What a walk of so many rays counts that took so many cycles a ray, or as few as there can be, if
// all it did was to visit leaves.
WalkStats Costing(Others others, Strategy walk, float cycles, size_t rays) {
  const auto cost = [&](uint64_t leaves) {
    WalkStats after;
    after.leaves = leaves * kRays;
    return WalkChoice(others).Learn(walk, {}, after, kRays, kAlike) / kRays;
  };
  const float least = cost(0);
  WalkStats stats;
  stats.leaves = static_cast<uint64_t>(std::max(0.0f, (cycles - least) / (cost(1) - least)) *
                                       static_cast<float>(rays));
  return stats;
}

void Teach(WalkChoice& choice, Others others, Strategy walk, float cycles, size_t rays = kRays,
           float growth = kAlike) {
  WalkStats before;
  before.nodes = 7;
  before.leaves = 5;
  WalkStats after = Costing(others, walk, cycles, rays);
  after.nodes = before.nodes;
  after.leaves += before.leaves;
  choice.Learn(walk, before, after, rays, growth);
}

// How often each walk was taken in `blocks` blocks, given how many cycles each costs a ray.
struct Taken {
  int shafts = 0, packets = 0, singles = 0;
};
Taken Take(WalkChoice& choice, Others others, int blocks, float shaft, float packet, float single) {
  Taken taken;
  for (int i = 0; i < blocks; ++i) {
    const Strategy walk = choice.Next(kAlike);
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

// A picture of sixteen blocks over a million triangles: one of them tells.
TEST(WalkChoiceTest, LostShaftsGiveWayToSingleRaysAtOnce) {
  for (const Others others : {Others::kClosest, Others::kOneOrigin, Others::kParallel}) {
    WalkChoice choice(others);
    const Taken taken = Take(choice, others, 16, 9000, 9000, 1500);
    EXPECT_EQ(taken.shafts, 1);
    EXPECT_EQ(taken.packets, 0);
    EXPECT_EQ(taken.singles, 15);
  }
}

TEST(WalkChoiceTest, DearShaftsStayWhereNothingIsCheaper) {
  WalkChoice choice(Others::kOneOrigin);
  const Taken taken = Take(choice, Others::kOneOrigin, 1000, 1000, 1010, 2000);
  EXPECT_FALSE(choice.ShaftsAreRare());
  // Trials become rare: after 8, 16 and 32 blocks, then every 64; of what costs twice as much four
  // times as rare.
  EXPECT_GT(taken.shafts, 950);
  EXPECT_GT(taken.packets, 10);
  EXPECT_GE(taken.singles, 3);
  EXPECT_LT(taken.singles, 10);
}

// However dear shafts were, and however often they have lost, they are asked again.
TEST(WalkChoiceTest, ReturnsToShaftsWhereRaysShareTheirWayAgain) {
  for (const float dear : {1000.0f, 1e7f}) {
    WalkChoice choice(Others::kOneOrigin);
    EXPECT_LT(Take(choice, Others::kOneOrigin, 10'000, dear, 1000, 500).shafts, 50);
    // At the latest after the longest wait times sixteen, and what was dear is forgotten at once.
    const int blocks = dear > 1000 ? 1'300 : 600;
    EXPECT_GT(Take(choice, Others::kOneOrigin, blocks, 20, 1000, 500).shafts, 250);
    EXPECT_FALSE(choice.ShaftsAreRare());
  }
}

TEST(WalkChoiceTest, KeepsToWhatThereIs) {
  WalkChoice shafts(Others::kNone);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(shafts.Next(kAlike), Strategy::kShaft);
    Teach(shafts, Others::kOneOrigin, Strategy::kShaft, 1000);
  }
}

TEST(WalkChoiceTest, ALeafCostsPacketsForAnyHitLess) {
  const auto leaf = [](Others others) {
    WalkStats after;
    after.leaves = kRays;
    return WalkChoice(others).Learn(Strategy::kPacket, {}, after, kRays, kAlike) -
           WalkChoice(others).Learn(Strategy::kPacket, {}, {}, kRays, kAlike);
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
  EXPECT_EQ(choice.Next(kAlike), Strategy::kShaft);
  EXPECT_EQ(choice.Next(kAlike), Strategy::kShaft);
  Teach(choice, kOthers, Strategy::kShaft, 1000, /*rays=*/32);
  EXPECT_NE(choice.Next(kAlike), Strategy::kShaft);
}

// One dear block is an accident; its like in the next few is not.
TEST(WalkChoiceTest, OneDearBlockIsForgottenSoon) {
  constexpr Others kOthers = Others::kOneOrigin;
  for (const float others : {60.0f, 1000.0f}) {
    WalkChoice choice(kOthers);
    for (int i = 0; i < 20; ++i) {
      if (choice.Next(kAlike) == Strategy::kPacket) break;
      Teach(choice, kOthers, Strategy::kShaft, 60);
    }
    Teach(choice, kOthers, Strategy::kShaft, 1000);
    const Taken taken = Take(choice, kOthers, 100, others, 150, 9000);
    if (others < 150) {
      EXPECT_GE(taken.shafts, 50);
    } else {
      EXPECT_GE(taken.packets, 90);
    }
  }
}

// Packets that were cheap once by chance do not win for long: what they cost is a mean of many.
TEST(WalkChoiceTest, OneCheapBlockOfPacketsDoesNotCount) {
  constexpr Others kOthers = Others::kOneOrigin;
  WalkChoice choice(kOthers);
  Take(choice, kOthers, 100, 200, 300, 9000);
  Teach(choice, kOthers, Strategy::kPacket, 20);
  EXPECT_GE(Take(choice, kOthers, 50, 200, 300, 9000).shafts, 45);
}

TEST(WalkChoiceTest, ALargerBlockIsTakenToCostItsShaftMore) {
  constexpr Others kOthers = Others::kOneOrigin;
  WalkChoice choice(kOthers);
  Take(choice, kOthers, 6, 100, 150, 9000);
  EXPECT_EQ(choice.Next(kAlike), Strategy::kShaft);
  // An extent four times as large is a shaft twice as dear.
  const float four = WalkChoice::Growth(4 * 4);
  EXPECT_EQ(choice.Next(four), Strategy::kPacket);
  // What was learnt of one holds for others by their extent.
  WalkChoice of_large(kOthers);
  Teach(of_large, kOthers, Strategy::kShaft, 200, kRays, four);
  Teach(of_large, kOthers, Strategy::kPacket, 150, kRays, four);
  EXPECT_EQ(of_large.Next(four), Strategy::kPacket);
  EXPECT_EQ(of_large.Next(kAlike), Strategy::kShaft);
}

TEST(WalkChoiceTest, AnyExtentWillDo) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float extent : {0.0f, -1.0f, 1e-45f, 1e30f, kInfinity, std::nanf("")}) {
    const float growth = WalkChoice::Growth(extent);
    EXPECT_GT(growth, 0) << extent;
    EXPECT_LT(growth, kInfinity) << extent;
    WalkChoice choice(Others::kOneOrigin);
    Teach(choice, Others::kOneOrigin, Strategy::kShaft, 1000, kRays, growth);
    EXPECT_NE(choice.Next(growth), Strategy::kShaft);
  }
  EXPECT_EQ(WalkChoice::Growth(1), 1);
  EXPECT_FLOAT_EQ(WalkChoice::Growth(16), 2);
}

TEST(WalkChoicesTest, EachLightLearnsForItselfAndBeginsWhereTheLastLeftOff) {
  constexpr Others kOthers = Others::kOneOrigin;
  WalkChoices choices;
  const auto next = [&](uint32_t light) { return choices.Of(light, kOthers).Next(kAlike); };
  EXPECT_EQ(Take(choices.Of(0, kOthers), kOthers, 100, 60, 20, 200).shafts, 100);
  EXPECT_GT(Take(choices.Of(1, kOthers), kOthers, 100, 1000, 1000, 500).singles, 80);
  EXPECT_EQ(next(0), Strategy::kShaft);
  EXPECT_EQ(next(1), Strategy::kSingle);
  // New ones know what the one before knows, and are their own from then on.
  EXPECT_EQ(next(7), Strategy::kSingle);
  EXPECT_GT(Take(choices.Of(7, kOthers), kOthers, 600, 20, 1000, 500).shafts, 100);
  EXPECT_EQ(next(1), Strategy::kSingle);
  EXPECT_EQ(next(0), Strategy::kShaft);
  EXPECT_EQ(next(2), Strategy::kShaft);
}

TEST(WalkChoicesTest, OnesThatWereMovedFromKnowNothing) {
  constexpr Others kOthers = Others::kOneOrigin;
  WalkChoices choices;
  Take(choices.Of(1, kOthers), kOthers, 100, 1000, 1000, 500);
  WalkChoices taken = std::move(choices);
  EXPECT_EQ(taken.Of(1, kOthers).Next(kAlike), Strategy::kSingle);
  EXPECT_EQ(choices.Of(0, kOthers).Next(kAlike),
            Strategy::kShaft);  // NOLINT(bugprone-use-after-move)
}

// As where hints of one call are handed on to another that asks otherwise.
TEST(WalkChoicesTest, WhatWasLearntOfOtherWalksIsForgotten) {
  WalkChoices choices;
  Take(choices.Of(0, Others::kParallel), Others::kParallel, 100, 1000, 100, 500);
  EXPECT_EQ(choices.Of(0, Others::kParallel).Next(kAlike), Strategy::kPacket);
  EXPECT_EQ(choices.Of(0, Others::kNone).Next(kAlike), Strategy::kShaft);
  EXPECT_EQ(choices.Of(1, Others::kOneOrigin).Next(kAlike), Strategy::kShaft);
  EXPECT_EQ(choices.Of(0, Others::kParallel).Next(kAlike), Strategy::kShaft);
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
      // For closest hits single rays may be the only other one.
      EXPECT_GT(answered(AnsweredBy::kPacket) + (blockers ? answered(AnsweredBy::kRay) : 0), 0);
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

// What walks cost is handed on with the hints: points that come next do not begin with a shaft.
TEST_F(MixedWalksTest, TakeWhatTheLastCallHasLearnt) {
  PreparedPoints points;
  for (int i = 0; i < static_cast<int>(4 * kRays); ++i) {
    points.positions.push_back({static_cast<float>(rng_.Uniform(-1, 1)),
                                static_cast<float>(rng_.Uniform(-1, 1)),
                                static_cast<float>(rng_.Uniform(-1, 1))});
    points.valid.push_back(1);
    points.sources.push_back(kNoTriangle);
  }
  const PointRange range = PointRange::Slice(points, 0, points.size());
  for (const bool directional : {false, true}) {
    const std::vector<LightSample> samples = {MakeSample({0.6f, 0.4f, 6}, directional, 0)};
    ShadowHints hints;
    const auto by_packets = [&](std::vector<uint8_t>* lit) {
      ShadowResult found;
      EXPECT_TRUE(ComputeShadows(scene_, range, samples, {}, {.ordered = true, .hints = &hints},
                                 {.bits = true, .answered_by = true}, {}, &found)
                      .ok());
      *lit = found.lit_bits;
      return std::count(found.answered_by.begin(), found.answered_by.end(), AnsweredBy::kPacket);
    };
    std::vector<uint8_t> first, then;
    // The first block tells what shafts cost.
    const auto at_first = by_packets(&first);
    EXPECT_GT(at_first, 0);
    EXPECT_LE(at_first, 3 * kRays);
    EXPECT_EQ(by_packets(&then), 4 * kRays);
    EXPECT_EQ(first, then);
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
