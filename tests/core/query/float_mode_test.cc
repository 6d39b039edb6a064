// SPDX-License-Identifier: Apache-2.0
//
// Every query answers alike whatever floating-point mode its caller's thread is in.
#include <pmmintrin.h>

#include <array>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/query/points.h"
#include "core/query/relighting.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using namespace testing_support;  // NOLINT

// A mode of the thread, put back at the end.
class Mode {
 public:
  explicit Mode(unsigned bits) : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | bits); }
  ~Mode() { _mm_setcsr(saved_); }

 private:
  const unsigned saved_;
};

constexpr unsigned kPlain = 0;
constexpr unsigned kOthers[] = {_MM_ROUND_UP, _MM_ROUND_TOWARD_ZERO,
                                _MM_FLUSH_ZERO_ON | _MM_DENORMALS_ZERO_ON};

class FloatModeTest : public testing::Test {
 protected:
  void SetUp() override {
    for (int i = 0; i < 600; ++i) {
      Vec3d p = {rng_.Uniform(-1, 1), rng_.Uniform(-1, 1), rng_.Uniform(-1, 1)};
      p = p * (1 / Length(p));
      points_.push_back(p * 0.4 + Vec3d{1.0 / 3, 0.1, 0.5});
      normals_.push_back(p * 1e-30);
    }
    // Where a mode flushes, these are gone.
    for (int i = 0; i < 8; ++i) {
      points_.push_back(Vec3d{0.1, 0.2, 0.3} + Vec3d{1e-40, 3e-42, -1e-44} * i);
      normals_.push_back({1e-310, 1e-312, 0});
    }
  }

  // Moves points, rounds and attaches them.
  PreparedPoints Prepared(unsigned mode) const {
    const Mode in(mode);
    auto points = PreparePoints(scene_, {points_, normals_, {}},
                                {.attach_distance = 0.01, .offset = 1.0 / 1024});
    EXPECT_TRUE(points.ok()) << points.status();
    return *std::move(points);
  }

  TestRng rng_{TestSeed()};
  const IndexedGeometry scene_ =
      IndexObjects({MakeClosedSphere(16, 24, 0.4, {1.0 / 3, 0.1, 0.5})}, Vec3d{0.1, 0.2, 0.3});
  std::vector<Vec3d> points_, normals_;
};

TEST_F(FloatModeTest, Points) {
  const PreparedPoints plain = Prepared(kPlain);
  ASSERT_GT(plain.attached, 0u);
  for (const unsigned mode : kOthers) {
    const PreparedPoints points = Prepared(mode);
    EXPECT_EQ(points.positions, plain.positions) << "mode " << mode;
    EXPECT_EQ(points.sources, plain.sources) << "mode " << mode;
    EXPECT_EQ(points.valid, plain.valid) << "mode " << mode;
    EXPECT_EQ(points.near_surface, plain.near_surface) << "mode " << mode;
  }
}

TEST_F(FloatModeTest, SegmentsAndShadows) {
  std::vector<std::array<Vec3d, 2>> ends;
  for (size_t i = 0; i + 1 < points_.size(); ++i) ends.push_back({points_[i], points_[i + 1]});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({2, 1.0 / 3, 3}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0.3, 0.1, 1}), 1, {}, &samples).ok());
  const std::vector<double> weights = {0.1, 1.0 / 3};
  const PreparedPoints points = Prepared(kPlain);
  const auto segments = [&](unsigned mode) {
    const Mode in(mode);
    PreparedSegments prepared;
    SegmentResult result;
    EXPECT_TRUE(PrepareSegments(scene_, ends, {}, {}, &prepared).ok());
    EXPECT_TRUE(TestSegments(scene_, prepared, {.first_hits = true}, {}, &result).ok());
    return result;
  };
  const auto shadows = [&](unsigned mode) {
    const Mode in(mode);
    ShadowResult result;
    EXPECT_TRUE(ComputeShadows(scene_, PointRange::All(points), samples, weights, {.t_min = 0.01},
                               {.weighted_sums = true, .blockers = true}, {}, &result)
                    .ok());
    return result;
  };
  const SegmentResult plain = segments(kPlain);
  const ShadowResult lit = shadows(kPlain);
  for (const unsigned mode : kOthers) {
    const SegmentResult other = segments(mode);
    EXPECT_EQ(other.triangle, plain.triangle) << "mode " << mode;
    EXPECT_EQ(other.t, plain.t) << "mode " << mode;
    const ShadowResult other_lit = shadows(mode);
    EXPECT_EQ(other_lit.lit_bits, lit.lit_bits) << "mode " << mode;
    EXPECT_EQ(other_lit.weighted_sums, lit.weighted_sums) << "mode " << mode;
    EXPECT_EQ(other_lit.blocker_t, lit.blocker_t) << "mode " << mode;
  }
}

TEST_F(FloatModeTest, TilesAndRelitPictures) {
  constexpr uint32_t kSide = 32;
  const Camera camera =
      *LookAt({1.0 / 3, 0.1, 3}, {1.0 / 3, 0.1, 0.5}, {0, 1, 0}, 20, kSide, kSide);
  std::vector<LightSample> samples;
  for (uint32_t light = 0; light < 3; ++light) {
    ASSERT_TRUE(
        AppendSamples(Light::Point({2 - 0.7 * light, 1.0 / 3, 3}), light, {}, &samples).ok());
  }
  const std::vector<double> weights = {0.1, 1.0 / 3, 0.7};
  const auto trace = [&](unsigned mode) {
    const Mode in(mode);
    TileResult tile;
    EXPECT_TRUE(TraceTile(scene_, camera, {0, 0, kSide, kSide}, samples,
                          {.depth = true, .uv = true, .lit = true, .points = true}, {}, &tile)
                    .ok());
    return tile;
  };
  const TileResult plain = trace(kPlain);
  const auto relit = [&](unsigned mode) {
    const Mode in(mode);
    absl::StatusOr<Relighting> picture =
        Relighting::Make(scene_, PacketsOfHits(plain.points, plain.point_pixel, kSide, kSide, 8),
                         samples, weights, {});
    EXPECT_TRUE(picture.ok()) << picture.status();
    std::vector<double> colors = picture->color();
    const std::vector<double> weight = {0.3};
    EXPECT_TRUE(picture->Choose(1).ok());
    colors.insert(colors.end(), picture->color().begin(), picture->color().end());
    EXPECT_TRUE(picture->Move(std::span(samples).first(1), weight, {}).ok());
    colors.insert(colors.end(), picture->color().begin(), picture->color().end());
    return colors;
  };
  const std::vector<double> colors = relit(kPlain);
  for (const unsigned mode : kOthers) {
    const TileResult tile = trace(mode);
    EXPECT_EQ(tile.depth, plain.depth) << "mode " << mode;
    EXPECT_EQ(tile.u, plain.u) << "mode " << mode;
    EXPECT_EQ(tile.lit_bits, plain.lit_bits) << "mode " << mode;
    EXPECT_EQ(tile.points.positions, plain.points.positions) << "mode " << mode;
    EXPECT_EQ(relit(mode), colors) << "mode " << mode;
  }
}

}  // namespace
}  // namespace sightline
