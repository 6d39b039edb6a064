// SPDX-License-Identifier: Apache-2.0
//
// What comes back through a real server is what the engine says, bit for bit.
#include <cstring>
#include <string>
#include <vector>

#include "core/query/points.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "gmock/gmock.h"
#include "server/codec/query_codec.h"
#include "server/codec/result_codec.h"
#include "tests/integration/server_harness.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

constexpr char kRoomSpec[] = "builtin:room:15000";
constexpr char kName[] = "room:15000";

class RoundTripTest : public testing::Test {
 protected:
  void SetUp() override {
    v1::Scene scene;
    v1::CreateSceneRequest request;
    request.mutable_header()->set_scene_id("room");
    request.mutable_header()->mutable_builtin()->set_spec(kRoomSpec);
    request.mutable_header()->mutable_kd_tree();  // For the strategies that want one.
    const grpc::Status status = harness_.CreateScene({request}, &scene);
    ASSERT_TRUE(status.ok()) << status.error_message();
    ASSERT_GT(scene.build_report().kd_tree().reference_count(), 0u);
    scene_ = *harness_.server->scenes().Pin("room", 0);
    view_ = FirstView(kName);
    camera_ = ViewCamera(view_, 96, 64);
  }

  void AddLights(google::protobuf::RepeatedPtrField<v1::Light>* lights) const {
    for (const Vec3d light : view_.lights) {
      EncodeTestVector(light, lights->Add()->mutable_point()->mutable_position());
    }
    EncodeTestVector(view_.suns[0], lights->Add()->mutable_directional()->mutable_direction());
  }
  std::vector<LightSample> Samples() const {
    std::vector<LightSample> samples;
    for (uint32_t i = 0; i < view_.lights.size(); ++i) {
      EXPECT_TRUE(
          AppendSamples(Light::Point(view_.lights[i]), i, scene_->geometry.origin, &samples).ok());
    }
    EXPECT_TRUE(
        AppendSamples(Light::Directional(view_.suns[0]), 3, scene_->geometry.origin, &samples)
            .ok());
    return samples;
  }
  v1::TraceTilesRequest TileHeader(Strategy strategy) const {
    v1::TraceTilesRequest request;
    v1::TraceTilesHeader* header = request.mutable_header();
    header->mutable_stream()->set_scene("scenes/room");
    header->mutable_stream()->mutable_options()->set_strategy(EncodeStrategy(strategy));
    header->mutable_stream()->mutable_options()->set_statistics(true);
    EncodeTestCamera(camera_, header->mutable_camera());
    AddLights(header->mutable_lights());
    v1::TileOutputs* outputs = header->mutable_outputs();
    outputs->set_hit_bits(true);
    outputs->set_object_ids(true);
    outputs->set_triangle_ids(true);
    outputs->set_depths(true);
    outputs->set_barycentrics(true);
    return request;
  }
  TileResult Engine(const TileRect& tile) const {
    TileResult result;
    const std::vector<LightSample> samples = Samples();
    EXPECT_TRUE(
        TraceTile(
            *scene_, camera_, tile, samples,
            {.hits = true, .ids = true, .depth = true, .uv = true, .lit = true, .points = true},
            {.strategy = Strategy::kBruteForce}, &result)
            .ok());
    return result;
  }

  ServerHarness harness_;
  std::shared_ptr<const Scene> scene_;
  BuiltinView view_;
  Camera camera_;
};

// The rows of `field` of each part, put together: `rows` 1 for arrays of one value per element. How
// an item is cut into parts is the server's affair.
template <typename Parts, typename Field>
std::string Joined(const Parts& parts, size_t rows, const Field& field) {
  std::map<uint64_t, std::string> by_offset;
  for (const auto& part : parts) {
    by_offset[part.reply().header().offset()] = field(part.reply());
  }
  std::string joined;
  for (size_t row = 0; row < rows; ++row) {
    for (const auto& [offset, bytes] : by_offset) {
      const size_t length = bytes.size() / rows;
      joined += bytes.substr(row * length, length);
    }
  }
  return joined;
}

