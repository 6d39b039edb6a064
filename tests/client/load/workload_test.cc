// SPDX-License-Identifier: Apache-2.0
#include "client/load/workload.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace sightline::load {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

WorkloadSpec Spec(Mix mix) {
  client::Camera camera{.width = 100, .height = 70};
  return {.scene = "scenes/x",
          .cameras = {camera, camera},
          .lights = {client::Light::Point({0, 0, 0}), client::Light::Point({1, 0, 0})},
          .mix = mix,
          .tile_size = 32,
          .points_per_item = 10,
          .segments_per_item = 3,
          .distinct_items = 7,
          .seed = 11};
}

const std::vector<double> kSurface = {0, 0, 0, 1, 1, 1, 2, 2, 2};

TEST(WorkloadTest, AMixIsReadAndMistakesAreNamed) {
  const absl::StatusOr<Mix> mix = ParseMix("tiles=5,segments=2.5");
  ASSERT_TRUE(mix.ok()) << mix.status();
  EXPECT_THAT(*mix, ElementsAre(5, 0, 2.5));
  for (const char* text :
       {"", "tiles", "tiles=", "tiles=-1", "tiles=x", "rays=1", "tiles=0", "tiles=1,tiles=2",
        "tiles=inf", "points=nan", "tiles=1e308,points=1e308"}) {
    const absl::StatusOr<Mix> bad = ParseMix(text);
    EXPECT_EQ(bad.status().code(), absl::StatusCode::kInvalidArgument) << text;
  }
}

TEST(WorkloadTest, TilesCoverEveryImageOnce) {
  const absl::StatusOr<Workload> workload = Workload::Make(Spec({1, 0, 0}), {});
  ASSERT_TRUE(workload.ok()) << workload.status();
  EXPECT_EQ(workload->ItemCount(Kind::kTiles), 2u * 4 * 3);
  EXPECT_EQ(workload->StreamCount(Kind::kTiles), 2u);
  EXPECT_EQ(workload->StreamCount(Kind::kPoints), 0u);
  std::vector<int> pixels(2 * 100 * 70);
  for (size_t i = 0; i < workload->ItemCount(Kind::kTiles); ++i) {
    const TileWork& tile = workload->tile(i);
    EXPECT_EQ(workload->StreamOf({Kind::kTiles, i}), tile.camera);
    EXPECT_EQ(workload->Rays({Kind::kTiles, i}), 3u * tile.rect.width * tile.rect.height);
    for (uint32_t y = tile.rect.y; y < tile.rect.y + tile.rect.height; ++y) {
      for (uint32_t x = tile.rect.x; x < tile.rect.x + tile.rect.width; ++x) {
        ++pixels[(tile.camera * 70 + y) * 100 + x];
      }
    }
  }
  EXPECT_EQ(pixels, std::vector<int>(pixels.size(), 1));
}

TEST(WorkloadTest, KindsComeByTheirWeightsAndItemsInTurn) {
  const absl::StatusOr<Workload> workload = Workload::Make(Spec({5, 3, 2}), kSurface);
  ASSERT_TRUE(workload.ok()) << workload.status();
  constexpr int kRequests = 100'000;
  std::array<int, kKinds> count{};
  std::array<std::set<size_t>, kKinds> items;
  for (uint64_t i = 0; i < kRequests; ++i) {
    const Work work = workload->Pick(i);
    ASSERT_LT(work.item, workload->ItemCount(work.kind));
    ++count[static_cast<size_t>(work.kind)];
    items[static_cast<size_t>(work.kind)].insert(work.item);
  }
  // Six standard deviations.
  const double bound = 6 * std::sqrt(0.25 * kRequests);
  EXPECT_NEAR(count[0], 0.5 * kRequests, bound);
  EXPECT_NEAR(count[1], 0.3 * kRequests, bound);
  EXPECT_NEAR(count[2], 0.2 * kRequests, bound);
  for (size_t i = 0; i < kKinds; ++i) {
    EXPECT_EQ(items[i].size(), workload->ItemCount(static_cast<Kind>(i))) << kKindNames[i];
  }
}

