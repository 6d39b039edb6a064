// SPDX-License-Identifier: Apache-2.0
//
// What tiles a picture has for relevant triangles tracing (paper 002, section 3): those of its own
// grid, whole wherever the picture has them whole, whatever else it is cut into on the way.
#include <cstdint>
#include <numeric>

#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using testing_support::MakeIcosphere;
using testing_support::MakeScene;
using testing_support::MakeTerrain;
using testing_support::OnKdTreeAlone;

constexpr uint32_t kSide = 256;

TileResult Trace(const IndexedGeometry& scene, uint32_t width, uint32_t height,
                 const QueryOptions& options, const TileOutputs& outputs) {
  const Camera camera = testing_support::LookingDown({0, 0, 9}, 0.4, kSide);
  TileResult result;
  const absl::Status status =
      TraceTile(scene, camera, {3, 5, width, height}, {}, outputs, options, &result);
  EXPECT_TRUE(status.ok()) << status;
  return result;
}

TEST(RttTilesTest, APictureHasTheTilesOfItsGrid) {
  const IndexedGeometry scene = OnKdTreeAlone(
      MakeScene({MakeTerrain(12, 8, {-4, -4, -1}), MakeIcosphere(2, 1.5, Affine3d())}), {});
  for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
    for (const auto& [width, height] :
         {std::pair(240u, 120u), {128u, 64u}, {130u, 67u}, {61u, 50u}, {24u, 3u}, {1u, 9u}}) {
      SCOPED_TRACE(testing::Message() << width << "x" << height << ", n = " << n);
      const TileOutputs outputs = {.hits = true, .ids = true, .depth = true, .uv = true};
      const TileResult tile = Trace(
          scene, width, height,
          {.strategy = Strategy::kRtt, .rtt_antialiasing = n, .count_answers = true}, outputs);
      const uint32_t side = 4 * static_cast<uint32_t>(n);
      EXPECT_EQ(tile.primary.tiles,
                uint64_t{(width + side - 1) / side} * ((height + side - 1) / side));
      // Cut squares are filled up with rays that nobody asked about.
      EXPECT_EQ(tile.primary.rays, uint64_t{width} * height);
      const auto& answered = tile.primary.answered_by;
      EXPECT_EQ(std::accumulate(answered.begin(), answered.end(), uint64_t{0}),
                uint64_t{width} * height);
      const TileResult truth =
          Trace(scene, width, height, {.strategy = Strategy::kBruteForce}, outputs);
      EXPECT_EQ(tile.hit_bits, truth.hit_bits);
      for (uint32_t i = 0; i < width * height; ++i) {
        ASSERT_EQ(tile.triangle[i], truth.triangle[i]) << i;
        ASSERT_EQ(tile.depth[i], truth.depth[i]) << i;
        ASSERT_EQ(tile.u[i], truth.u[i]) << i;
        ASSERT_EQ(tile.v[i], truth.v[i]) << i;
      }
    }
  }
}

// A picture whose sides four does not divide: before its last column of squares was filled up, its
// tiles ran on into the next row, across a whole block.
TEST(RttTilesTest, TilesAtTheBorderAreAsNarrowAsElsewhere) {
  const IndexedGeometry scene = OnKdTreeAlone(MakeScene({MakeTerrain(4, 8, {-4, -4, -1})}), {});
  const TileOutputs outputs = {.ids = true};
  const QueryStats whole = Trace(scene, 16, 16, {.strategy = Strategy::kRtt}, outputs).primary;
  ASSERT_EQ(whole.tiles_answered, 16u);
  for (uint32_t side = 13; side < 16; ++side) {
    const QueryStats cut = Trace(scene, side, side, {.strategy = Strategy::kRtt}, outputs).primary;
    EXPECT_EQ(cut.tiles_answered, 16u) << side;
    EXPECT_LE(cut.relevant_triangles, whole.relevant_triangles) << side;
  }
}

}  // namespace
}  // namespace sightline