TEST_F(RoundTripTest, TilesAreTheEnginesByEveryStrategy) {
  const std::vector<TileRect> tiles = {{0, 0, 32, 32}, {32, 0, 64, 64}, {3, 33, 29, 31}};
  std::vector<TileResult> expected;
  expected.reserve(tiles.size());
  for (const TileRect& tile : tiles) expected.push_back(Engine(tile));
  for (const Strategy strategy : AvailableStrategies()) {
    TileStream stream(harness_, TileHeader(strategy));
    for (size_t i = 0; i < tiles.size(); ++i) {
      stream.Write(TileRequest(i, tiles[i].x, tiles[i].y, tiles[i].width, tiles[i].height));
    }
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    ASSERT_EQ(replies.size(), tiles.size()) << StrategyName(strategy);
    for (const auto& [id, parts] : replies) {
      SCOPED_TRACE(StrategyName(strategy));
      const v1::ReplyHeader& last = parts.back().reply().header();
      const TileResult& engine = expected[id];
      EXPECT_TRUE(last.last());
      EXPECT_EQ(last.status().code(), 0) << last.status().message();
      EXPECT_EQ(last.revision(), 1);
      EXPECT_GT(last.statistics().ray_count(), 0u);
      uint64_t elements = 0;
      for (const auto& part : parts) elements += part.reply().header().element_count();
      EXPECT_EQ(elements, tiles[id].width * tiles[id].height);
      const auto tile = [&parts = parts](const std::string& (v1::TileResult::*field)() const) {
        return Joined(parts, 1, [&](const v1::TileReply& r) { return (r.tile().*field)(); });
      };
      EXPECT_EQ(tile(&v1::TileResult::hit_bits), PackArray(engine.hit_bits));
      std::string objects, triangles;
      EncodeTriangles(scene_->geometry, engine.triangle, &objects, &triangles);
      EXPECT_EQ(tile(&v1::TileResult::object_ids), objects);
      EXPECT_EQ(tile(&v1::TileResult::triangle_ids), triangles);
      EXPECT_EQ(tile(&v1::TileResult::depths), PackArray(engine.depth));
      EXPECT_EQ(tile(&v1::TileResult::barycentric_u), PackArray(engine.u));
      EXPECT_EQ(tile(&v1::TileResult::barycentric_v), PackArray(engine.v));
      const auto lit = [](const v1::TileReply& r) { return r.shadows().lit_bits(); };
      EXPECT_EQ(Joined(parts, 4, lit), PackArray(engine.lit_bits));
    }
  }
}

// What answered travels with tiles, and with whatever else is wanted of their lights.
TEST_F(RoundTripTest, WhatAnsweredIsTheEngines) {
  for (const bool sums : {false, true}) {
    v1::TraceTilesRequest header = TileHeader(Strategy::kShaft);
    header.mutable_header()->mutable_outputs()->set_answered_by(true);
    v1::ShadowOutputs* wanted = header.mutable_header()->mutable_shadow_outputs();
    wanted->set_answered_by(true);
    wanted->set_weighted_sums(sums);
    TileStream stream(harness_, header);
    stream.Write(TileRequest(1, 0, 0, 64, 64));
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    ASSERT_EQ(replies.size(), 1u);
    // Which shafts there are depends on the cut into parts.
    for (const v1::TraceTilesResponse& part : replies.begin()->second) {
      const v1::TileReply& reply = part.reply();
      const auto row = static_cast<uint32_t>(reply.header().offset() / 64);
      const auto rows = static_cast<uint32_t>(reply.header().element_count() / 64);
      const std::vector<LightSample> samples = Samples();
      TileResult engine;
      ASSERT_TRUE(TraceTile(*scene_, camera_, {0, row, 64, rows}, samples,
                            {.ids = true,
                             .depth = true,
                             .uv = true,
                             .lit = true,
                             .answered_by = true,
                             .lit_answered_by = true},
                            {.strategy = Strategy::kShaft}, &engine)
                      .ok());
      EXPECT_EQ(reply.tile().answered_by(), PackArray(engine.answered_by));
      EXPECT_TRUE(reply.shadows().lit_bits().empty());
      const std::string& by = reply.shadows().answered_by();
      ASSERT_EQ(by.size(), engine.lit_answered_by.size());
      for (size_t i = 0; i < by.size(); ++i) {
        // Sums group the points otherwise, which may change what answers, but not whether.
        const auto ours = static_cast<char>(engine.lit_answered_by[i]);
        EXPECT_TRUE(sums ? (by[i] == 0) == (ours == 0) : by[i] == ours) << i;
      }
    }
  }
}

