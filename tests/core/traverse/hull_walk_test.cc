// SPDX-License-Identifier: Apache-2.0
//
// One walk for all samples of an area light, and the walks sample by sample that do what it leaves
// to them, say of each sample what the definition says, for every instruction set of this machine.
#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "core/base/cancel.h"
#include "core/traverse/kernels.h"
#include "core/traverse/light_hull.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

constexpr uint32_t kUnbounded = 0xFFFFFFFFu;

class HullWalkTest : public KernelsFixture {
 protected:
  bool Trace(const IndexedGeometry& scene, const LightHull& light, uint32_t budget,
             const CancelToken* cancel = nullptr) {
    return kernels().trace_hull(scene, light, *packet_, nullptr, budget, &rest_, blocked_.data(),
                                cancel, &stats_);
  }

  // Of sample k and all of the packet's points, what the definition says, and what the walk said,
  // or what a shaft's does that begins where it ended.
  void Compare(const IndexedGeometry& scene, const LightHull& light) {
    std::vector<TraceRay> queries(packet_->count);
    std::vector<Hit> truth(packet_->count);
    for (uint32_t k = 0; k < light.count; ++k) {
      std::array<uint16_t, RayPacket::kMaxRays / 16> unasked = {};
      for (int lane = 0; lane < packet_->count; ++lane) {
        queries[lane] = {.ray = PredicateRay::Segment(light.samples[k], packet_->target(lane)),
                         .mask = packet_->mask,
                         .from_source = packet_->origin_source,
                         .to_source = packet_->target_source[lane]};
        unasked[lane / 16] |= static_cast<uint16_t>((blocked_[lane] >> k & 1) << (lane % 16));
      }
      ASSERT_TRUE(kernels().occluded_brute(scene, queries, truth, nullptr, &stats_));
      packet_->origin = light.samples[k];
      packet_->unasked = unasked.data();
      if ((rest_.samples >> k & 1) != 0) {
        ASSERT_TRUE(kernels().occluded_shaft(scene, *packet_, &rest_.cut, nullptr, &stats_));
      } else {
        std::fill_n(packet_->triangle, packet_->count, kNoTriangle);
        spared_ += rest_.cut.node_count > 0;
      }
      packet_->unasked = nullptr;
      for (int lane = 0; lane < packet_->count; ++lane) {
        const bool known = (blocked_[lane] >> k & 1) != 0;
        const bool blocked = known || packet_->triangle[lane] != kNoTriangle;
        ASSERT_EQ(blocked, truth[lane].triangle != kNoTriangle)
            << Printed{queries[lane]} << "sample " << k << " of " << light.count << ", lane "
            << lane << "; the definition: " << truth[lane].triangle;
        known_segments_ += known;
        blocked_segments_ += blocked;
        ++segments_;
      }
    }
    for (int lane = 0; lane < packet_->count; ++lane) {
      ASSERT_EQ(blocked_[lane] >> light.count, 0u) << "a sample that there is not";
    }
  }

  const std::unique_ptr<RayPacket> packet_ = std::make_unique<RayPacket>();
  alignas(64) std::array<uint16_t, RayPacket::kMaxRays> blocked_;
  HullRest rest_;
  WalkStats stats_;
  int64_t segments_ = 0, known_segments_ = 0, blocked_segments_ = 0;
  int64_t spared_ = 0;  // Samples that what is left does not concern.
};

SIGHTLINE_FOR_EACH_TARGET(HullWalkTest);

Vec3d InBox(double size, TestRng& rng) {
  return Vec3d{rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)} * size;
}

// Samples of a parallelogram about `middle`: leaning, along two axes of space, a line or a point.
std::vector<Vec3f> Samples(Vec3f middle, double size, TestRng& rng) {
  Vec3d half[2] = {InBox(size, rng), InBox(size, rng)};
  const uint32_t shape = rng.Below(6);
  if (shape < 3) {
    // In the very plane of a level floor or ceiling, as lamps are.
    half[0] = Vec3d{shape == 0 ? 0.0 : size, 0, shape == 0 ? size : 0.0};
    half[1] = Vec3d{0, shape == 1 ? 0.0 : size, shape == 1 ? size : 0.0};
  }
  if (shape == 4) half[1] = half[0] * 0.5;
  if (shape == 5) half[0] = half[1] = Vec3d{0, 0, 0};
  std::vector<Vec3f> samples(1 + rng.Below(LightHull::kMostSamples));
  for (Vec3f& sample : samples) {
    sample =
        ToFloat(ToDouble(middle) + half[0] * rng.Uniform(-1, 1) + half[1] * rng.Uniform(-1, 1));
  }
  return samples;
}

