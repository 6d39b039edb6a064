// SPDX-License-Identifier: Apache-2.0
//
// Every query leaves off when its token fires, however little each of its walks has to do.
#include "core/base/cancel.h"

#include <array>
#include <chrono>
#include <vector>

#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using testing_support::MakeScene;

constexpr Strategy kStrategies[] = {Strategy::kAuto, Strategy::kShaft, Strategy::kPacket,
                                    Strategy::kSingle, Strategy::kBruteForce};

// One triangle: no walk is long enough to poll by itself.
IndexedGeometry OneTriangle() {
  return MakeScene({{.vertices = {{-9, -9, 0}, {9, -9, 0}, {0, 9, 0}}, .indices = {0, 1, 2}}});
}

class CancelTest : public testing::TestWithParam<absl::StatusCode> {
 protected:
  void SetUp() override {
    if (GetParam() == absl::StatusCode::kCancelled) {
      token_.Cancel();
    } else {
      token_.set_deadline(CancelToken::Clock::now() - std::chrono::seconds(1));
    }
  }
  QueryOptions Options(Strategy strategy) const {
    return {.strategy = strategy, .cancel = &token_};
  }

  const IndexedGeometry scene_ = OneTriangle();
  CancelToken token_;
};

TEST_P(CancelTest, Tiles) {
  const Camera camera = *LookAt({0, 0, 10}, {0, 0, 0}, {0, 1, 0}, 40, 128, 128);
  for (const Strategy strategy : kStrategies) {
    TileResult result;
    result.triangle.resize(128 * 128);  // Of a call before.
    EXPECT_EQ(
        TraceTile(scene_, camera, {0, 0, 128, 128}, {}, {.ids = true}, Options(strategy), &result)
            .code(),
        GetParam());
    EXPECT_TRUE(result.triangle.empty());
  }
}

TEST_P(CancelTest, Shadows) {
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({0, 0, 5}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0, 0, 1}), 1, {}, &samples).ok());
  const std::vector<Vec3f> positions(500, Vec3f{0, 0, -1});
  const std::vector<uint8_t> valid(positions.size(), 1);
  for (const Strategy strategy : kStrategies) {
    ShadowResult result;
    result.lit_bits.resize(9);
    EXPECT_EQ(ComputeShadows(scene_, {positions, {}, valid}, samples, {}, {}, {}, Options(strategy),
                             &result)
                  .code(),
              GetParam());
    EXPECT_TRUE(result.lit_bits.empty());
  }
}

TEST_P(CancelTest, Segments) {
  const std::vector<std::array<Vec3d, 2>> ends(500, {Vec3d{0, 0, -1}, Vec3d{0, 0, 1}});
  PreparedSegments segments;
  ASSERT_TRUE(PrepareSegments(scene_, ends, {}, {}, &segments).ok());
  for (const Strategy strategy : kStrategies) {
    SegmentResult result;
    const SegmentOutputs outputs = {.bits = true, .first_hits = true};
    ASSERT_TRUE(TestSegments(scene_, segments, outputs, {.strategy = strategy}, &result).ok());
    ASSERT_EQ(result.triangle.size(), ends.size());
    EXPECT_EQ(TestSegments(scene_, segments, outputs, Options(strategy), &result).code(),
              GetParam());
    EXPECT_TRUE(result.blocked_bits.empty() && result.triangle.empty() && result.t.empty());
    EXPECT_EQ(result.stats.rays, 0u);
  }
}

INSTANTIATE_TEST_SUITE_P(Reasons, CancelTest,
                         testing::Values(absl::StatusCode::kCancelled,
                                         absl::StatusCode::kDeadlineExceeded));

}  // namespace
}  // namespace sightline
