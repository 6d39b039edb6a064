// SPDX-License-Identifier: Apache-2.0
//
// Edits through the client library and a real server: each makes a revision, and queries see it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "tests/integration/client/served_client.h"

namespace sightline {
namespace {

using ::testing::ElementsAre;

class ClientEditsTest : public testing_support::ServedClientTest {
 protected:
  // Vertical segments through the middles of three places side by side.
  std::vector<uint8_t> Blocked(int64_t revision = 0) {
    const std::vector<double> ends = {0,  0.25, -5, 0,  0.25, 5,  10, 0.25, -5,
                                      10, 0.25, 5,  20, 0.25, -5, 20, 0.25, 5};
    const auto segments = client().TestAllSegments(
        {.scene = "scenes/yard", .segments = ends, .options = {.revision = revision}});
    EXPECT_TRUE(segments.ok()) << segments.status();
    return segments.ok() ? segments->blocked : std::vector<uint8_t>{};
  }
};

TEST_F(ClientEditsTest, EveryKindOfEditMakesARevisionThatAnswersSee) {
  const std::vector<double> home = SquareVertices(0, 0), away = SquareVertices(10, 0);
  const auto scene = client().CreateScene(
      {.scene_id = "yard",
       .objects = {{.name = "lid", .vertices = home, .indices = kSquareIndices, .dynamic = true}}});
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->revision, 1);
  EXPECT_THAT(Blocked(), ElementsAre(1, 0, 0));

  using Kind = client::SceneEdit::Kind;
  auto edited = client().UpdateScene(
      scene->name, {{.kind = Kind::kAdd,
                     .object = {.name = "second", .vertices = away, .indices = kSquareIndices}}});
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ(edited->revision, 2);
  EXPECT_EQ(edited->triangles, 4u);
  EXPECT_THAT(Blocked(), ElementsAre(1, 1, 0));

  const std::array<double, 12> moved = {1, 0, 0, 20, 0, 1, 0, 0, 0, 0, 1, 0};
  edited = client().UpdateScene(
      scene->name, {{.kind = Kind::kSetTransform, .object = {.name = "lid", .transform = moved}}},
      2);
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_THAT(Blocked(), ElementsAre(0, 1, 1));

  edited = client().UpdateScene(scene->name, {{.kind = Kind::kReplaceVertices,
                                               .object = {.name = "second", .vertices = home}}});
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_THAT(Blocked(), ElementsAre(1, 0, 1));

  edited = client().UpdateScene(scene->name, {{.kind = Kind::kRemove, .object = {.name = "lid"}}});
  ASSERT_TRUE(edited.ok()) << edited.status();
  EXPECT_EQ(edited->revision, 5);
  EXPECT_THAT(Blocked(), ElementsAre(1, 0, 0));

  const auto objects = client().ListSceneObjects(scene->name);
  ASSERT_TRUE(objects.ok()) << objects.status();
  ASSERT_EQ(objects->size(), 1u);
  EXPECT_EQ((*objects)[0].name, "second");
}

TEST_F(ClientEditsTest, AnEditThatFailsLeavesTheRevisionServing) {
  const std::vector<double> home = SquareVertices(0, 0);
  const auto scene = client().CreateScene(
      {.scene_id = "yard",
       .objects = {{.name = "lid", .vertices = home, .indices = kSquareIndices}}});
  ASSERT_TRUE(scene.ok()) << scene.status();
  using Kind = client::SceneEdit::Kind;
  const std::array<double, 12> moved = {1, 0, 0, 20, 0, 1, 0, 0, 0, 0, 1, 0};
  // Not dynamic; no such object; a base revision that is not the latest.
  EXPECT_EQ(client()
                .UpdateScene(scene->name, {{.kind = Kind::kSetTransform,
                                            .object = {.name = "lid", .transform = moved}}})
                .status()
                .code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(client()
                .UpdateScene(scene->name, {{.kind = Kind::kRemove, .object = {.name = "roof"}}})
                .status()
                .code(),
            absl::StatusCode::kNotFound);
  EXPECT_EQ(client()
                .UpdateScene(scene->name, {{.kind = Kind::kRemove, .object = {.name = "lid"}}}, 7)
                .status()
                .code(),
            absl::StatusCode::kFailedPrecondition);
  EXPECT_THAT(Blocked(), ElementsAre(1, 0, 0));
  const auto now = client().GetScene(scene->name);
  ASSERT_TRUE(now.ok()) << now.status();
  EXPECT_EQ(now->revision, 1);
}

TEST_F(ClientEditsTest, AWatcherSeesTheSceneBecomeReady) {
  const auto scene = client().CreateScene({.scene_id = "boxes", .builtin = "builtin:box"});
  ASSERT_TRUE(scene.ok()) << scene.status();
  std::vector<client::SceneState> states;
  const absl::Status watched = client().WatchScene(
      scene->name, /*wait_for_scene=*/false, [&](const client::SceneProgress& progress) {
        states.push_back(progress.scene.state);
        return progress.scene.state != client::SceneState::kReady;
      });
  EXPECT_TRUE(watched.ok()) << watched;
  ASSERT_FALSE(states.empty());
  EXPECT_EQ(states.back(), client::SceneState::kReady);
}

}  // namespace
}  // namespace sightline
