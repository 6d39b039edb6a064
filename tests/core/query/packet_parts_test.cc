// SPDX-License-Identifier: Apache-2.0
//
// Packets of fewer rays than a block: its parts, asked one after another.
#include <bit>
#include <cstdint>
#include <vector>

#include "core/query/options.h"
#include "core/query/shadows.h"
#include "gtest/gtest.h"
#include "tests/core/query/query_meshes.h"

namespace sightline {
namespace {

using testing_support::MakeScene;
using testing_support::MakeTerrain;

// Points in rows over a terrain of [0, 8]², or below it.
PreparedPoints MakePoints(int rows, float z) {
  PreparedPoints points;
  for (int i = 0; i < rows * rows; ++i) {
    const int row = i / rows, column = i % rows;
    points.positions.push_back({8.0f * static_cast<float>(column) / static_cast<float>(rows),
                                8.0f * static_cast<float>(row) / static_cast<float>(rows), z});
    points.sources.push_back(kNoTriangle);
    points.valid.push_back(1);
  }
  return points;
}

// A lamp, or a sun.
std::vector<LightSample> MakeLight(bool directional, Vec3f value) {
  LightSample sample;
  sample.value = value;
  sample.directional = directional;
  return {sample};
}

ShadowResult Shadows(const IndexedGeometry& scene, const PreparedPoints& points, size_t count,
                     const std::vector<LightSample>& light, const QueryOptions& options) {
  ShadowResult result;
  // In the order given, so that the points' packets are known.
  const absl::Status status = ComputeShadows(scene, PointRange::Slice(points, 0, count), light, {},
                                             {.ordered = true}, {.bits = true}, options, &result);
  EXPECT_TRUE(status.ok()) << status;
  return result;
}

TEST(PacketPartsTest, OfAnySideAnswerAsBruteForceDoes) {
  const ObjectInput terrain = MakeTerrain(24, 8, {});
  const PreparedPoints points = MakePoints(37, 0.1f);
  for (const BvhPreset preset : {BvhPreset::kStatic, BvhPreset::kCompact}) {
    const IndexedGeometry scene = MakeScene({terrain}, Vec3d{}, BvhPresetOptions(preset));
    for (const bool directional : {false, true}) {
      const auto light = MakeLight(directional, {1, 2, 0.6f});
      const ShadowResult truth =
          Shadows(scene, points, points.size(), light, {.strategy = Strategy::kBruteForce});
      uint64_t lit = 0;
      for (const uint8_t bits : truth.lit_bits) lit += std::popcount(bits);
      EXPECT_GT(lit, points.size() / 10);
      EXPECT_LT(lit, points.size() - points.size() / 10);
      for (const int side : kPacketSides) {
        SCOPED_TRACE(testing::Message() << "side " << side << ", directional " << directional);
        const ShadowResult found = Shadows(scene, points, points.size(), light,
                                           {.strategy = Strategy::kPacket, .packet_side = side});
        EXPECT_EQ(found.stats.strategy, Strategy::kPacket);
        EXPECT_EQ(found.lit_bits, truth.lit_bits);
      }
    }
  }
}

// A roof darkens all points, its leaf one packet after another: the first alone has to look for it.
TEST(PacketPartsTest, BeginAtTheLeafThatDarkenedTheLast) {
  ObjectInput roof = {.vertices = {{-99, -99, 3}, {99, -99, 3}, {0, 99, 3}}, .indices = {0, 1, 2}};
  const IndexedGeometry scene = MakeScene({MakeTerrain(24, 8, {}), roof});
  const PreparedPoints points = MakePoints(37, 1.5f);
  for (const bool directional : {false, true}) {
    const auto light = MakeLight(directional, {4, 4, 9});
    for (const int side : kPacketSides) {
      SCOPED_TRACE(testing::Message() << "side " << side << ", directional " << directional);
      const QueryOptions options = {.strategy = Strategy::kPacket, .packet_side = side};
      const auto first = Shadows(scene, points, size_t{1} * side * side, light, options);
      const auto all = Shadows(scene, points, points.size(), light, options);
      EXPECT_GT(first.stats.nodes, 0u);
      EXPECT_EQ(all.stats.nodes, first.stats.nodes);
      EXPECT_EQ(all.lit_bits, std::vector<uint8_t>(all.lit_bits.size(), 0));
    }
  }
}

}  // namespace
}  // namespace sightline
