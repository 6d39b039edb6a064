// SPDX-License-Identifier: Apache-2.0
#include "core/traverse/answered_by.h"

#include <algorithm>
#include <string>
#include <vector>

#include "core/accel/kd_builder.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using ::testing::Each;
using testing_support::MakeScene;
using testing_support::TestRng;

constexpr uint32_t kSide = 64;
constexpr TileRect kTile = {0, 0, kSide, kSide};

// Seen from +z, 4 wide and high at depth 10; the picture's middle is the origin.
Camera Down(double half_width = 2) {
  return testing_support::LookingDown({0, 0, 10}, half_width / 10, kSide);
}

ObjectInput Triangle(Vec3d a, Vec3d b, Vec3d c) {
  return {.vertices = {a, b, c}, .indices = {0, 1, 2}};
}

TileResult Trace(const IndexedGeometry& scene, const Camera& camera, Strategy strategy,
                 std::span<const LightSample> samples = {}) {
  TileResult result;
  const absl::Status status =
      TraceTile(scene, camera, kTile, samples,
                {.ids = true, .lit = true, .answered_by = true, .lit_answered_by = true},
                {.strategy = strategy}, &result);
  EXPECT_TRUE(status.ok()) << status;
  EXPECT_EQ(result.answered_by.size(), kSide * kSide);
  EXPECT_EQ(result.lit_answered_by.size(), samples.size() * kSide * kSide);
  return result;
}

TEST(AnsweredByTest, StrategiesAreToldApart) {
  const IndexedGeometry scene = MakeScene({Triangle({-9, -9, 0}, {9, -9, 0}, {0, 9, 0})});
  EXPECT_THAT(Trace(scene, Down(), Strategy::kSingle).answered_by, Each(AnsweredBy::kRay));
  EXPECT_THAT(Trace(scene, Down(), Strategy::kBruteForce).answered_by, Each(AnsweredBy::kRay));
  EXPECT_THAT(Trace(scene, Down(), Strategy::kPacket).answered_by, Each(AnsweredBy::kPacket));
}

TEST(AnsweredByTest, ShaftsAnswerWhatIsEmptyOrCovered) {
  const IndexedGeometry scene = MakeScene({Triangle({-9, -9, 0}, {9, -9, 0}, {0, 9, 0})});
  // The triangle covers the whole picture.
  const TileResult covered = Trace(scene, Down(), Strategy::kShaft);
  EXPECT_THAT(covered.triangle, Each(0u));
  EXPECT_THAT(covered.answered_by, Each(AnsweredBy::kShaft));
  EXPECT_EQ(covered.primary.triangle_tests, 0u);
  EXPECT_GT(covered.primary.shaft.covers, 0u);
  EXPECT_EQ(covered.primary.shaft.covers, covered.primary.shaft.pairs);
  Camera away = Down();
  away.forward = {0, 0, 1};
  away.right = {-1, 0, 0};
  const TileResult empty = Trace(scene, away, Strategy::kShaft);
  EXPECT_THAT(empty.triangle, Each(kNoTriangle));
  EXPECT_THAT(empty.answered_by, Each(AnsweredBy::kShaft));
  EXPECT_EQ(empty.primary.triangle_tests, 0u);
}

// Where an edge crosses a block of sixteen rays they are tested; farther from it none is.
TEST(AnsweredByTest, EdgesTakeTheExactTest) {
  // Pixels are 1/16 wide: the edge x = 0.16 runs amid the blocks of columns 32 to 35.
  const IndexedGeometry scene = MakeScene({Triangle({-99, -99, 0}, {0.16, -99, 0}, {0.16, 99, 0})});
  const TileResult result = Trace(scene, Down(), Strategy::kShaft);
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      EXPECT_EQ(result.triangle[y * kSide + x], x <= 34 ? 0u : kNoTriangle) << x << " " << y;
      EXPECT_EQ(result.answered_by[y * kSide + x],
                x >= 32 && x <= 35 ? AnsweredBy::kTriangles : AnsweredBy::kShaft)
          << x << " " << y;
    }
  }
}

