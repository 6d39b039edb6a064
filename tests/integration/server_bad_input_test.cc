// SPDX-License-Identifier: Apache-2.0
//
// Bad input gets a clear error, and the server serves on.
#include <cmath>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "tests/integration/server_harness.h"

namespace sightline {
namespace {

class BadInputTest : public testing::Test {
 protected:
  static ServerOptions Small() {
    ServerOptions options;
    options.limits.max_item_rays = 100'000;
    options.limits.max_image_width = 2000;
    options.limits.max_lights = 3;
    options.limits.max_message_bytes = 1 << 20;
    return options;
  }
  void SetUp() override {
    v1::Scene scene;
    const grpc::Status status = harness_.CreateScene(WallUpload("wall"), &scene);
    ASSERT_TRUE(status.ok()) << status.error_message();
    camera_ = *LookAt({0, -3, 0}, {0, 0, 0}, {0, 0, 1}, 60, 64, 64);
  }
  // Whatever went wrong, the next one is answered.
  void TearDown() override {
    TileStream stream(harness_, Header());
    stream.Write(TileRequest(1, 0, 0, 64, 64));
    const auto replies = stream.ReadAll();
    ASSERT_TRUE(stream.Finish().ok());
    EXPECT_EQ(replies.at(1).at(0).reply().header().status().code(), 0);
    EXPECT_EQ(harness_.server->queued_rays(), 0u);
  }

  v1::TraceTilesRequest Header() const {
    v1::TraceTilesRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
    EncodeTestCamera(camera_, request.mutable_header()->mutable_camera());
    return request;
  }
  // The error of a stream whose header was spoiled.
  grpc::Status HeaderError(const std::function<void(v1::TraceTilesHeader*)>& spoil) {
    v1::TraceTilesRequest header = Header();
    spoil(header.mutable_header());
    TileStream stream(harness_, header);
    stream.ReadAll();
    return stream.Finish();
  }
  // The item status of a tile; the stream itself ends well.
  v1::ItemStatus TileError(uint32_t x, uint32_t y, uint32_t width, uint32_t height) {
    TileStream stream(harness_, Header());
    stream.Write(TileRequest(7, x, y, width, height));
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    EXPECT_EQ(replies.count(7), 1u);
    const v1::TileReply& reply = replies.at(7).at(0).reply();
    EXPECT_EQ(reply.header().element_count(), 0u);
    EXPECT_TRUE(reply.tile().hit_bits().empty());
    return reply.header().status();
  }
  v1::ItemStatus ShadowError(const std::function<void(v1::ShadowItem*)>& make) {
    v1::ComputeShadowsRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
    request.mutable_header()->add_lights()->mutable_point();
    ShadowStream stream(harness_, request);
    request.Clear();
    make(request.mutable_item());
    stream.Write(request);
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    const v1::ShadowReply& reply = replies.at(0).at(0).reply();
    EXPECT_TRUE(reply.shadows().lit_bits().empty());
    return reply.header().status();
  }