void FillPoints(Vec3f light, NastyRays& rays, TestRng& rng, RayPacket* packet) {
  packet->segments = true;
  packet->origin = {0, 0, 0};
  packet->origin_source = rays.Source();
  packet->count = 1 + static_cast<int>(rng.Below(RayPacket::kMaxRays));
  const Vec3f middle = rays.Target(light, /*segment=*/true);
  const double size = rng.Uniform(0, 0.1) * Length(middle);
  const double strays = rng.Chance(0.3) ? 0.1 : 0.0;
  for (int lane = 0; lane < packet->count; ++lane) {
    const Vec3f target = rng.Chance(strays) ? rays.Target(light, true)
                                            : ToFloat(ToDouble(middle) + InBox(size, rng));
    packet->target_x[lane] = target.x;
    packet->target_y[lane] = target.y;
    packet->target_z[lane] = target.z;
    packet->target_source[lane] = rays.Source();
  }
}

TEST_P(HullWalkTest, SaysWhatTheDefinitionSaysOfEachSample) {
  TestRng rng;
  int64_t asked = 0, answered = 0, begun = 0;
  for (const NastyScene& scene : MakeNastyScenes(rng)) {
    SCOPED_TRACE(scene.name);
    NastyRays rays(scene.indexed, rng);
    for (int64_t i = 0, n = ScaledCount(60, 8); i < n; ++i) {
      const Vec3f middle = rays.Point();
      const double size = rng.Uniform(0, rng.Chance(0.5) ? 0.02 : 0.3) * Length(middle);
      const std::vector<Vec3f> samples = Samples(middle, size, rng);
      const LightHull light = FitLightHull(samples);
      packet_->first_leaf = RayPacket::kNoLeaf;
      // As packets come one after another; the first leaf is the one before's.
      for (int p = 0; p < 3; ++p) {
        packet_->mask = rng.Chance(0.8) ? 0xFFFFFFFFu : 1u << rng.Below(3);
        FillPoints(middle, rays, rng, packet_.get());
        ++asked;
        const uint32_t budget = rng.Chance(0.5) ? kUnbounded : rng.Below(3000);
        if (!Trace(scene.indexed, light, budget)) continue;
        answered += rest_.cut.node_count == 0;
        begun += rest_.cut.node_count > 0 &&
                 std::any_of(blocked_.begin(), blocked_.begin() + packet_->count,
                             [](uint16_t b) { return b != 0; });
        const uint32_t first_leaf = packet_->first_leaf;
        Compare(scene.indexed, light);
        packet_->first_leaf = first_leaf;
        if (HasFatalFailure()) return;
      }
    }
  }
  EXPECT_GT(answered, asked / 4);
  EXPECT_GT(begun, asked / 100);
  EXPECT_GT(known_segments_, blocked_segments_ / 4);
  EXPECT_GT(blocked_segments_, segments_ / 20);
  EXPECT_LT(blocked_segments_, segments_ * 19 / 20);
  EXPECT_GT(spared_, 0);
  EXPECT_GT(stats_.shaft.covers, 0u);
  EXPECT_GT(stats_.triangle_tests, 0u);
  EXPECT_GT(stats_.doubt_exact, 0u);
}