TEST_F(RoundTripTest, TileSumsAndBlockersAreThoseOfItsHits) {
  v1::TraceTilesRequest header = TileHeader(Strategy::kAuto);
  v1::ShadowOutputs* wanted = header.mutable_header()->mutable_shadow_outputs();
  wanted->set_lit_bits(true);
  wanted->set_lit_counts(true);
  wanted->set_weighted_sums(true);
  wanted->set_first_blockers(true);
  TileStream stream(harness_, header);
  stream.Write(TileRequest(1, 0, 0, 96, 64));
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  const auto joined = [&](size_t rows, const std::string& (v1::ShadowResult::*field)() const) {
    return Joined(replies.at(1), rows,
                  [&](const v1::TileReply& reply) { return (reply.shadows().*field)(); });
  };
  const TileResult engine = Engine({0, 0, 96, 64});
  EXPECT_EQ(joined(4, &v1::ShadowResult::lit_bits), PackArray(engine.lit_bits));
  const auto counts = UnpackArray<uint32_t>(joined(1, &v1::ShadowResult::lit_counts));
  const auto sums = UnpackArray<double>(joined(1, &v1::ShadowResult::weighted_sums));
  const auto blockers = UnpackArray<uint32_t>(joined(4, &v1::ShadowResult::blocker_objects));
  ASSERT_EQ(counts.size(), 96u * 64u);
  ASSERT_EQ(blockers.size(), 4u * 96u * 64u);
  const size_t row = 96 * 64 / 8;
  for (size_t i = 0; i < counts.size(); ++i) {
    uint32_t lit = 0;
    for (size_t s = 0; s < 4; ++s) {
      const bool bit = (engine.lit_bits[s * row + i / 8] >> (i % 8)) & 1;
      lit += bit;
      const bool hit = (engine.hit_bits[i / 8] >> (i % 8)) & 1;
      EXPECT_EQ(blockers[s * counts.size() + i] == kNoTriangle, bit || !hit) << i;
    }
    EXPECT_EQ(counts[i], lit);
    EXPECT_EQ(sums[i], lit);
  }
}

// An item that is too large for one reply comes in parts, which together are the same answer.
TEST_F(RoundTripTest, PartsMakeTheWhole) {
  ServerOptions options;
  options.limits.target_reply_bytes = 1024;
  ServerHarness harness(options);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateBuiltin("room", kRoomSpec, &scene).ok());
  TileStream stream(harness, TileHeader(Strategy::kPacket));
  stream.Write(TileRequest(7, 1, 0, 95, 63));
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  const auto& parts = replies.at(7);
  EXPECT_GT(parts.size(), 3u);
  const TileResult engine = Engine({1, 0, 95, 63});
  std::vector<float> depths(95 * 63, -1);
  uint64_t elements = 0;
  for (size_t i = 0; i < parts.size(); ++i) {
    const v1::ReplyHeader& part = parts[i].reply().header();
    EXPECT_EQ(part.last(), i + 1 == parts.size());
    EXPECT_EQ(part.offset() % 8, 0u);
    elements += part.element_count();
    const auto values = UnpackArray<float>(parts[i].reply().tile().depths());
    ASSERT_EQ(values.size(), part.element_count());
    std::copy(values.begin(), values.end(), depths.begin() + part.offset());
  }
  EXPECT_EQ(elements, depths.size());
  EXPECT_EQ(std::memcmp(depths.data(), engine.depth.data(), 4 * depths.size()), 0);
}