// Tiles of four by four, by their lists: none relevant, some, and tiles that needed rays.
TEST(AnsweredByTest, RelevantTrianglesOfTiles) {
  IndexedGeometry scene = MakeScene({Triangle({-99, -99, 0}, {0.16, -99, 0}, {0.16, 99, 0})});
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(scene.geometry, {}, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  scene.kd_tree = *std::move(tree);
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({3, 0, 8}), 0, {}, &samples).ok());
  const TileResult result = Trace(scene, Down(), Strategy::kRtt, samples);
  for (uint32_t y = 0; y < kSide; ++y) {
    for (uint32_t x = 0; x < kSide; ++x) {
      const size_t i = y * kSide + x;
      EXPECT_EQ(result.triangle[i], x <= 34 ? 0u : kNoTriangle) << x << " " << y;
      EXPECT_EQ(result.answered_by[i], x <= 35 ? AnsweredBy::kTriangles : AnsweredBy::kShaft)
          << x << " " << y;
      // Shadows end on their own triangle, which is then not relevant.
      EXPECT_EQ(result.lit_answered_by[i], x <= 34 ? AnsweredBy::kShaft : AnsweredBy::kNoRay)
          << x << " " << y;
    }
  }
}

// A triangle that covers a tile's shadows blocks them without a test, and is relevant all the same.
TEST(AnsweredByTest, CoveringTrianglesOfTilesAreRelevant) {
  IndexedGeometry scene = MakeScene({Triangle({-99, -99, 0}, {99, -99, 0}, {0, 199, 0}),
                                     Triangle({-9, -9, 20}, {9, -9, 20}, {0, 18, 20})});
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(scene.geometry, {}, pool);
  ASSERT_TRUE(tree.ok()) << tree.status();
  scene.kd_tree = *std::move(tree);
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({0, 0, 30}), 0, {}, &samples).ok());
  const TileResult result = Trace(scene, Down(), Strategy::kRtt, samples);
  EXPECT_THAT(result.lit_bits, Each(0));
  EXPECT_GT(result.shadow.tiles_answered, 0u);
  EXPECT_LT(result.shadow.triangle_tests, result.shadow.rays);
  EXPECT_THAT(result.lit_answered_by, Each(AnsweredBy::kTriangles));
}

TEST(AnsweredByTest, ShadowsOfEachSample) {
  // A floor, and a roof over its left half.
  const IndexedGeometry scene = MakeScene({Triangle({-9, -9, 0}, {9, -9, 0}, {0, 18, 0}),
                                           Triangle({-9, -9, 4}, {0, -9, 4}, {0, 18, 4})});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({3, 0, 8}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0, 0, 1}), 1, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({0, 0, 0}), 2, {}, &samples).ok());
  Camera camera = Down();
  camera.eye = {0, 0, 3};  // Below the roof.
  const TileResult shaft = Trace(scene, camera, Strategy::kShaft, samples);
  const TileResult single = Trace(scene, camera, Strategy::kSingle, samples);
  constexpr size_t kPixels = kSide * kSide;
  for (size_t s = 0; s < samples.size(); ++s) {
    size_t by_shaft = 0;
    for (size_t i = 0; i < kPixels; ++i) {
      const bool asked = shaft.triangle[i] != kNoTriangle && samples[s].valid;
      EXPECT_EQ(single.lit_answered_by[s * kPixels + i],
                asked ? AnsweredBy::kRay : AnsweredBy::kNoRay);
      EXPECT_EQ(shaft.lit_answered_by[s * kPixels + i] != AnsweredBy::kNoRay, asked);
      by_shaft += shaft.lit_answered_by[s * kPixels + i] == AnsweredBy::kShaft;
    }
    if (samples[s].valid) {
      EXPECT_GT(by_shaft, kPixels / 2) << s;
    }
  }
  EXPECT_EQ(shaft.lit_bits, single.lit_bits);
}

