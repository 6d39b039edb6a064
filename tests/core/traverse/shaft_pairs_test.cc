// SPDX-License-Identifier: Apache-2.0
//
// Two packets as one shaft: brute force's answers, or none at all.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/traverse/shaft_cut.h"
#include "core/traverse/shaft_seed.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr int kRays = PacketPair::kMaxRays;

class ShaftPairsTest : public KernelsFixture {
 protected:
  TraceShaftPairFn pair() const { return kernels().occluded_shaft_pair; }

  // Two full packets of segments from one place.
  std::vector<TraceRay> Fill(NastyRays& rays) {
    rays.FillPacket(RayPacket::kMaxRays, &packets_[0]);
    if (rng_.Chance(0.7)) {
      // What neighbours see: as far apart again as the first one's are.
      const float apart = static_cast<float>(rng_.Uniform(-0.05, 0.05));
      for (int lane = 0; lane < RayPacket::kMaxRays; ++lane) {
        packets_[1].target_x[lane] = packets_[0].target_x[lane] * (1 + apart);
        packets_[1].target_y[lane] = packets_[0].target_y[lane];
        packets_[1].target_z[lane] = packets_[0].target_z[lane] * (1 - apart);
        packets_[1].target_source[lane] = rays.Source();
      }
    } else {
      rays.FillPacket(RayPacket::kMaxRays, &packets_[1]);
    }
    const bool sourceless = rng_.Chance(0.5);
    for (RayPacket* packet : {&packets_[0], &packets_[1]}) {
      packet->origin = packets_[0].origin;
      packet->origin_source = packets_[0].origin_source;
      packet->mask = packets_[0].mask;
      packet->count = RayPacket::kMaxRays;
      packet->segments = true;
      packet->sourceless = sourceless;
    }
    packets_[0].first_leaf = rng_.Chance(0.5) ? last_leaf_ : RayPacket::kNoLeaf;
    box_ = {};
    std::vector<TraceRay> queries;
    for (int lane = 0; lane < kRays; ++lane) {
      const RayPacket& packet = packets_[lane / RayPacket::kMaxRays];
      queries.push_back(packet.trace_ray(lane % RayPacket::kMaxRays));
      box_.Extend(packet.target(lane % RayPacket::kMaxRays));
    }
    return queries;
  }

  // Whether the walk answered; then its answers are those of `truth`, all of them.
  bool Answers(const IndexedGeometry& scene, const std::vector<Hit>& truth, const ShaftCut* cut,
               ShaftSeed* seed) {
    alignas(64) std::array<uint32_t, kRays / 32> blocked;
    std::array<AnsweredBy, kRays> answered_by;
    blocked.fill(0xA5A5A5A5u);
    answered_by.fill(AnsweredBy::kShaft);
    packets_[0].seed = seed;
    packets_[0].answered_by = rng_.Chance(0.5) ? answered_by.data() : nullptr;
    PacketPair pair_of(packets_.get(), &box_, blocked.data());
    packets_[0].seed = nullptr;
    packets_[0].answered_by = nullptr;
    if (!pair()(scene, pair_of, cut, nullptr, &stats_)) return false;
    last_leaf_ = pair_of.first_leaf;
    for (int lane = 0; lane < kRays; ++lane) {
      const bool is_blocked = (blocked[lane / 32] >> (lane % 32) & 1) != 0;
      EXPECT_EQ(is_blocked, truth[lane].triangle != kNoTriangle) << "lane " << lane;
      ++(is_blocked ? blocked_ : lit_);
      asked_rays_ += answered_by[lane] == AnsweredBy::kRay ? 1 : 0;
    }
    return true;
  }

  TestRng rng_;
  std::unique_ptr<RayPacket[]> packets_ = std::make_unique<RayPacket[]>(2);
  Box3f box_;
  uint32_t last_leaf_ = RayPacket::kNoLeaf;  // What darkened the last pair.
  WalkStats stats_;
  int64_t blocked_ = 0, lit_ = 0, asked_rays_ = 0;
};

std::vector<SimdTarget> TargetsWithPairs() {
  std::vector<SimdTarget> targets = AvailableTargets();
  std::erase_if(
      targets, [](SimdTarget target) { return KernelsFor(target).occluded_shaft_pair == nullptr; });
  return targets;
}
INSTANTIATE_TEST_SUITE_P(Targets, ShaftPairsTest, testing::ValuesIn(TargetsWithPairs()),
                         TargetName);
// A machine without AVX-512 has none.
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(ShaftPairsTest);

TEST(ShaftPairsTargetsTest, AreThoseOfAvx512Alone) {
  for (const SimdTarget target : AvailableTargets()) {
    EXPECT_EQ(KernelsFor(target).occluded_shaft_pair != nullptr, target == SimdTarget::kAvx512);
  }
}

TEST_P(ShaftPairsTest, GiveBruteForcesAnswers) {
  int64_t answered = 0, left = 0;
  for (const NastyScene& scene : MakeNastyScenes(rng_)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng_);
    ShaftSeed seed;
    last_leaf_ = RayPacket::kNoLeaf;
    for (int64_t i = 0, n = ScaledCount(80, 8); i < n && !HasFailure(); ++i) {
      const std::vector<TraceRay> queries = Fill(rays);
      std::vector<Hit> truth(queries.size());
      WalkStats stats;
      ASSERT_TRUE(kernels().occluded_brute(scene.indexed, queries, truth, nullptr, &stats));
      ShaftCut cut;
      const bool has_cut =
          kernels().cut_shaft(scene.indexed, std::span<const RayPacket>(packets_.get(), 2), &cut);
      if (rng_.Chance(0.5)) seed = {};
      for (const bool from_cut : {false, true}) {
        ++(Answers(scene.indexed, truth, from_cut && has_cut ? &cut : nullptr,
                   rng_.Chance(0.7) ? &seed : nullptr)
               ? answered
               : left);
      }
    }
  }
  // Sets that are split, and what is left to single rays, among them.
  EXPECT_GT(answered, left / 4);
  EXPECT_GT(left, 0);
  EXPECT_GT(blocked_, lit_ / 10);
  EXPECT_GT(lit_, blocked_ / 10);
  EXPECT_GT(stats_.shaft.splits, 0u);
  EXPECT_GT(stats_.shaft.singles, 0u);
  EXPECT_GT(asked_rays_, 0);
}

TEST_P(ShaftPairsTest, LeaveOffWhenCancelled) {
  CancelToken cancel;
  cancel.Cancel();
  for (const NastyScene& scene : MakeNastyScenes(rng_)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng_);
    for (int64_t i = 0, n = ScaledCount(10, 2); i < n; ++i) {
      const std::vector<TraceRay> queries = Fill(rays);
      std::vector<Hit> truth(queries.size());
      ASSERT_TRUE(kernels().occluded_brute(scene.indexed, queries, truth, nullptr, &stats_));
      std::array<uint32_t, kRays / 32> blocked = {};
      PacketPair both(packets_.get(), &box_, blocked.data());
      // A walk that is over before it looks has answered.
      if (!pair()(scene.indexed, both, nullptr, &cancel, &stats_)) continue;
      for (int lane = 0; lane < kRays; ++lane) {
        ASSERT_EQ((blocked[lane / 32] >> (lane % 32) & 1) != 0,
                  truth[lane].triangle != kNoTriangle);
      }
    }
  }
}

}  // namespace
}  // namespace sightline::testing_support