TEST_F(RoundTripTest, PointShadowsAreTheEngines) {
  testing_support::TestRng rng;
  std::vector<Vec3d> points(1001);
  for (Vec3d& p : points) p = {rng.Uniform(-3, 3), rng.Uniform(-3, 3), rng.Uniform(0, 3)};
  points[5].x = std::nan("");
  points[6].y = 1e300;
  v1::ComputeShadowsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  AddLights(request.mutable_header()->mutable_lights());
  request.mutable_header()->add_lights()->mutable_point()->mutable_position()->set_x(std::nan(""));
  ShadowStream stream(harness_, request);
  request.Clear();
  request.mutable_item()->mutable_points()->set_points(PackArray(points));
  stream.Write(request);
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  const v1::ShadowReply& reply = replies.at(0).at(0).reply();
  ASSERT_EQ(reply.header().status().code(), 0) << reply.header().status().message();

  const PreparedPoints prepared = *PreparePoints(*scene_, {points, {}, {}}, {});
  std::vector<LightSample> samples = Samples();
  samples.push_back({.valid = false, .light = 4});
  ShadowResult engine;
  ASSERT_TRUE(ComputeShadows(*scene_, PointRange::All(prepared), samples, {}, {}, {.bits = true},
                             {.strategy = Strategy::kBruteForce}, &engine)
                  .ok());
  EXPECT_EQ(reply.shadows().lit_bits(), PackArray(engine.lit_bits));
  std::string valid;
  EncodeBits(prepared.valid, &valid);
  EXPECT_EQ(reply.shadows().valid_bits(), valid);
  EXPECT_EQ(valid[0] & 0x60, 0);  // Points 5 and 6.
  EXPECT_THAT(reply.shadows().invalid_samples(), testing::ElementsAre(4u));
  EXPECT_EQ(reply.shadows().near_surface_point_count(), prepared.near_surface);
}

// Many points that are no neighbours, and many lights: the server orders them, and computes in
// parts what it answers at once.
TEST_F(RoundTripTest, ScatteredPointsAndManyLightsAreTheEngines) {
  testing_support::TestRng rng;
  std::vector<Vec3d> points(6001);
  for (Vec3d& p : points) p = {rng.Uniform(-3, 3), rng.Uniform(-3, 3), rng.Uniform(0, 3)};
  points[7].x = std::nan("");
  const PreparedPoints prepared = *PreparePoints(*scene_, {points, {}, {}}, {});
  v1::ComputeShadowsRequest header;
  header.mutable_header()->mutable_stream()->set_scene("scenes/room");
  header.mutable_header()->mutable_stream()->mutable_options()->set_statistics(true);
  std::vector<LightSample> samples;
  constexpr uint32_t kLights = 28;
  for (uint32_t i = 0; i < kLights; ++i) {
    const Vec3d at = {rng.Uniform(-2, 2), rng.Uniform(-2, 2), rng.Uniform(0, 3)};
    EncodeTestVector(at,
                     header.mutable_header()->add_lights()->mutable_point()->mutable_position());
    ASSERT_TRUE(AppendSamples(Light::Point(at), i, scene_->geometry.origin, &samples).ok());
  }
  for (const bool blockers : {false, true}) {
    v1::ShadowOutputs* outputs = header.mutable_header()->mutable_outputs();
    outputs->set_lit_bits(true);
    outputs->set_lit_counts(true);
    outputs->set_weighted_sums(true);
    outputs->set_first_blockers(blockers);
    ShadowStream stream(harness_, header);
    v1::ComputeShadowsRequest item;
    item.mutable_item()->mutable_points()->set_points(PackArray(points));
    stream.Write(item);
    const auto replies = stream.ReadAll();
    ASSERT_TRUE(stream.Finish().ok());
    const auto& parts = replies.at(0);
    ShadowResult engine;
    ASSERT_TRUE(ComputeShadows(
                    *scene_, PointRange::All(prepared), samples, std::vector<double>(kLights, 1.0),
                    {}, {.bits = true, .counts = true, .weighted_sums = true, .blockers = blockers},
                    {.strategy = Strategy::kSingle}, &engine)
                    .ok());
    const auto joined = [&](size_t rows, auto field) {
      return Joined(parts, rows, [&](const v1::ShadowReply& r) { return field(r.shadows()); });
    };
    using Result = v1::ShadowResult;
    EXPECT_EQ(joined(1, [](const Result& r) { return r.lit_counts(); }),
              PackArray(engine.lit_counts));
    EXPECT_EQ(joined(1, [](const Result& r) { return r.weighted_sums(); }),
              PackArray(engine.weighted_sums));
    EXPECT_EQ(joined(kLights, [](const Result& r) { return r.lit_bits(); }),
              PackArray(engine.lit_bits));
    if (blockers) {
      EXPECT_EQ(joined(kLights, [](const Result& r) { return r.blocker_distances(); }),
                PackArray(engine.blocker_t));
    } else {
      // One reply of several parts.
      EXPECT_EQ(parts.size(), 1u);
    }
    uint64_t lasts = 0;
    for (const auto& part : parts) lasts += part.reply().header().last() ? 1 : 0;
    EXPECT_EQ(lasts, 1u);
    EXPECT_TRUE(parts.back().reply().header().last());
    // Its statistics are those of all parts.
    EXPECT_EQ(parts.back().reply().header().statistics().ray_count(), uint64_t{6000} * kLights);
  }
}