// A check of every eighth item must not be one of some connections alone.
TEST(WorkloadTest, EachConnectionGetsEveryItem) {
  for (const Mix mix : {Mix{1, 0, 0}, Mix{0, 1, 0}}) {
    const absl::StatusOr<Workload> workload = Workload::Make(Spec(mix), kSurface);
    ASSERT_TRUE(workload.ok()) << workload.status();
    for (const size_t connections : {1, 2, 3, 8}) {
      std::set<std::pair<size_t, size_t>> met;
      std::vector<int> loads(connections);
      const size_t items = workload->ItemCount(workload->Pick(0).kind);
      for (uint64_t i = 0; i < items * connections * connections; ++i) {
        const Request request{.number = i, .work = workload->Pick(i)};
        const size_t connection = workload->ConnectionOf(request, connections);
        ASSERT_LT(connection, connections);
        met.emplace(request.work.item, connection);
        // In turn: after each round all have had as many.
        ++loads[connection];
        if ((i + 1) % connections == 0) {
          ASSERT_EQ(loads, std::vector<int>(connections, loads[0])) << i;
        }
      }
      EXPECT_EQ(met.size(), items * connections) << connections;
    }
  }
}

TEST(WorkloadTest, AKindWithoutWeightIsNeverAsked) {
  const absl::StatusOr<Workload> workload = Workload::Make(Spec({1, 0, 1}), kSurface);
  ASSERT_TRUE(workload.ok());
  for (uint64_t i = 0; i < 10'000; ++i) EXPECT_NE(workload->Pick(i).kind, Kind::kPoints);
}

TEST(WorkloadTest, PointsAndSegmentsAreOnTheSurface) {
  const absl::StatusOr<Workload> workload = Workload::Make(Spec({0, 1, 1}), kSurface);
  ASSERT_TRUE(workload.ok());
  const std::span<const double> points = workload->shadow_query().points.positions;
  ASSERT_EQ(points.size(), 3u * 10 * 7);
  for (size_t i = 0; i < points.size(); i += 3) {
    EXPECT_TRUE(points[i] == 0 || points[i] == 1 || points[i] == 2);
    EXPECT_EQ(points[i], points[i + 2]);
  }
  EXPECT_EQ(workload->segment_query().segments.size(), 6u * 3 * 7);
  EXPECT_EQ(workload->Rays({Kind::kPoints, 0}), 20u);
  EXPECT_EQ(workload->Rays({Kind::kSegments, 0}), 3u);
  EXPECT_EQ(workload->Describe({Kind::kSegments, 2}), "segments 6 to 8");
}

TEST(WorkloadTest, AWorkloadThatWasMovedStillHasItsArrays) {
  absl::StatusOr<Workload> made = Workload::Make(Spec({0, 1, 1}), kSurface);
  ASSERT_TRUE(made.ok());
  const Workload workload = *std::move(made);
  const std::span<const double> points = workload.shadow_query().points.positions;
  EXPECT_TRUE(std::all_of(points.begin(), points.end(), [](double v) { return v <= 2; }));
  EXPECT_EQ(points.size(), 210u);
}

TEST(WorkloadTest, WhatCannotBeAskedIsAnError) {
  EXPECT_EQ(Workload::Make(Spec({0, 0, 0}), kSurface).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(Workload::Make(Spec({0, 1, 0}), {}).status().message()),
              HasSubstr("see nothing"));
  WorkloadSpec dark = Spec({0, 1, 0});
  dark.lights.clear();
  EXPECT_THAT(std::string(Workload::Make(dark, kSurface).status().message()), HasSubstr("--light"));
  WorkloadSpec blind = Spec({1, 0, 0});
  blind.cameras.clear();
  EXPECT_FALSE(Workload::Make(blind, kSurface).ok());
}

}  // namespace
}  // namespace sightline::load
