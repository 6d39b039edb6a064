// SPDX-License-Identifier: Apache-2.0
//
// The packets in which a real server asks a tile's lights: those of the whole tile.
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/query/tiles.h"
#include "gtest/gtest.h"
#include "tests/integration/server_harness.h"

namespace sightline {
namespace {

// Whatever is asked of the lights, and however the item is cut: packets from a light are those of
// the pixels' squares, which are the whole tile's.
TEST(ServedShadowPacketsTest, ArePixelsSquaresOfTheWholeTile) {
  ServerOptions options;
  options.limits.target_reply_bytes = 80'000;  // A row of squares with all that is asked for below.
  ServerHarness harness(options);
  v1::Scene made;
  ASSERT_TRUE(harness.CreateBuiltin("room", "builtin:room:15000", &made).ok());
  const std::shared_ptr<const Scene> scene = *harness.server->scenes().Pin("room", 0);
  const BuiltinView view = FirstView("room:15000");
  const Camera camera = ViewCamera(view, 96, 64);
  constexpr uint32_t kWidth = 96, kHeight = 61;
  constexpr TileRect kTile = {0, 0, kWidth, kHeight};
  constexpr size_t kPixels = size_t{kWidth} * kHeight, kRow = (kPixels + 7) / 8;
  std::vector<LightSample> samples;
  for (uint32_t i = 0; i < view.lights.size(); ++i) {
    ASSERT_TRUE(
        AppendSamples(Light::Point(view.lights[i]), i, scene->geometry.origin, &samples).ok());
  }
  const size_t lights = samples.size();
  const auto trace = [&](const QueryOptions& query) {
    TileResult tile;
    const absl::Status status =
        TraceTile(*scene, camera, kTile, samples, {.hits = true, .lit = true}, query, &tile);
    EXPECT_TRUE(status.ok()) << status;
    return tile;
  };
  const TileResult truth = trace({.strategy = Strategy::kBruteForce}),
                   packets = trace({.strategy = Strategy::kPacket, .pixel_shadow_packets = true});
  ASSERT_GT(packets.shadow.rays, truth.shadow.rays);
  for (const bool sums : {false, true}) {
    for (const bool blockers : {false, true}) {
      SCOPED_TRACE(absl::StrCat(sums, " ", blockers));
      v1::TraceTilesRequest request;
      v1::TraceTilesHeader* const header = request.mutable_header();
      header->mutable_stream()->set_scene("scenes/room");
      v1::QueryOptions* const asked = header->mutable_stream()->mutable_options();
      asked->set_strategy(v1::STRATEGY_PACKET);
      asked->set_pixel_shadow_packets(true);
      asked->set_statistics(true);
      EncodeTestCamera(camera, header->mutable_camera());
      for (const Vec3d light : view.lights) {
        EncodeTestVector(light, header->add_lights()->mutable_point()->mutable_position());
      }
      header->mutable_outputs()->set_hit_bits(true);
      v1::ShadowOutputs* const wanted = header->mutable_shadow_outputs();
      wanted->set_lit_bits(true);
      wanted->set_lit_counts(sums);
      wanted->set_weighted_sums(sums);
      wanted->set_first_blockers(blockers);
      TileStream stream(harness, request);
      stream.Write(TileRequest(1, 0, 0, kWidth, kHeight));
      const auto replies = stream.ReadAll();
      ASSERT_TRUE(stream.Finish().ok());
      const auto& parts = replies.at(1);
      if (blockers) {
        EXPECT_GT(parts.size(), 1u);
      }
      EXPECT_EQ(parts.back().reply().header().statistics().ray_count(),
                packets.primary.rays + packets.shadow.rays);
      // The rows of a field of each part, put together.
      const auto joined = [&](size_t rows, const std::string& (v1::ShadowResult::*field)() const) {
        std::map<uint64_t, std::string> by_offset;
        for (const auto& part : parts) {
          by_offset[part.reply().header().offset()] = (part.reply().shadows().*field)();
        }
        std::string all;
        for (size_t row = 0; row < rows; ++row) {
          for (const auto& [offset, bytes] : by_offset) {
            const size_t length = bytes.size() / rows;
            all += bytes.substr(row * length, length);
          }
        }
        return all;
      };
      EXPECT_EQ(joined(lights, &v1::ShadowResult::lit_bits), PackArray(truth.lit_bits));
      const auto lit = [&](size_t s, size_t i) {
        return (truth.lit_bits[s * kRow + i / 8] >> (i % 8) & 1) != 0;
      };
      const auto counts = UnpackArray<uint32_t>(joined(1, &v1::ShadowResult::lit_counts));
      const auto weights = UnpackArray<double>(joined(1, &v1::ShadowResult::weighted_sums));
      const auto by = UnpackArray<uint32_t>(joined(lights, &v1::ShadowResult::blocker_objects));
      ASSERT_EQ(counts.size(), sums ? kPixels : 0);
      ASSERT_EQ(weights.size(), sums ? kPixels : 0);
      ASSERT_EQ(by.size(), blockers ? lights * kPixels : 0);
      for (size_t i = 0; i < kPixels; ++i) {
        uint32_t reached = 0;
        for (size_t s = 0; s < lights; ++s) reached += lit(s, i);
        if (sums) {
          EXPECT_EQ(counts[i], reached) << i;
          EXPECT_EQ(weights[i], reached) << i;
        }
        const bool hit = (truth.hit_bits[i / 8] >> (i % 8) & 1) != 0;
        for (size_t s = 0; s < lights && blockers; ++s) {
          EXPECT_EQ(by[s * kPixels + i] == kNoTriangle, lit(s, i) || !hit) << i;
        }
      }
    }
  }
}

}  // namespace
}  // namespace sightline