// Points kept from a camera give the tile's own shadows when they are lit again.
TEST_F(RoundTripTest, PointSetsFromACameraAreRelit) {
  v1::CreatePointSetRequest create;
  create.mutable_header()->set_parent("scenes/room");
  create.mutable_header()->set_point_set_id("view");
  EncodeTestCamera(camera_, create.mutable_header()->mutable_camera()->mutable_camera());
  v1::PointSet set;
  const grpc::Status created = harness_.CreatePointSet({create}, &set);
  ASSERT_TRUE(created.ok()) << created.error_message();
  EXPECT_EQ(set.name(), "scenes/room/pointSets/view");
  EXPECT_EQ(set.point_count(), 96u * 64u);
  EXPECT_EQ(set.point_count(), set.invalid_point_count() + set.attached_point_count());

  v1::ComputeShadowsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  AddLights(request.mutable_header()->mutable_lights());
  ShadowStream stream(harness_, request);
  for (uint64_t i = 0; i < 2; ++i) {
    request.Clear();
    request.mutable_item()->mutable_item()->set_item_id(i);
    v1::PointSetRange* range = request.mutable_item()->mutable_point_set_range();
    range->set_point_set(set.name());
    range->set_offset(i * 96 * 32);
    range->set_count(96 * 32);
    stream.Write(request);
  }
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  for (uint32_t i = 0; i < 2; ++i) {
    const TileResult engine = Engine({0, i * 32, 96, 32});
    const auto lit = [](const v1::ShadowReply& reply) { return reply.shadows().lit_bits(); };
    EXPECT_EQ(Joined(replies.at(i), 4, lit), PackArray(engine.lit_bits));
  }
}

