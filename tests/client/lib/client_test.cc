// SPDX-License-Identifier: Apache-2.0
#include "client/lib/client.h"

#include <cstring>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/client/lib/mock_connection.h"

namespace sightline::client {
namespace {

using ::testing::_;
using ::testing::HasSubstr;
using ::testing::NiceMock;
using ::testing::Return;

class ClientTest : public testing::Test {
 protected:
  ClientTest() {
    v1::Capabilities capabilities;
    v1::Limits* limits = capabilities.mutable_limits();
    limits->set_max_message_bytes(4096 + 512);
    limits->set_max_image_width(4096);
    limits->set_max_image_height(4096);
    limits->set_max_light_samples(16);
    limits->set_max_item_rays(1 << 20);
    ON_CALL(*mock_, GetCapabilities(_)).WillByDefault(Return(capabilities));
  }
  std::shared_ptr<NiceMock<MockConnection>> mock_ = std::make_shared<NiceMock<MockConnection>>();
  Client client_{mock_};
};

TEST_F(ClientTest, UploadsObjectsInChunksThatFit) {
  std::vector<double> vertices;
  std::vector<uint32_t> indices;
  for (uint32_t i = 0; i < 100; ++i) {
    vertices.insert(vertices.end(), {i + 0.5, i + 0.25, i + 0.125});
    indices.insert(indices.end(), {i, (i + 1) % 100, (i + 2) % 100});
  }
  SceneSource source;
  source.scene_id = "x";
  source.origin = Point3{1, 2, 3};
  source.build_preset = BuildPreset::kCompact;
  source.objects = {
      {.name = "a", .vertices = vertices, .indices = indices, .mask = 5},
      {.name = "b", .vertices = vertices, .indices = indices, .culling = Culling::kBack}};
  std::vector<v1::CreateSceneRequest> messages;
  EXPECT_CALL(*mock_, CreateScene(_, _))
      .WillOnce([&](const Upload<v1::CreateSceneRequest>& upload, const CallOptions&) {
        upload([&](const v1::CreateSceneRequest& m) {
          messages.push_back(m);
          return true;
        });
        v1::Scene scene;
        scene.set_name("scenes/x");
        scene.set_revision(1);
        scene.set_state(v1::SCENE_STATE_READY);
        return scene;
      });
  const absl::StatusOr<Scene> scene = client_.CreateScene(source);
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_EQ(scene->name, "scenes/x");
  EXPECT_EQ(scene->state, SceneState::kReady);
  ASSERT_FALSE(messages.empty());
  const v1::CreateSceneHeader& header = messages[0].header();
  EXPECT_EQ(header.scene_id(), "x");
  EXPECT_EQ(header.request_id().size(), 32u);
  EXPECT_EQ(header.origin().y(), 2);
  EXPECT_EQ(header.build_preset(), v1::BUILD_PRESET_COMPACT);
  EXPECT_EQ(header.upload().object_count(), 2u);
  EXPECT_EQ(header.upload().triangle_count(), 200u);
  EXPECT_EQ(header.upload().vertex_count(), 200u);
  std::vector<std::string> names, vertex_bytes, index_bytes;
  for (const v1::CreateSceneRequest& m : messages) {
    EXPECT_LE(m.ByteSizeLong(), 4096u + 512u);
    if (m.has_object()) {
      names.push_back(m.object().object_name());
      vertex_bytes.emplace_back();
      index_bytes.emplace_back();
      EXPECT_EQ(m.object().mask(), names.size() == 1 ? 5u : 0xFFFFFFFFu);
      EXPECT_EQ(m.object().culling(), names.size() == 1 ? v1::CULLING_NONE : v1::CULLING_BACK);
    }
    if (m.has_chunk()) {
      vertex_bytes.back() += m.chunk().vertices_f64();
      index_bytes.back() += m.chunk().indices();
    }
  }
  EXPECT_THAT(names, testing::ElementsAre("a", "b"));
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(vertex_bytes[i],
              std::string(reinterpret_cast<const char*>(vertices.data()), vertices.size() * 8));
    EXPECT_EQ(index_bytes[i],
              std::string(reinterpret_cast<const char*>(indices.data()), indices.size() * 4));
  }
}

TEST_F(ClientTest, RefusesSourcesThatAreNoneOrBoth) {
  EXPECT_EQ(client_.CreateScene({}).status().code(), absl::StatusCode::kInvalidArgument);
  const std::vector<double> odd = {1, 2};
  SceneSource source;
  source.objects = {{.name = "a", .vertices = odd}};
  EXPECT_THAT(std::string(client_.CreateScene(source).status().message()), HasSubstr("'a'"));
}

TEST_F(ClientTest, ListsAllPages) {
  EXPECT_CALL(*mock_, ListScenes(_, _))
      .WillOnce([](const v1::ListScenesRequest& request, const CallOptions&) {
        EXPECT_EQ(request.page_token(), "");
        v1::ListScenesResponse page;
        page.add_scenes()->set_name("scenes/a");
        page.set_next_page_token("more");
        return page;
      })
      .WillOnce([](const v1::ListScenesRequest& request, const CallOptions&) {
        EXPECT_EQ(request.page_token(), "more");
        v1::ListScenesResponse page;
        page.add_scenes()->set_name("scenes/b");
        return page;
      });
  const absl::StatusOr<std::vector<Scene>> scenes = client_.ListScenes();
  ASSERT_TRUE(scenes.ok());
  ASSERT_EQ(scenes->size(), 2u);
  EXPECT_EQ((*scenes)[1].name, "scenes/b");
}

TEST_F(ClientTest, AsksCapabilitiesOnce) {
  EXPECT_CALL(*mock_, GetCapabilities(_)).WillOnce(Return(v1::Capabilities()));
  const Client copy = client_;
  EXPECT_TRUE(client_.GetCapabilities().ok());
  EXPECT_TRUE(copy.GetCapabilities().ok());
}

TEST_F(ClientTest, SizesThatMakeNoImageAreNamed) {
  TileQuery query;
  query.scene = "scenes/x";
  query.camera.width = 0;
  query.camera.height = 10;
  const auto trace = [&] { return client_.TraceImage(query).status(); };
  EXPECT_EQ(trace().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(trace().message()), HasSubstr("0 × 10"));
  query.camera.width = 5000;
  EXPECT_EQ(trace().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(trace().message()), HasSubstr("max_image_width"));
  query.camera.width = 10;
  query.tile_size = 0;
  EXPECT_EQ(trace().code(), absl::StatusCode::kInvalidArgument);
  query.tile_size = 8;
  query.lights.resize(17);
  EXPECT_THAT(std::string(trace().message()), HasSubstr("max_light_samples"));
}

// What a server refused that was replaced since is asked of the one that is there.
TEST_F(ClientTest, LimitsThatRefuseAreAskedAnew) {
  int asked = 0;
  v1::Capabilities capabilities = mock_->GetCapabilities({}).value();
  EXPECT_CALL(*mock_, GetCapabilities(_)).WillRepeatedly([&](const CallOptions&) {
    ++asked;
    return capabilities;
  });
  TileQuery image;
  image.scene = "scenes/x";
  image.camera.width = 5000;
  image.camera.height = 10;
  EXPECT_THAT(std::string(client_.TraceImage(image).status().message()),
              HasSubstr("ask for a smaller image"));
  image.camera.width = 10;
  image.lights.resize(17);
  EXPECT_THAT(std::string(client_.TraceImage(image).status().message()), HasSubstr("fewer lights"));
  EXPECT_EQ(asked, 2);
  ON_CALL(*mock_, channel_count()).WillByDefault(Return(1));
  ShadowQuery shadows;  // Of no points: no stream is needed.
  shadows.scene = "scenes/x";
  shadows.lights.resize(17);
  shadows.options.revision = 1;
  EXPECT_THAT(std::string(client_.ComputeAllShadows(shadows).status().message()),
              HasSubstr("fewer lights"));
  EXPECT_EQ(asked, 3);
  capabilities.mutable_limits()->set_max_light_samples(17);
  EXPECT_TRUE(client_.ComputeAllShadows(shadows).ok());
  EXPECT_EQ(asked, 4);
}

TEST_F(ClientTest, ArraysOfTheWrongLengthAreNamed) {
  const std::vector<double> points = {1, 2, 3, 4, 5, 6}, normals = {0, 0, 1};
  ShadowQuery query;
  query.scene = "scenes/x";
  query.lights = {Light::Point({0, 0, 0})};
  query.points.positions = points;
  query.points.normals = normals;
  EXPECT_THAT(std::string(client_.ComputeAllShadows(query).status().message()),
              HasSubstr("points.normals"));
  EXPECT_CALL(*mock_, CreatePointSet(_, _)).Times(0);
  PointSetSource source{.scene = "scenes/x", .points = query.points};
  EXPECT_THAT(std::string(client_.CreatePointSet(source).status().message()),
              HasSubstr("points.normals has 3 numbers; 2 points need 6"));
  const std::vector<uint32_t> objects = {0};
  source.points = {.positions = points, .source_objects = objects, .source_triangles = objects};
  EXPECT_THAT(std::string(client_.CreatePointSet(source).status().message()),
              HasSubstr("points.source_objects"));
  source.points = {.positions = std::span(points).first(4)};
  EXPECT_THAT(std::string(client_.CreatePointSet(source).status().message()),
              HasSubstr("points.positions has 4 numbers"));
  query.points.normals = {};
  query.lights.clear();
  EXPECT_THAT(std::string(client_.ComputeAllShadows(query).status().message()),
              HasSubstr("lights"));
}

}  // namespace
}  // namespace sightline::client