  ServerHarness harness_{Small()};
  Camera camera_;
};

void ExpectError(const grpc::Status& status, grpc::StatusCode code, const std::string& reason,
                 const std::string& named) {
  EXPECT_EQ(status.error_code(), code) << status.error_message();
  EXPECT_EQ(ReasonIn(status), reason) << status.error_message();
  EXPECT_TRUE(absl::StrContains(status.error_message(), named)) << status.error_message();
}

void ExpectItemError(const v1::ItemStatus& status, grpc::StatusCode code, v1::ErrorReason reason,
                     const std::string& named) {
  EXPECT_EQ(status.code(), code) << status.message();
  EXPECT_EQ(status.reason(), reason) << status.message();
  EXPECT_TRUE(absl::StrContains(status.message(), named)) << status.message();
}

constexpr auto kInvalid = grpc::StatusCode::INVALID_ARGUMENT;
constexpr auto kOver = grpc::StatusCode::RESOURCE_EXHAUSTED;

TEST_F(BadInputTest, Headers) {
  using H = v1::TraceTilesHeader;
  ExpectError(HeaderError([](H* h) { h->mutable_stream()->set_scene("scenes/none"); }),
              grpc::StatusCode::NOT_FOUND, "SCENE_NOT_FOUND", "scenes/none");
  ExpectError(HeaderError([](H* h) { h->mutable_stream()->set_scene("wall"); }), kInvalid,
              "INVALID_FIELD", "scene = wall");
  ExpectError(HeaderError([](H* h) { h->mutable_stream()->set_revision(5); }),
              grpc::StatusCode::FAILED_PRECONDITION, "REVISION_MISMATCH", "5");
  ExpectError(HeaderError([](H* h) { h->mutable_stream()->set_revision(-5); }), kInvalid,
              "INVALID_FIELD", "revision = -5");
  ExpectError(HeaderError([](H* h) { h->mutable_stream()->set_result_credit_rays(-1); }), kInvalid,
              "INVALID_FIELD", "result_credit_rays = -1");
  ExpectError(HeaderError([](H* h) {
                h->mutable_stream()->mutable_options()->set_strategy(v1::STRATEGY_RTT);
              }),
              grpc::StatusCode::FAILED_PRECONDITION, "STRUCTURE_UNAVAILABLE", "kd-tree");
  ExpectError(HeaderError([](H* h) {
                h->mutable_stream()->mutable_options()->set_structure(v1::STRUCTURE_KD_TREE);
              }),
              grpc::StatusCode::FAILED_PRECONDITION, "STRUCTURE_UNAVAILABLE", "kd-tree");
  ExpectError(HeaderError([](H* h) {
                h->mutable_stream()->mutable_options()->set_strategy(static_cast<v1::Strategy>(77));
              }),
              kInvalid, "UNKNOWN_ENUM_VALUE", "77");
  ExpectError(HeaderError([](H* h) { h->clear_camera(); }), kInvalid, "INVALID_FIELD", "camera");
  ExpectError(HeaderError([](H* h) { h->mutable_camera()->set_width(0); }), kInvalid,
              "INVALID_FIELD", "camera.width = 0");
  ExpectError(HeaderError([](H* h) { h->mutable_camera()->set_width(2001); }), kOver,
              "LIMIT_EXCEEDED", "max_image_width = 2000");
  ExpectError(HeaderError([](H* h) { h->mutable_camera()->set_tan_half_fov_y(0); }), kInvalid,
              "INVALID_FIELD", "tan_half_fov_y");
  // A camera with eye = at: its basis has no direction.
  ExpectError(HeaderError([](H* h) { h->mutable_camera()->mutable_forward()->Clear(); }), kInvalid,
              "INVALID_FIELD", "forward");
  ExpectError(HeaderError([](H* h) { h->add_lights(); }), kInvalid, "INVALID_FIELD", "lights[0]");
  ExpectError(HeaderError([](H* h) {
                for (int i = 0; i < 4; ++i) h->add_lights()->mutable_point();
              }),
              kOver, "LIMIT_EXCEEDED", "max_lights = 3");
  ExpectError(HeaderError([](H* h) {
                v1::Light* light = h->add_lights();
                light->mutable_point();
                light->mutable_source()->set_triangle(2);
              }),
              kInvalid, "INVALID_FIELD", "lights[0].source.triangle = 2");
}

TEST_F(BadInputTest, Tiles) {
  ExpectItemError(TileError(0, 0, 65, 1), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "item.width = 65");
  ExpectItemError(TileError(0, 60, 1, 5), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "item.height = 5");
  ExpectItemError(TileError(0, 0, 0, 5), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "item.width = 0");
  ExpectItemError(TileError(0xFFFFFFFF, 0, 1, 1), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "item.width");
  ExpectItemError(TileError(0, 0, 0xFFFFFFFF, 0xFFFFFFFF), kOver, v1::ERROR_REASON_LIMIT_EXCEEDED,
                  "max_item_rays = 100000");
}

TEST_F(BadInputTest, Points) {
  ExpectItemError(ShadowError([](v1::ShadowItem*) {}), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "item.source");
  ExpectItemError(ShadowError([](v1::ShadowItem* i) { i->mutable_points(); }), kInvalid,
                  v1::ERROR_REASON_BAD_ARRAY_LENGTH, "item.points");
  ExpectItemError(
      ShadowError([](v1::ShadowItem* i) { i->mutable_points()->set_points(std::string(25, 'x')); }),
      kInvalid, v1::ERROR_REASON_BAD_ARRAY_LENGTH, "25 bytes");
  ExpectItemError(ShadowError([](v1::ShadowItem* i) {
                    i->mutable_points()->set_points(std::string(48, '\0'));
                    i->mutable_points()->set_source_objects(std::string(4, '\0'));
                    i->mutable_points()->set_source_triangles(std::string(4, '\0'));
                  }),
                  kInvalid, v1::ERROR_REASON_BAD_ARRAY_LENGTH, "source_objects");
  ExpectItemError(ShadowError([](v1::ShadowItem* i) {
                    i->mutable_points()->set_points(std::string(24, '\0'));
                    i->mutable_points()->set_source_objects(std::string("\7\0\0\0", 4));
                    i->mutable_points()->set_source_triangles(std::string(4, '\0'));
                  }),
                  kInvalid, v1::ERROR_REASON_INVALID_FIELD, "object = 7");
  ExpectItemError(ShadowError([](v1::ShadowItem* i) {
                    i->mutable_point_set_range()->set_point_set("scenes/wall/pointSets/none");
                    i->mutable_point_set_range()->set_count(1);
                  }),
                  grpc::StatusCode::NOT_FOUND, v1::ERROR_REASON_POINT_SET_NOT_FOUND,
                  "scenes/wall/pointSets/none");
  ExpectItemError(ShadowError([](v1::ShadowItem* i) {
                    i->mutable_point_set_range()->set_point_set("scenes/other/pointSets/a");
                    i->mutable_point_set_range()->set_count(1);
                  }),
                  kInvalid, v1::ERROR_REASON_INVALID_FIELD, "scenes/other");
  ExpectItemError(ShadowError([](v1::ShadowItem* i) {
                    i->mutable_point_set_range()->set_point_set("scenes/wall/pointSets/none");
                    i->mutable_point_set_range()->set_count(~uint64_t{0});
                  }),
                  kOver, v1::ERROR_REASON_LIMIT_EXCEEDED, "max_item_rays");
}

TEST_F(BadInputTest, NonFinitePointsAreInvalidAndTheRestIsAnswered) {
  v1::TestSegmentsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
  SegmentStream stream(harness_, request);
  request.Clear();
  request.mutable_item()->set_segments(
      PackArray<double>({0, -1, 0, 0, 1, NAN, 0.3, -1, 0.1, 0.3, 1, 0.1}));
  stream.Write(request);
  request.mutable_item()->mutable_item()->set_item_id(1);
  request.mutable_item()->set_segments(std::string(47, 'x'));
  stream.Write(request);
  request.mutable_item()->mutable_item()->set_item_id(2);
  request.mutable_item()->clear_segments();
  stream.Write(request);
  const auto replies = stream.ReadAll();
  EXPECT_TRUE(stream.Finish().ok());
  EXPECT_EQ(replies.at(0).at(0).reply().segments().blocked_bits(), std::string(1, 2));
  EXPECT_EQ(replies.at(0).at(0).reply().segments().valid_bits(), std::string(1, 2));
  for (const uint64_t id : {1, 2}) {
    ExpectItemError(replies.at(id).at(0).reply().header().status(), kInvalid,
                    v1::ERROR_REASON_BAD_ARRAY_LENGTH, "item.segments");
  }
}

// Segments in their stored form say what they are relative to, and are judged as the others.
TEST_F(BadInputTest, StoredSegmentsThatCannotBeTaken) {
  // The only reply to one item, of a stream whose header names that origin.
  const auto answer = [&](const std::optional<Vec3d>& origin, const v1::SegmentItem& item) {
    v1::TestSegmentsRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
    if (origin.has_value()) EncodeTestVector(*origin, request.mutable_header()->mutable_origin());
    SegmentStream stream(harness_, request);
    request.Clear();
    *request.mutable_item() = item;
    stream.Write(request);
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    return replies.at(0).at(0).reply();
  };
  v1::GetSceneRequest name;
  name.set_name("scenes/wall");
  v1::Scene scene;
  grpc::ClientContext context;
  ASSERT_TRUE(harness_.scenes->GetScene(&context, name, &scene).ok());
  const Vec3d origin = {scene.origin().x(), scene.origin().y(), scene.origin().z()};
  const auto status = [](const v1::SegmentReply& reply) { return reply.header().status(); };

  // Not finite; through the wall; beyond 2^40.
  const std::vector<double> world = {0,   -1, 0,   0,   1,    NAN, 0.3, -1, 0.1, 0.3, 1, 0.1,  //
                                     0.3, -1, 0.1, 0.3, 3e12, 0.1};
  std::vector<float> stored;
  for (size_t i = 0; i < world.size(); ++i) {
    stored.push_back(static_cast<float>(world[i] - origin[static_cast<int>(i % 3)]));
  }
  v1::SegmentItem item;
  item.set_segments_f32(PackArray(stored));
  const v1::SegmentReply good = answer(origin, item);
  EXPECT_EQ(good.header().status().code(), 0) << good.header().status().message();
  EXPECT_EQ(good.segments().blocked_bits(), std::string(1, 2));
  EXPECT_EQ(good.segments().valid_bits(), std::string(1, 2));
  ExpectItemError(status(answer(std::nullopt, item)), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "header.origin");
  ExpectItemError(status(answer(origin + Vec3d{0, 1e-9, 0}, item)),
                  grpc::StatusCode::FAILED_PRECONDITION, v1::ERROR_REASON_ORIGIN_MISMATCH,
                  "scenes/wall");
  item.set_segments(std::string(48, '\0'));
  ExpectItemError(status(answer(origin, item)), kInvalid, v1::ERROR_REASON_INVALID_FIELD,
                  "item.segments_f32");
  item.clear_segments();
  item.set_segments_f32(std::string(23, 'x'));
  ExpectItemError(status(answer(origin, item)), kInvalid, v1::ERROR_REASON_BAD_ARRAY_LENGTH,
                  "item.segments_f32");
  item.clear_segments_f32();
  ExpectItemError(status(answer(origin, item)), kInvalid, v1::ERROR_REASON_BAD_ARRAY_LENGTH,
                  "item.segments");

  v1::TestSegmentsRequest header;
  header.mutable_header()->mutable_stream()->set_scene("scenes/wall");
  EncodeTestVector({0, NAN, 0}, header.mutable_header()->mutable_origin());
  SegmentStream stream(harness_, header);
  stream.ReadAll();
  ExpectError(stream.Finish(), kInvalid, "INVALID_FIELD", "header.origin");
}

TEST_F(BadInputTest, Sequences) {
  {
    TileStream stream(harness_, TileRequest(1, 0, 0, 8, 8));
    stream.ReadAll();
    ExpectError(stream.Finish(), kInvalid, "BAD_SEQUENCE", "header");
  }
  {
    TileStream stream(harness_, Header());
    stream.Write(Header());
    stream.ReadAll();
    ExpectError(stream.Finish(), kInvalid, "BAD_SEQUENCE", "header");
  }
  {
    TileStream stream(harness_, Header());
    stream.Write(v1::TraceTilesRequest());
    stream.ReadAll();
    ExpectError(stream.Finish(), kInvalid, "BAD_SEQUENCE", "part");
  }
  {
    grpc::ClientContext context;
    auto stream = harness_.visibility->TraceTiles(&context);
    stream->WritesDone();
    ExpectError(stream->Finish(), kInvalid, "BAD_SEQUENCE", "header");
  }
}

TEST_F(BadInputTest, Scenes) {
  v1::Scene scene;
  const auto upload = [&](const std::function<void(std::vector<v1::CreateSceneRequest>&)>& spoil) {
    std::vector<v1::CreateSceneRequest> messages = WallUpload("bad");
    spoil(messages);
    return harness_.CreateScene(messages, &scene);
  };
  using M = std::vector<v1::CreateSceneRequest>;
  ExpectError(
      upload([](M& m) {
        const uint32_t t[] = {0, 1, 2, 0, 2, 4};
        m[2].mutable_chunk()->set_indices(std::string(reinterpret_cast<const char*>(t), sizeof(t)));
      }),
      kInvalid, "UNUSABLE_UPLOAD", "4");
  ExpectError(upload([](M& m) { m[2].mutable_chunk()->set_indices(std::string(24, '\0')); }),
              kInvalid, "UNUSABLE_UPLOAD", "2 have no area");
  ExpectError(upload([](M& m) { m.pop_back(); }), kInvalid, "BAD_SEQUENCE", "not complete");
  ExpectError(upload([](M& m) { m[0].mutable_header()->set_scene_id("wall"); }),
              grpc::StatusCode::ALREADY_EXISTS, "ALREADY_EXISTS", "scenes/wall");
  ExpectError(upload([](M& m) {
                m[0].mutable_header()->mutable_upload()->set_triangle_count(150'000'000);
              }),
              kOver, "OUT_OF_MEMORY_BUDGET", "max_scene_bytes");
  ExpectError(harness_.CreateBuiltin("b", "builtin:nothing", &scene), kInvalid, "INVALID_FIELD",
              "nothing");
  ExpectError(harness_.CreateBuiltin("b", "/etc/passwd", &scene), kInvalid, "INVALID_FIELD",
              "builtin.spec");
  // None of them left anything behind.
  grpc::ClientContext context;
  v1::ListScenesResponse page;
  ASSERT_TRUE(harness_.scenes->ListScenes(&context, {}, &page).ok());
  EXPECT_EQ(page.scenes_size(), 1);
}

TEST_F(BadInputTest, NonFiniteVerticesAreCounted) {
  std::vector<v1::CreateSceneRequest> messages = WallUpload("nan");
  const double v[] = {-1, 0, -1, NAN, 0, -1, 1, 0, 1, -1, 0, 1};
  messages[2].mutable_chunk()->set_vertices_f64(
      std::string(reinterpret_cast<const char*>(v), sizeof(v)));
  v1::Scene scene;
  const grpc::Status status = harness_.CreateScene(messages, &scene);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(scene.build_report().input_triangle_count(), 2u);
  EXPECT_EQ(scene.build_report().non_finite_triangle_count(), 1u);
  EXPECT_EQ(scene.build_report().non_finite_vertex_count(), 1u);
}

TEST_F(BadInputTest, OversizeAndCompressedMessagesBounce) {
  {
    v1::TestSegmentsRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
    SegmentStream stream(harness_, request);
    request.Clear();
    request.mutable_item()->set_segments(std::string(48 << 16, '\0'));
    stream.Write(request);
    stream.ReadAll();
    EXPECT_EQ(stream.Finish().error_code(), kOver);
  }
  {
    grpc::ClientContext context;
    context.set_compression_algorithm(GRPC_COMPRESS_GZIP);
    v1::GetSceneRequest request;
    request.set_name("scenes/wall" + std::string(1000, ' '));
    v1::Scene scene;
    EXPECT_EQ(harness_.scenes->GetScene(&context, request, &scene).error_code(),
              grpc::StatusCode::UNIMPLEMENTED);
  }
}

TEST_F(BadInputTest, PagesAndNames) {
  v1::ListScenesResponse page;
  v1::ListScenesRequest list;
  list.set_page_size(-1);
  grpc::ClientContext a, b, c;
  ExpectError(harness_.scenes->ListScenes(&a, list, &page), kInvalid, "INVALID_FIELD",
              "page_size = -1");
  list.set_page_size(0);
  list.set_page_token("wall");
  ExpectError(harness_.scenes->ListScenes(&b, list, &page), kInvalid, "INVALID_FIELD",
              "page_token");
  v1::DeletePointSetRequest remove;
  google::protobuf::Empty empty;
  remove.set_name("scenes/wall");
  ExpectError(harness_.point_sets->DeletePointSet(&c, remove, &empty), kInvalid, "INVALID_FIELD",
              "pointSets");
}

}  // namespace
}  // namespace sightline