TEST_F(RoundTripTest, SegmentsAreTheEngines) {
  testing_support::TestRng rng;
  std::vector<std::array<Vec3d, 2>> segments(777);
  for (auto& segment : segments) {
    for (Vec3d& end : segment) {
      end = {rng.Uniform(-4, 4), rng.Uniform(-4, 4), rng.Uniform(-1, 4)};
    }
  }
  segments[9][1].z = std::nan("");
  v1::TestSegmentsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  request.mutable_header()->mutable_outputs()->set_blocked_bits(true);
  request.mutable_header()->mutable_outputs()->set_first_blockers(true);
  SegmentStream stream(harness_, request);
  request.Clear();
  request.mutable_item()->set_segments(PackArray(segments));
  stream.Write(request);
  const auto replies = stream.ReadAll();
  ASSERT_TRUE(stream.Finish().ok());
  const v1::SegmentReply& reply = replies.at(0).at(0).reply();
  PreparedSegments prepared;
  ASSERT_TRUE(PrepareSegments(*scene_, segments, {}, {}, &prepared).ok());
  SegmentResult engine;
  ASSERT_TRUE(TestSegments(*scene_, prepared, {.bits = true, .first_hits = true},
                           {.strategy = Strategy::kBruteForce}, &engine)
                  .ok());
  EXPECT_EQ(reply.segments().blocked_bits(), PackArray(engine.blocked_bits));
  EXPECT_EQ(reply.segments().blocker_distances(), PackArray(engine.t));
  std::string objects, triangles;
  EncodeTriangles(scene_->geometry, engine.triangle, &objects, &triangles);
  EXPECT_EQ(reply.segments().blocker_objects(), objects);
  EXPECT_EQ(reply.segments().blocker_triangles(), triangles);
  EXPECT_EQ(reply.segments().valid_bits()[1] & 2, 0);  // Segment 9.

  // As the scene stores them they get the same answer, byte for byte.
  std::vector<std::array<Vec3f, 2>> stored(segments.size());
  for (size_t i = 0; i < segments.size(); ++i) {
    for (size_t end = 0; end < 2; ++end) {
      stored[i][end] = ToFloat(segments[i][end] - scene_->geometry.origin);
    }
  }
  request.Clear();
  request.mutable_header()->mutable_stream()->set_scene("scenes/room");
  request.mutable_header()->mutable_outputs()->set_blocked_bits(true);
  request.mutable_header()->mutable_outputs()->set_first_blockers(true);
  EncodeTestVector(scene_->geometry.origin, request.mutable_header()->mutable_origin());
  SegmentStream stored_stream(harness_, request);
  request.Clear();
  request.mutable_item()->set_segments_f32(PackArray(stored));
  stored_stream.Write(request);
  const auto stored_replies = stored_stream.ReadAll();
  ASSERT_TRUE(stored_stream.Finish().ok());
  EXPECT_EQ(stored_replies.at(0).at(0).reply().segments().SerializeAsString(),
            reply.segments().SerializeAsString());
}

// An edit makes a new revision; what was pinned keeps its own.
TEST_F(RoundTripTest, UploadsEditsAndRevisions) {
  v1::Scene scene;
  grpc::Status status = harness_.CreateScene(WallUpload("wall"), &scene);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(scene.name(), "scenes/wall");
  EXPECT_EQ(scene.revision(), 1);
  EXPECT_EQ(scene.triangle_count(), 2u);
  EXPECT_EQ(scene.state(), v1::SCENE_STATE_READY);
  EXPECT_EQ(scene.bounds().max().z(), 1);

  const auto blocked = [&](int64_t revision) -> std::string {
    v1::TestSegmentsRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
    request.mutable_header()->mutable_stream()->set_revision(revision);
    SegmentStream stream(harness_, request);
    request.Clear();
    request.mutable_item()->set_segments(
        PackArray<double>({0.1, -1, 0.2, 0.1, 1, 0.2, 5, -1, 0, 5, 1, 0}));
    stream.Write(request);
    const auto replies = stream.ReadAll();
    const grpc::Status end = stream.Finish();
    return end.ok() ? replies.at(0).at(0).reply().segments().blocked_bits() : ReasonIn(end);
  };
  EXPECT_EQ(blocked(0), std::string(1, 1));

  v1::TestSegmentsRequest pin;
  pin.mutable_header()->mutable_stream()->set_scene("scenes/wall");
  pin.mutable_header()->mutable_stream()->set_revision(1);
  SegmentStream pinned(harness_, pin);
  v1::TestSegmentsResponse opened;
  ASSERT_TRUE(pinned.Read(&opened));
  EXPECT_EQ(opened.opened().revision(), 1);

  std::vector<v1::UpdateSceneRequest> edit(2);
  edit[0].mutable_header()->set_name("scenes/wall");
  edit[0].mutable_header()->set_base_revision(1);
  edit[1].mutable_set_transform()->set_object_name("wall");
  for (const double m : {1, 0, 0, 5, 0, 1, 0, 0, 0, 0, 1, 0}) {
    edit[1].mutable_set_transform()->add_transform(m);
  }
  status = harness_.UpdateScene(edit, &scene);
  ASSERT_TRUE(status.ok()) << status.error_message();
  EXPECT_EQ(scene.revision(), 2);
  EXPECT_EQ(blocked(0), std::string(1, 2));
  EXPECT_EQ(blocked(2), std::string(1, 2));

  status = harness_.UpdateScene(edit, &scene);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_EQ(ReasonIn(status), "REVISION_MISMATCH");

  pin.Clear();
  pin.mutable_item()->set_segments(PackArray<double>({0.1, -1, 0.2, 0.1, 1, 0.2}));
  pinned.Write(pin);
  ASSERT_TRUE(pinned.Read(&opened));
  EXPECT_EQ(opened.reply().header().revision(), 1);
  EXPECT_EQ(opened.reply().segments().blocked_bits(), std::string(1, 1));
}

