// SPDX-License-Identifier: Apache-2.0
#include "client/import/scene_wire.h"

#include "gtest/gtest.h"
#include "tests/client/import/import_testing.h"

namespace sightline {
namespace {

ImportedScene Scene() {
  ImportedScene scene;
  scene.report.format = "assimp x";
  scene.report.polygons = 3;
  scene.report.faces_bad_index = 2;
  ObjectInput object{
      .name = "box", .vertices = {{1, 2, 3}, {4, 5, 6}, {7, 8, 447422.999}}, .indices = {0, 1, 2}};
  object.transform.m[3] = 5;
  scene.objects = {object, object};
  return scene;
}

TEST(SceneWireTest, GivesBackWhatWentIn) {
  const ImportedScene scene = Scene();
  const absl::StatusOr<ImportedScene> back = DecodeScene(EncodeScene(scene));
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_TRUE(import_testing::SameBits(*back, scene));
}

TEST(SceneWireTest, RefusesEveryTruncation) {
  const std::string bytes = EncodeScene(Scene());
  for (size_t size = 0; size < bytes.size(); ++size) {
    ASSERT_EQ(DecodeScene(bytes.substr(0, size)).status().code(), absl::StatusCode::kDataLoss)
        << size;
  }
  EXPECT_FALSE(DecodeScene(bytes + "x").ok());
}

TEST(SceneWireTest, RefusesIndicesOutOfRange) {
  ImportedScene scene = Scene();
  scene.objects[1].indices[2] = 3;
  EXPECT_FALSE(DecodeScene(EncodeScene(scene)).ok());
  scene = Scene();
  scene.objects[1].indices.pop_back();
  EXPECT_FALSE(DecodeScene(EncodeScene(scene)).ok());
}

}  // namespace
}  // namespace sightline
