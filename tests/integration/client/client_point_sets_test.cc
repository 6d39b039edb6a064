// SPDX-License-Identifier: Apache-2.0
//
// Points kept on a real server: the same answers as points sent along, and as the tiles they came
// from.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

#include "client/lib/relighting.h"
#include "tests/integration/client/served_client.h"

namespace sightline {
namespace {

class ClientPointSetsTest : public testing_support::ServedClientTest {};

client::Camera BoxCamera() {
  // The built-in box is z up and two metres wide, open to the side that y falls to.
  return {.eye = {0, -3.6, 1},
          .right = {1, 0, 0},
          .up = {0, 0, 1},
          .forward = {0, 1, 0},
          .tan_half_fov_y = 0.4,
          .width = 61,
          .height = 47};
}

// Many points with several lights are sent along a curve; their answers come back in their places.
TEST_F(ClientPointSetsTest, ManyPointsGetTheirOwnAnswers) {
  const auto scene = client().CreateScene({.scene_id = "many", .builtin = "builtin:box"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  const auto& [lo, hi] = *scene->bounds;
  constexpr int kPoints = 20'000;
  std::vector<double> positions;
  for (int i = 0; i < kPoints; ++i) {
    for (int k = 0; k < 3; ++k) {
      const double share = ((i * (2 * k + 7919) + 3) % 10'007) / 10'007.0;
      positions.push_back(lo[k] + share * (hi[k] - lo[k]));
    }
  }
  positions[3 * 1234 + 1] = std::numeric_limits<double>::infinity();
  client::ShadowQuery query{.scene = scene->name};
  for (double x : {0.2, 0.4, 0.6, 0.8}) {
    query.lights.push_back(client::Light::Point(
        {lo[0] + x * (hi[0] - lo[0]), (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2}));
  }
  query.outputs = {.lit = true, .counts = true, .weighted_sums = true, .blockers = true};
  query.points.positions = positions;
  const auto curved = client().ComputeAllShadows(query);
  ASSERT_TRUE(curved.ok()) << curved.status();
  const std::vector<client::Light> lights = query.lights;
  // One light alone does not pay for the curve.
  for (size_t s = 0; s < lights.size(); ++s) {
    query.lights = {lights[s]};
    const auto plain = client().ComputeAllShadows(query);
    ASSERT_TRUE(plain.ok()) << plain.status();
    for (size_t i = 0; i < kPoints; ++i) {
      ASSERT_EQ(curved->lit[s * kPoints + i], plain->lit[i]) << i;
      ASSERT_EQ(curved->blocker_triangle[s * kPoints + i], plain->blocker_triangle[i]) << i;
      ASSERT_EQ(curved->blocker_distance[s * kPoints + i], plain->blocker_distance[i]) << i;
    }
    EXPECT_EQ(curved->valid, plain->valid);
  }
  EXPECT_EQ(curved->valid[1234], 0);
  EXPECT_EQ(curved->lit[1234], 255);
  for (size_t i = 0; i < kPoints; ++i) {
    uint32_t lit = 0;
    for (size_t s = 0; s < lights.size(); ++s) lit += curved->lit[s * kPoints + i] == 1;
    ASSERT_EQ(curved->counts[i], lit) << i;
    ASSERT_EQ(curved->weighted_sums[i], lit) << i;
  }
}

TEST_F(ClientPointSetsTest, AStoredSetIsAnsweredLikePointsSentAlong) {
  const auto scene = client().CreateScene({.scene_id = "boxes", .builtin = "builtin:box"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  ASSERT_TRUE(scene->bounds.has_value());
  const auto& [lo, hi] = *scene->bounds;
  std::vector<double> positions;
  for (int i = 0; i < 500; ++i) {
    for (int k = 0; k < 3; ++k) {
      const double share = ((i * (2 * k + 7) + 3) % 101) / 101.0;
      positions.push_back(lo[k] + share * (hi[k] - lo[k]));
    }
  }
  positions[3 * 17] = std::numeric_limits<double>::quiet_NaN();
  const std::vector<client::Light> lights = {
      client::Light::Point({(lo[0] + hi[0]) / 2, (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2}),
      client::Light::Directional({0.3, -0.9, 0.2})};

  client::ShadowQuery query{.scene = scene->name, .lights = lights};
  query.outputs.counts = true;
  query.points.positions = positions;
  const auto along = client().ComputeAllShadows(query);
  ASSERT_TRUE(along.ok()) << along.status();

  client::PointSetSource source{.scene = scene->name, .point_set_id = "grid"};
  source.points.positions = positions;
  const auto set = client().CreatePointSet(source);
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_EQ(set->points, 500u);
  EXPECT_EQ(set->invalid_points, 1u);
  query.points = {};
  query.point_set = set->name;
  const auto stored = client().ComputeAllShadows(query);
  ASSERT_TRUE(stored.ok()) << stored.status();
  EXPECT_EQ(stored->lit, along->lit);
  EXPECT_EQ(stored->counts, along->counts);
  EXPECT_EQ(stored->lit[17], 255);
  EXPECT_EQ(std::count(along->lit.begin(), along->lit.end(), 255), 2);

  const auto renewed = client().RenewLease(set->name, absl::Minutes(30));
  ASSERT_TRUE(renewed.ok()) << renewed.status();
  EXPECT_GT(renewed->expire_time, set->expire_time);
  EXPECT_TRUE(client().DeletePointSet(set->name).ok());
  EXPECT_EQ(client().ComputeAllShadows(query).status().code(), absl::StatusCode::kNotFound);
}

TEST_F(ClientPointSetsTest, ACamerasHitsKeptForRelightingGiveTheTilesShadows) {
  const auto scene = client().CreateScene({.scene_id = "boxes", .builtin = "builtin:box"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  const std::vector<client::Light> lights = {client::Light::Point({-0.3, -0.5, 1.6}),
                                             client::Light::Point({0.082, -0.02, 1.986})};
  client::TileQuery tiles{.scene = scene->name, .camera = BoxCamera(), .lights = lights};
  tiles.outputs = {.hits = true, .lit = true};
  tiles.tile_size = 16;
  const auto image = client().TraceImage(tiles);
  ASSERT_TRUE(image.ok()) << image.status();
  for (const uint8_t value : {0, 1, 255}) {  // The picture has something of each.
    EXPECT_GT(std::count(image->lit.begin(), image->lit.end(), value), 20) << int{value};
  }

  const auto set = client().CreatePointSet({.scene = scene->name, .camera = BoxCamera()});
  ASSERT_TRUE(set.ok()) << set.status();
  EXPECT_EQ(set->points, image->hit.size());
  EXPECT_EQ(set->invalid_points,
            static_cast<uint64_t>(std::count(image->hit.begin(), image->hit.end(), 0)));
  const auto relit =
      client().ComputeAllShadows({.scene = scene->name, .lights = lights, .point_set = set->name});
  ASSERT_TRUE(relit.ok()) << relit.status();
  EXPECT_EQ(relit->lit, image->lit);
}

// A light that moves is asked about alone; what is kept of the others stands for them.
TEST_F(ClientPointSetsTest, ARelitPictureIsTheOneTracedFromTheStart) {
  const auto scene = client().CreateScene({.scene_id = "boxes", .builtin = "builtin:box"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  client::Light first = client::Light::Point({-0.3, -0.5, 1.6});
  first.weight = 0.3;
  const client::Light lamp = {.kind = client::Light::Kind::kRectangle,
                              .position = {0, 0, 1.9},
                              .half_u = {0.2, 0, 0},
                              .half_v = {0, 0.2, 0},
                              .samples = 4};
  auto made = client::Relighting::Make(
      client(), {.scene = scene->name, .camera = BoxCamera(), .lights = {first, lamp, first}});
  ASSERT_TRUE(made.ok()) << made.status();
  client::Relighting& picture = **made;
  const auto expect_traced = [&] {
    client::TileQuery tiles{.scene = scene->name, .camera = BoxCamera()};
    tiles.lights = picture.lights();
    tiles.outputs = {.hits = true, .lit = true};
    const auto image = client().TraceImage(tiles);
    ASSERT_TRUE(image.ok()) << image.status();
    const size_t n = image->hit.size();
    // The others in order, the chosen light last.
    std::vector<double> base(n), color;
    std::vector<uint8_t> lit;
    for (uint32_t k = 0; k < picture.lights().size(); ++k) {
      lit.insert(lit.end(), picture.lit(k).begin(), picture.lit(k).end());
    }
    EXPECT_EQ(lit, image->lit);
    const size_t rows[] = {0, 1, 5, 6};  // Of samples, by light.
    const auto add = [&](uint32_t k, std::vector<double>* sums) {
      const double share = picture.lights()[k].weight / static_cast<double>(rows[k + 1] - rows[k]);
      for (size_t row = rows[k]; row < rows[k + 1]; ++row) {
        for (size_t i = 0; i < n; ++i) {
          if (image->lit[row * n + i] == 1) (*sums)[i] += share;
        }
      }
    };
    for (uint32_t k = 0; k < 3; ++k) {
      if (k != picture.chosen()) add(k, &base);
    }
    EXPECT_EQ(picture.base(), base);
    color = base;
    add(picture.chosen(), &color);
    EXPECT_EQ(picture.color(), color);
    EXPECT_NE(picture.color(), picture.base());
  };
  EXPECT_EQ(picture.chosen(), 2u);
  expect_traced();
  const std::vector<double> before = picture.color();
  ASSERT_TRUE(picture.Move(client::Light::Point({0.4, -0.4, 0.9})).ok());
  EXPECT_NE(picture.color(), before);
  expect_traced();
  ASSERT_TRUE(picture.Choose(1).ok());
  expect_traced();
  client::Light moved = lamp;
  moved.position[0] = 0.5;
  ASSERT_TRUE(picture.Move(moved).ok());
  expect_traced();
  EXPECT_EQ(picture.Choose(3).code(), absl::StatusCode::kInvalidArgument);
  // The set is the server's until the picture goes.
  EXPECT_EQ(client().ListPointSets(scene->name)->size(), 1u);
  made->reset();
  EXPECT_TRUE(client().ListPointSets(scene->name)->empty());
  EXPECT_EQ(client::Relighting::Make(client(), {.scene = scene->name, .camera = BoxCamera()})
                .status()
                .code(),
            absl::StatusCode::kInvalidArgument);
}

TEST_F(ClientPointSetsTest, ARelitPictureThatCannotBeAskedStaysAsItWas) {
  const auto scene = client().CreateScene({.scene_id = "boxes", .builtin = "builtin:box"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  const auto picture =
      client::Relighting::Make(client(), {.scene = scene->name,
                                          .camera = BoxCamera(),
                                          .lights = {client::Light::Point({-0.3, -0.5, 1.6})}});
  ASSERT_TRUE(picture.ok()) << picture.status();
  const std::vector<double> before = (*picture)->color();
  ASSERT_TRUE(client().DeleteScene(scene->name).ok());  // Its point sets go with it.
  EXPECT_EQ((*picture)->Move(client::Light::Point({0.4, -0.4, 0.9})).code(),
            absl::StatusCode::kNotFound);
  EXPECT_EQ((*picture)->color(), before);
  EXPECT_EQ((*picture)->lights()[0].position[0], -0.3);
}

}  // namespace
}  // namespace sightline