TEST_F(RoundTripTest, ScenesAreListedWatchedAndDeleted) {
  v1::Scene scene;
  ASSERT_TRUE(harness_.CreateScene(WallUpload("wall"), &scene).ok());
  {
    grpc::ClientContext context;
    v1::ListScenesRequest request;
    v1::ListScenesResponse page;
    request.set_page_size(1);
    ASSERT_TRUE(harness_.scenes->ListScenes(&context, request, &page).ok());
    ASSERT_EQ(page.scenes_size(), 1);
    EXPECT_EQ(page.scenes(0).name(), "scenes/room");
    grpc::ClientContext next;
    request.set_page_token(page.next_page_token());
    ASSERT_TRUE(harness_.scenes->ListScenes(&next, request, &page).ok());
    ASSERT_EQ(page.scenes_size(), 1);
    EXPECT_EQ(page.scenes(0).name(), "scenes/wall");
    EXPECT_TRUE(page.next_page_token().empty());
  }
  {
    grpc::ClientContext context;
    v1::ListSceneObjectsRequest request;
    v1::ListSceneObjectsResponse page;
    request.set_parent("scenes/wall");
    ASSERT_TRUE(harness_.scenes->ListSceneObjects(&context, request, &page).ok());
    ASSERT_EQ(page.scene_objects_size(), 1);
    EXPECT_EQ(page.scene_objects(0).object_name(), "wall");
    EXPECT_TRUE(page.scene_objects(0).dynamic());
  }
  grpc::ClientContext watch_context, delete_context, get_context;
  v1::WatchSceneRequest watch;
  watch.set_name("scenes/wall");
  auto reader = harness_.scenes->WatchScene(&watch_context, watch);
  v1::WatchSceneResponse change;
  ASSERT_TRUE(reader->Read(&change));
  EXPECT_EQ(change.scene().state(), v1::SCENE_STATE_READY);
  v1::DeleteSceneRequest remove;
  remove.set_name("scenes/wall");
  google::protobuf::Empty empty;
  ASSERT_TRUE(harness_.scenes->DeleteScene(&delete_context, remove, &empty).ok());
  v1::SceneState last = v1::SCENE_STATE_UNSPECIFIED;
  while (reader->Read(&change)) last = change.scene().state();
  EXPECT_TRUE(reader->Finish().ok());
  EXPECT_EQ(last, v1::SCENE_STATE_DELETED);
  v1::GetSceneRequest get;
  get.set_name("scenes/wall");
  const grpc::Status gone = harness_.scenes->GetScene(&get_context, get, &scene);
  EXPECT_EQ(gone.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(ReasonIn(gone), "SCENE_NOT_FOUND");
}

TEST_F(RoundTripTest, RequestIdsMakeCreationRepeatable) {
  v1::Scene first, second;
  ASSERT_TRUE(harness_.CreateBuiltin("", "builtin:box", &first, "once").ok());
  ASSERT_TRUE(harness_.CreateBuiltin("", "builtin:box", &second, "once").ok());
  EXPECT_EQ(first.name(), second.name());
  const grpc::Status reused = harness_.CreateBuiltin("", "builtin:room:15000", &second, "once");
  EXPECT_EQ(ReasonIn(reused), "REQUEST_ID_REUSED");
  EXPECT_EQ(ReasonIn(harness_.CreateBuiltin("room", "builtin:room:15000", &second)),
            "ALREADY_EXISTS");
}

}  // namespace
}  // namespace sightline
