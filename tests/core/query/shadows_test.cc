// SPDX-License-Identifier: Apache-2.0
//
// What ComputeShadows leaves in a result and in hints that were used before, and what it refuses.
#include "core/query/shadows.h"

#include <cstdint>
#include <span>
#include <vector>

#include "core/geometry/vec3.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/nasty_scenes.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

class ShadowsTest : public ::testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(AppendSamples(Light::Point({0.1, 0.2, -3}), 0, {}, &samples_).ok());
    ASSERT_TRUE(AppendSamples(Light::Point({2, 0.2, 3}), 1, {}, &samples_).ok());
    for (int i = 0; i < 700; ++i) {
      points_.push_back({static_cast<float>(i % 29) / 15 - 1, static_cast<float>(i % 31) / 16 - 1,
                         1 + static_cast<float>(i) / 700});
    }
  }

  absl::Status Compute(size_t points, const ShadowOutputs& outputs, ShadowResult* result,
                       double t_min = 0) {
    return ComputeShadows(scene_, {std::span(points_).first(points), {}, {}}, samples_, weights_,
                          {.t_min = t_min}, outputs, {}, result);
  }

  const IndexedGeometry scene_ =
      IndexObjects({MakeClosedSphere(16, 24, 0.4, {0, 0, 0.5})}, Vec3d{});
  std::vector<LightSample> samples_;
  std::vector<Vec3f> points_;
  const std::vector<double> weights_ = {0.5, 0.25};
};

TEST_F(ShadowsTest, AResultUsedBeforeHoldsWhatANewOneDoes) {
  ShadowResult again;
  for (const size_t points : {700, 3, 0, 256, 257, 700}) {
    for (int wanted = 0; wanted < 32; ++wanted) {
      const ShadowOutputs outputs = {.bits = (wanted & 1) != 0,
                                     .counts = (wanted & 2) != 0,
                                     .weighted_sums = (wanted & 4) != 0,
                                     .blockers = (wanted & 8) != 0,
                                     .answered_by = (wanted & 16) != 0};
      ShadowResult once;
      ASSERT_TRUE(Compute(points, outputs, &once).ok());
      ASSERT_TRUE(Compute(points, outputs, &again).ok());
      ASSERT_EQ(again.lit_bits, once.lit_bits);
      ASSERT_EQ(again.lit_counts, once.lit_counts);
      ASSERT_EQ(again.weighted_sums, once.weighted_sums);
      ASSERT_EQ(again.blocker, once.blocker);
      ASSERT_EQ(again.blocker_t, once.blocker_t);
      ASSERT_EQ(again.answered_by, once.answered_by);
      ASSERT_EQ(again.stats.rays, once.stats.rays);
      ASSERT_EQ(again.stats.rays, points * samples_.size());
    }
  }
}

TEST_F(ShadowsTest, AResultHoldsNothingAfterAnError) {
  ShadowResult result;
  ASSERT_TRUE(Compute(700, {.counts = true}, &result).ok());
  ASSERT_FALSE(result.lit_bits.empty() || result.lit_counts.empty());
  EXPECT_EQ(Compute(700, {.counts = true}, &result, /*t_min=*/2).code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(result.lit_bits.empty() && result.lit_counts.empty());
  EXPECT_EQ(result.stats.rays, 0u);
}

// What was learnt is taken over as a call begins; one that does not end leaves nothing of it.
TEST_F(ShadowsTest, HintsServeAgainAfterACancelledCall) {
  ShadowResult plain;
  ASSERT_TRUE(Compute(700, {}, &plain).ok());
  CancelToken cancelled;
  cancelled.Cancel();
  ShadowHints hints;
  for (const CancelToken* cancel :
       {static_cast<const CancelToken*>(nullptr), static_cast<const CancelToken*>(&cancelled),
        static_cast<const CancelToken*>(nullptr)}) {
    ShadowResult result;
    const absl::Status status = ComputeShadows(scene_, {points_, {}, {}}, samples_, {},
                                               {.hints = &hints}, {}, {.cancel = cancel}, &result);
    if (cancel != nullptr) {
      ASSERT_EQ(status.code(), absl::StatusCode::kCancelled);
      EXPECT_TRUE(hints.first_leaves.empty() && hints.ray_cost == 0);
    } else {
      ASSERT_TRUE(status.ok()) << status;
      EXPECT_EQ(hints.first_leaves.size(), samples_.size());
      EXPECT_EQ(result.lit_bits, plain.lit_bits);
    }
  }
}

// Leaves of another scene's are none of this one's, or lie across two of them: what would be read
// there is no triangle of either, and may lie beyond the array.
TEST_F(ShadowsTest, HintsOfAnotherSceneAreNoneOfThisOne) {
  TestRng rng;
  const auto soup = [&](uint32_t triangles) {
    ObjectInput object;
    for (uint32_t i = 0; i < 3 * triangles; ++i) {
      const Vec3d any = {rng.Uniform(-1, 1), rng.Uniform(-1, 1), rng.Uniform(-1, 1)};
      object.vertices.push_back(i % 3 == 0 ? any : object.vertices[i - i % 3] + any * 0.3);
      object.indices.push_back(i);
    }
    return IndexObjects({object}, Vec3d{});
  };
  for (const Strategy strategy : {Strategy::kAuto, Strategy::kShaft, Strategy::kPacket}) {
    ShadowHints hints;
    for (const uint32_t triangles : {30'000, 40, 3000, 300, 7, 3000, 1000, 200, 2000, 60}) {
      const IndexedGeometry scene = soup(triangles);
      ShadowResult truth, result;
      ASSERT_TRUE(ComputeShadows(scene, {points_, {}, {}}, samples_, {}, {}, {},
                                 {.strategy = Strategy::kBruteForce}, &truth)
                      .ok());
      for (int again = 0; again < 2; ++again) {
        ASSERT_TRUE(ComputeShadows(scene, {points_, {}, {}}, samples_, {}, {.hints = &hints}, {},
                                   {.strategy = strategy}, &result)
                        .ok());
        EXPECT_EQ(result.lit_bits, truth.lit_bits) << triangles << ' ' << again;
        EXPECT_EQ(hints.bvh, scene.bvh.number.value());
      }
    }
  }
}

TEST_F(ShadowsTest, MorePointsThanAreNumberedAreRefused) {
  // Nobody looks at them.
  const std::span<const Vec3f> many(points_.data(), kMaxShadowPoints + 1);
  ShadowResult result;
  const absl::Status status =
      ComputeShadows(scene_, {many, {}, {}}, samples_, {}, {}, {}, {}, &result);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(status.message().find("2147483648 points"), std::string::npos) << status;
}

}  // namespace
}  // namespace sightline