// Each strategy on these points, under two samples.
void CheckPoints(const IndexedGeometry& scene, const PreparedPoints& points,
                 const std::vector<LightSample>& samples) {
  for (const Strategy strategy : {Strategy::kShaft, Strategy::kPacket, Strategy::kSingle}) {
    ShadowResult plain, told;
    ASSERT_TRUE(ComputeShadows(scene, PointRange::All(points), samples, {}, {}, {.bits = true},
                               {.strategy = strategy}, &plain)
                    .ok());
    ASSERT_TRUE(ComputeShadows(scene, PointRange::All(points), samples, {}, {},
                               {.bits = true, .answered_by = true}, {.strategy = strategy}, &told)
                    .ok());
    EXPECT_TRUE(plain.answered_by.empty());
    EXPECT_EQ(plain.lit_bits, told.lit_bits);
    ASSERT_EQ(told.answered_by.size(), 2 * points.size());
    for (size_t k = 0; k < told.answered_by.size(); ++k) {
      const AnsweredBy by = told.answered_by[k];
      if (!points.valid[k % points.size()]) {
        EXPECT_EQ(by, AnsweredBy::kNoRay);
      } else if (strategy == Strategy::kSingle) {
        EXPECT_EQ(by, AnsweredBy::kRay);
      } else {
        EXPECT_NE(by, AnsweredBy::kNoRay);
      }
    }
    const auto tested =
        std::count(told.answered_by.begin(), told.answered_by.end(), AnsweredBy::kTriangles);
    EXPECT_EQ(tested > 0, strategy == Strategy::kShaft);
  }
}

// The same of points, whatever their order; and saying it changes no answer.
TEST(AnsweredByTest, ShadowsOfPoints) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene({testing_support::MakeTerrain(20, 10, {0, 0, 0})});
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point({3, 0, 8}), 0, {}, &samples).ok());
  ASSERT_TRUE(AppendSamples(Light::Directional({1, 0, 0.1}), 1, {}, &samples).ok());
  for (const bool in_order : {false, true}) {
    PreparedPoints points;
    for (int i = 0; i < 5000; ++i) {
      const Vec3d at = in_order
                           ? Vec3d{0.1 * (i / 50 % 10), 0.02 * (i % 50), 0.001 * (i / 500)}
                           : Vec3d{rng.Uniform(0, 10), rng.Uniform(0, 10), rng.Uniform(0, 1.5)};
      points.positions.push_back(ToFloat(at));
      points.valid.push_back(in_order || i % 7 != 0);
    }
    points.sources.assign(points.positions.size(), kNoTriangle);
    CheckPoints(scene, points, samples);
  }
}

// Packets that cull within leaves need an axis along which their rays go one way: those of a light
// amid its points have none, and are rays by themselves in the end.
TEST(AnsweredByTest, PacketsWithoutAnAxisAreRays) {
  TestRng rng;
  const IndexedGeometry scene = MakeScene({testing_support::MakeTerrain(20, 10, {0, 0, 0})});
  const Vec3d light = {5, 5, 3};
  std::vector<LightSample> samples;
  ASSERT_TRUE(AppendSamples(Light::Point(light), 0, {}, &samples).ok());
  for (const bool amid : {false, true}) {
    PreparedPoints points;
    for (int i = 0; i < 256; ++i) {  // So that halves are of whole pairs.
      const Vec3d to = {rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(-2.5, -0.5)};
      points.positions.push_back(ToFloat(light + to));
      points.positions.push_back(ToFloat(amid ? light - to : light + to * 0.5));
    }
    points.sources.assign(points.positions.size(), kNoTriangle);
    points.valid.assign(points.positions.size(), 1);
    for (const PacketSplit split : kAllPacketSplits) {
      for (const int side : kPacketSides) {
        for (const bool first : {false, true}) {
          QueryOptions options;
          options.strategy = Strategy::kPacket;
          options.leaf_culling = LeafCulling();
          options.leaf_culling->split = split;
          options.packet_side = side;
          options.count_answers = true;
          ShadowResult result;
          ASSERT_TRUE(ComputeShadows(scene, PointRange::All(points), samples, {}, {.ordered = true},
                                     {.bits = true, .blockers = first, .answered_by = true},
                                     options, &result)
                          .ok());
          EXPECT_THAT(result.answered_by, Each(amid ? AnsweredBy::kRay : AnsweredBy::kPacket))
              << "packets of " << side << ", split " << static_cast<int>(split);
          EXPECT_EQ(result.stats.answered_by[static_cast<size_t>(AnsweredBy::kRay)],
                    amid ? points.size() : 0);
        }
      }
    }
  }
}

}  // namespace
}  // namespace sightline
