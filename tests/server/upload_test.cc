// SPDX-License-Identifier: Apache-2.0
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "gtest/gtest.h"
#include "server/base/error.h"
#include "server/points/point_upload.h"
#include "server/scenes/scene_upload.h"

namespace sightline {
namespace {

v1::CreateSceneRequest Header(uint32_t objects, uint64_t triangles, uint64_t vertices) {
  v1::CreateSceneRequest request;
  request.mutable_header()->set_scene_id("s");
  v1::UploadSource* upload = request.mutable_header()->mutable_upload();
  upload->set_object_count(objects);
  upload->set_triangle_count(triangles);
  upload->set_vertex_count(vertices);
  return request;
}

v1::CreateSceneRequest Object(uint64_t triangles, uint64_t vertices) {
  v1::CreateSceneRequest request;
  request.mutable_object()->set_triangle_count(triangles);
  request.mutable_object()->set_vertex_count(vertices);
  return request;
}

v1::CreateSceneRequest Chunk(size_t vertices, size_t triangles) {
  v1::CreateSceneRequest request;
  request.mutable_chunk()->set_vertices_f64(std::string(24 * vertices, '\0'));
  request.mutable_chunk()->set_indices(std::string(12 * triangles, '\0'));
  return request;
}

// What the upload says to these messages, its end included.
absl::Status Upload(const std::vector<v1::CreateSceneRequest>& messages,
                    const Limits& limits = {}) {
  SceneUpload upload(limits);
  for (const v1::CreateSceneRequest& message : messages) {
    if (absl::Status status = upload.Add(message); !status.ok()) {
      // Nothing is accepted after an error.
      EXPECT_EQ(upload.Add(message), status);
      EXPECT_FALSE(upload.Finish().ok());
      return status;
    }
  }
  return upload.Finish().status();
}

void ExpectReason(const absl::Status& status, absl::StatusCode code, v1::ErrorReason reason) {
  EXPECT_EQ(status.code(), code) << status;
  EXPECT_EQ(ReasonOf(status), reason) << status;
}

TEST(SceneUploadTest, TakesObjectsInPieces) {
  SceneUpload upload((Limits()));
  for (const auto& message :
       {Header(2, 3, 7), Object(1, 3), Chunk(2, 0), Chunk(1, 1), Object(2, 4), Chunk(4, 2)}) {
    ASSERT_TRUE(upload.Add(message).ok());
  }
  const absl::StatusOr<std::vector<ObjectInput>> objects = upload.Finish();
  ASSERT_TRUE(objects.ok()) << objects.status();
  ASSERT_EQ(objects->size(), 2u);
  EXPECT_EQ((*objects)[0].vertices.size(), 3u);
  EXPECT_EQ((*objects)[1].indices.size(), 6u);
}

TEST(SceneUploadTest, RefusesEveryWrongOrder) {
  const auto bad = absl::StatusCode::kInvalidArgument;
  const auto sequence = v1::ERROR_REASON_BAD_SEQUENCE;
  ExpectReason(Upload({}), bad, sequence);
  ExpectReason(Upload({v1::CreateSceneRequest()}), bad, sequence);
  ExpectReason(Upload({Object(1, 3)}), bad, sequence);
  ExpectReason(Upload({Header(1, 1, 3), Header(1, 1, 3)}), bad, sequence);
  ExpectReason(Upload({Header(1, 1, 3), Chunk(3, 1)}), bad, sequence);
  ExpectReason(Upload({Header(1, 1, 3)}), bad, sequence);
  ExpectReason(Upload({Header(1, 1, 3), Object(1, 3), Chunk(3, 0)}), bad, sequence);
  ExpectReason(Upload({Header(2, 2, 6), Object(1, 3), Object(1, 3)}), bad, sequence);
  ExpectReason(Upload({Header(1, 1, 3), Object(1, 3), Chunk(3, 1), Object(0, 0)}), bad, sequence);
  ExpectReason(Upload({Header(1, 1, 3), Object(2, 3)}), bad, sequence);
  ExpectReason(Upload({Header(1, 2, 3), Object(1, 3), Chunk(3, 1)}), bad, sequence);
}

TEST(SceneUploadTest, RefusesMoreThanWasAnnouncedBeforeKeepingIt) {
  const auto bad = absl::StatusCode::kInvalidArgument;
  ExpectReason(Upload({Header(1, 1, 3), Object(1, 3), Chunk(4, 0)}), bad,
               v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  ExpectReason(Upload({Header(1, 1, 3), Object(1, 3), Chunk(3, 2)}), bad,
               v1::ERROR_REASON_BAD_ARRAY_LENGTH);
}

TEST(SceneUploadTest, RefusesBrokenArrays) {
  const auto with = [](const std::function<void(v1::MeshChunk*)>& spoil) {
    v1::CreateSceneRequest chunk = Chunk(0, 0);
    spoil(chunk.mutable_chunk());
    return Upload({Header(1, 10, 10), Object(10, 10), chunk});
  };
  EXPECT_TRUE(absl::StrContains(
      with([](v1::MeshChunk* c) { c->set_vertices_f64(std::string(25, 'x')); }).message(),
      "vertices_f64 = 25 bytes"));
  EXPECT_TRUE(absl::StrContains(
      with([](v1::MeshChunk* c) { c->set_vertices_f32(std::string(13, 'x')); }).message(),
      "vertices_f32 = 13 bytes"));
  EXPECT_TRUE(absl::StrContains(
      with([](v1::MeshChunk* c) { c->set_indices(std::string(8, 'x')); }).message(),
      "indices = 8 bytes"));
  EXPECT_FALSE(with([](v1::MeshChunk* c) {
                 c->set_vertices_f32(std::string(12, 'x'));
                 c->set_vertices_f64(std::string(24, 'x'));
               }).ok());
}

TEST(SceneUploadTest, WidensFloats) {
  SceneUpload upload((Limits()));
  v1::CreateSceneRequest chunk = Chunk(0, 1);
  const float vertices[] = {1.5f, -2, 3, 0, 0, 0, 0, 1, 0};
  chunk.mutable_chunk()->set_vertices_f32(std::string(reinterpret_cast<const char*>(vertices), 36));
  for (const auto& message : {Header(1, 1, 3), Object(1, 3), chunk}) {
    ASSERT_TRUE(upload.Add(message).ok());
  }
  EXPECT_EQ((*upload.Finish())[0].vertices[0], (Vec3d{1.5, -2, 3}));
}

TEST(SceneUploadTest, LimitsAreCheckedBeforeAnythingArrives) {
  Limits limits;
  limits.max_triangles_per_scene = 100;
  limits.max_vertices_per_scene = 100;
  limits.max_objects_per_scene = 2;
  const auto over = absl::StatusCode::kResourceExhausted;
  const auto reason = v1::ERROR_REASON_LIMIT_EXCEEDED;
  ExpectReason(Upload({Header(1, 101, 3)}, limits), over, reason);
  ExpectReason(Upload({Header(1, 1, 101)}, limits), over, reason);
  ExpectReason(Upload({Header(3, 1, 3)}, limits), over, reason);
  ExpectReason(Upload({Header(1, 1, 3), Object(~uint64_t{0}, 3)}, limits), over, reason);
  EXPECT_TRUE(absl::StrContains(Upload({Header(1, 101, 3)}, limits).message(),
                                "max_triangles_per_scene = 100"));
}

TEST(SceneUploadTest, HeadersAreChecked) {
  const auto with = [](const std::function<void(v1::CreateSceneHeader*)>& spoil) {
    v1::CreateSceneRequest header = Header(1, 1, 3);
    spoil(header.mutable_header());
    return Upload({header});
  };
  using H = v1::CreateSceneHeader;
  EXPECT_TRUE(absl::StrContains(with([](H* h) { h->set_scene_id("A/b"); }).message(), "scene_id"));
  EXPECT_TRUE(
      absl::StrContains(with([](H* h) { h->mutable_origin()->set_x(1e300); }).message(), "origin"));
  EXPECT_TRUE(absl::StrContains(with([](H* h) { h->clear_source(); }).message(), "source"));
  EXPECT_TRUE(absl::StrContains(with([](H* h) { h->mutable_builtin(); }).message(), "spec"));
  EXPECT_TRUE(absl::StrContains(
      with([](H* h) { h->mutable_upload()->set_triangle_count(0); }).message(), "triangle_count"));
  EXPECT_TRUE(absl::StrContains(
      with([](H* h) { h->mutable_upload()->set_object_count(0); }).message(), "object_count"));
  EXPECT_TRUE(
      absl::StrContains(with([](H* h) { h->set_without_bvh(true); }).message(), "header.kd_tree"));
  ExpectReason(with([](H* h) { h->set_build_preset(static_cast<v1::BuildPreset>(9)); }),
               absl::StatusCode::kInvalidArgument, v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
}

TEST(SceneUploadTest, ObjectHeadersAreChecked) {
  const auto with = [](const std::function<void(v1::ObjectHeader*)>& spoil) {
    v1::CreateSceneRequest object = Object(1, 3);
    spoil(object.mutable_object());
    return Upload({Header(1, 1, 3), object, Chunk(3, 1)});
  };
  using H = v1::ObjectHeader;
  EXPECT_TRUE(with([](H*) {}).ok());
  EXPECT_FALSE(with([](H* h) { h->set_object_name(std::string(2000, 'x')); }).ok());
  EXPECT_TRUE(absl::StrContains(with([](H* h) { h->add_transform(1); }).message(), "1 numbers"));
  EXPECT_TRUE(absl::StrContains(with([](H* h) {
                                  constexpr double kInfinity =
                                      std::numeric_limits<double>::infinity();
                                  for (int i = 0; i < 12; ++i) {
                                    h->add_transform(i == 7 ? kInfinity : 0);
                                  }
                                }).message(),
                                "transform[7]"));
  ExpectReason(with([](H* h) { h->set_culling(static_cast<v1::Culling>(9)); }),
               absl::StatusCode::kInvalidArgument, v1::ERROR_REASON_UNKNOWN_ENUM_VALUE);
}

TEST(SceneEditUploadTest, TakesEveryKindOfEdit) {
  SceneEditUpload upload((Limits()));
  std::vector<v1::UpdateSceneRequest> messages(6);
  messages[0].mutable_header()->set_name("scenes/s");
  messages[1].mutable_remove_object()->set_object_name("a");
  messages[2].mutable_set_transform()->set_object_name("b");
  messages[3].mutable_replace_vertices()->set_object_name("c");
  messages[3].mutable_replace_vertices()->set_vertex_count(3);
  *messages[4].mutable_chunk() = Chunk(3, 0).chunk();
  messages[5].mutable_add_object()->set_object_name("d");
  for (const auto& message : messages) ASSERT_TRUE(upload.Add(message).ok());
  const absl::StatusOr<std::vector<SceneEdit>> edits = upload.Finish();
  ASSERT_TRUE(edits.ok()) << edits.status();
  ASSERT_EQ(edits->size(), 4u);
  EXPECT_EQ((*edits)[0].kind, SceneEdit::Kind::kRemove);
  EXPECT_EQ((*edits)[1].kind, SceneEdit::Kind::kSetTransform);
  EXPECT_EQ((*edits)[2].kind, SceneEdit::Kind::kSetVertices);
  EXPECT_EQ((*edits)[2].object.vertices.size(), 3u);
  EXPECT_EQ((*edits)[3].object.name, "d");
}

TEST(SceneEditUploadTest, RefusesNamesThatNoObjectCanHave) {
  const auto with = [](const std::function<void(v1::UpdateSceneRequest*)>& edit) {
    SceneEditUpload upload((Limits()));
    v1::UpdateSceneRequest header, message;
    header.mutable_header()->set_name("scenes/s");
    EXPECT_TRUE(upload.Add(header).ok());
    edit(&message);
    return upload.Add(message);
  };
  using R = v1::UpdateSceneRequest;
  for (const size_t bytes : {1024, 1025}) {
    const std::string name(bytes, 'x');
    const absl::Status statuses[] = {
        with([&](R* r) { r->mutable_add_object()->set_object_name(name); }),
        with([&](R* r) { r->mutable_replace_vertices()->set_object_name(name); }),
        with([&](R* r) { r->mutable_remove_object()->set_object_name(name); }),
        with([&](R* r) { r->mutable_set_transform()->set_object_name(name); })};
    for (const absl::Status& status : statuses) {
      EXPECT_EQ(status.ok(), bytes == 1024) << status;
      EXPECT_EQ(absl::StrContains(status.message(), "1025 bytes"), bytes > 1024) << status;
    }
  }
}

TEST(SceneEditUploadTest, RefusesWrongOrders) {
  SceneEditUpload empty((Limits()));
  EXPECT_EQ(ReasonOf(empty.Finish().status()), v1::ERROR_REASON_BAD_SEQUENCE);
  SceneEditUpload upload((Limits()));
  v1::UpdateSceneRequest message;
  message.mutable_header()->set_name("scenes/s");
  ASSERT_TRUE(upload.Add(message).ok());
  *message.mutable_chunk() = Chunk(3, 0).chunk();
  EXPECT_EQ(ReasonOf(upload.Add(message)), v1::ERROR_REASON_BAD_SEQUENCE);
  SceneEditUpload negative((Limits()));
  message.mutable_header()->set_name("scenes/s");
  message.mutable_header()->set_base_revision(-1);
  EXPECT_TRUE(absl::StrContains(negative.Add(message).message(), "base_revision = -1"));
}

TEST(PointUploadTest, CountsAreKept) {
  Limits limits;
  limits.max_points_per_set = 4;
  const auto run = [&](uint64_t announced, const std::vector<size_t>& chunks) -> absl::Status {
    PointUpload upload(limits);
    v1::CreatePointSetRequest message;
    message.mutable_header()->set_parent("scenes/s");
    message.mutable_header()->mutable_upload()->set_point_count(announced);
    if (absl::Status status = upload.Add(message); !status.ok()) return status;
    for (const size_t chunk : chunks) {
      message.mutable_chunk()->set_points(std::string(24 * chunk, '\0'));
      if (absl::Status status = upload.Add(message); !status.ok()) return status;
    }
    return upload.Finish().status();
  };
  EXPECT_TRUE(run(3, {1, 2}).ok());
  EXPECT_EQ(ReasonOf(run(3, {1, 3})), v1::ERROR_REASON_BAD_SEQUENCE);
  EXPECT_EQ(ReasonOf(run(3, {1})), v1::ERROR_REASON_BAD_SEQUENCE);
  EXPECT_EQ(run(0, {}).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(run(5, {}).code(), absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace sightline