// A level grid of lamps' size under a lamp, and points below it.
class LampTest : public HullWalkTest {
 protected:
  LampTest() {
    scene_ = Sheet(12);
    std::vector<Vec3f> samples;
    for (int k = 0; k < 16; ++k) {
      samples.push_back({static_cast<float>(k % 4) * 0.1f, 2, static_cast<float>(k / 4) * 0.1f});
    }
    light_ = FitLightHull(samples);
    packet_->segments = true;
    packet_->count = 256;
    for (int lane = 0; lane < 256; ++lane) {
      packet_->target_x[lane] = static_cast<float>(lane % 16) * 0.05f - 0.4f;
      packet_->target_y[lane] = 0;
      packet_->target_z[lane] = static_cast<float>(lane / 16) * 0.05f - 0.4f;
      packet_->target_source[lane] = kNoTriangle;
    }
  }

  // So many cells along a side, between the lamp and the points, but not all of these.
  IndexedGeometry Sheet(int cells) {
    ObjectInput grid = MakeGrid(cells, 0, {0, 0, 0}, rng_);
    for (Vec3d& vertex : grid.vertices) vertex = vertex * (0.8 / cells) + Vec3d{-0.6, 1, -0.6};
    return IndexObjects({grid}, Vec3d{0, 0, 0});
  }

  TestRng rng_;
  IndexedGeometry scene_;
  LightHull light_;
};

SIGHTLINE_FOR_EACH_TARGET(LampTest);

TEST_P(LampTest, LeavesSmallTrianglesToOthers) {
  for (const bool small : {false, true}) {
    const IndexedGeometry scene = Sheet(small ? 200 : 12);
    packet_->first_leaf = RayPacket::kNoLeaf;
    ASSERT_TRUE(Trace(scene, light_, kUnbounded));
    EXPECT_EQ(rest_.cut.node_count > 0, small);
    Compare(scene, light_);
  }
}

TEST_P(LampTest, LeavesMoreToOthersTheLessItsBudgetIs) {
  uint64_t known_before = 0;
  for (const uint32_t budget : {0u, 1u, 500u, kUnbounded}) {
    packet_->first_leaf = RayPacket::kNoLeaf;
    ASSERT_TRUE(Trace(scene_, light_, budget));
    uint64_t known = 0;
    for (const uint16_t blocked : blocked_) known += static_cast<uint64_t>(std::popcount(blocked));
    EXPECT_GE(known, known_before) << budget;
    known_before = known;
    if (budget == 0) {
      EXPECT_EQ(known, 0u);
    }
    if (budget < 500) {
      EXPECT_GT(rest_.cut.node_count, 0u);
    }
    if (budget == kUnbounded) {
      EXPECT_EQ(rest_.cut.node_count, 0u);
    }
    Compare(scene_, light_);
  }
}

TEST_P(LampTest, LeavesAllToOthersWhenItIsCancelled) {
  CancelToken cancel;
  cancel.Cancel();
  ASSERT_TRUE(Trace(scene_, light_, kUnbounded, &cancel));
  Compare(scene_, light_);
}

TEST_P(LampTest, FindsNothingForSamplesThatFillSpace) {
  std::vector<Vec3f> samples(light_.samples, light_.samples + light_.count);
  samples[5].y += 0.2f;
  const LightHull light = FitLightHull(samples);
  ASSERT_TRUE(Trace(scene_, light, kUnbounded));
  EXPECT_GT(rest_.cut.node_count, 0u);
  EXPECT_TRUE(std::all_of(blocked_.begin(), blocked_.end(), [](uint16_t b) { return b == 0; }));
  Compare(scene_, light);
}

TEST_P(LampTest, FindsNothingWhereObjectsMustBeAsked) {
  packet_->mask = 0;
  ASSERT_TRUE(Trace(scene_, light_, kUnbounded));
  EXPECT_GT(rest_.cut.node_count, 0u);
  EXPECT_TRUE(std::all_of(blocked_.begin(), blocked_.end(), [](uint16_t b) { return b == 0; }));
}

TEST_P(LampTest, SeesAllWhereNothingIsBetween) {
  for (int lane = 0; lane < 256; ++lane) packet_->target_y[lane] = 1.5f;
  ASSERT_TRUE(Trace(scene_, light_, kUnbounded));
  EXPECT_EQ(rest_.cut.node_count, 0u);
  EXPECT_TRUE(std::all_of(blocked_.begin(), blocked_.end(), [](uint16_t b) { return b == 0; }));
}

}  // namespace
}  // namespace sightline::testing_support
