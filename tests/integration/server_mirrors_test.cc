// SPDX-License-Identifier: Apache-2.0
//
// What is seen in mirrors comes back through a real server as the engine says, bit for bit.
#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "core/query/mirrors.h"
#include "core/query/tiles.h"
#include "gmock/gmock.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/query_codec.h"
#include "server/codec/result_codec.h"
#include "tests/integration/server_harness.h"

namespace sightline {
namespace {

class MirrorsServedTest : public testing::Test {
 protected:
  void SetUp() override {
    v1::Scene scene;
    v1::CreateSceneRequest request;
    request.mutable_header()->set_scene_id("room");
    request.mutable_header()->mutable_builtin()->set_spec("builtin:room:15000");
    request.mutable_header()->mutable_kd_tree();  // For the strategies that want one.
    const grpc::Status status = harness_.CreateScene({request}, &scene);
    ASSERT_TRUE(status.ok()) << status.error_message();
    scene_ = *harness_.server->scenes().Pin("room", 0);
    const BuiltinView view = FirstView("room:15000");
    camera_ = ViewCamera(view, 96, 64);
    light_ = view.lights[0];
  }

  std::vector<LightSample> Samples() const {
    std::vector<LightSample> samples;
    EXPECT_TRUE(AppendSamples(Light::Point(light_), 0, scene_->geometry.origin, &samples).ok());
    return samples;
  }

  v1::TraceTilesRequest TileHeader(Strategy strategy) const {
    v1::TraceTilesRequest request;
    v1::TraceTilesHeader* header = request.mutable_header();
    header->mutable_stream()->set_scene("scenes/room");
    header->mutable_stream()->mutable_options()->set_strategy(EncodeStrategy(strategy));
    EncodeTestCamera(camera_, header->mutable_camera());
    EncodeTestVector(light_, header->add_lights()->mutable_point()->mutable_position());
    header->mutable_outputs()->set_depths(true);
    header->mutable_outputs()->set_barycentrics(true);
    return request;
  }

  ServerHarness harness_;
  std::shared_ptr<const Scene> scene_;
  Camera camera_;
  Vec3d light_;
};

// What is seen in a mirror, and by which lights it is reached.
TEST_F(MirrorsServedTest, MirrorsAreTheEngines) {
  const auto object = [&](const char* name) {
    const auto& objects = scene_->geometry.objects;
    const auto at = std::find_if(objects.begin(), objects.end(),
                                 [&](const ObjectRecord& o) { return o.name == name; });
    EXPECT_NE(at, objects.end());
    return static_cast<uint32_t>(at - objects.begin());
  };
  // A wall is a box: its plane must be given.
  const Mirror mirrors[] = {
      {.object = object("wall-north"), .plane = MirrorPlane{{0, 2.5, 0}, {0, 1, 0}}},
      {.object = object("floor"), .plane = MirrorPlane{{}, {0, 0, 1}}}};
  TileResult engine;
  const std::vector<LightSample> samples = Samples();
  ASSERT_TRUE(
      TraceTile(
          *scene_, camera_, {0, 0, 96, 64}, samples, mirrors,
          {.hits = true, .ids = true, .depth = true, .uv = true, .lit = true, .mirrors = true},
          {.strategy = Strategy::kBruteForce}, &engine)
          .ok());
  ASSERT_GT(std::count_if(engine.mirror_bits.begin(), engine.mirror_bits.end(),
                          [](uint8_t bits) { return bits != 0; }),
            20);
  for (const Strategy strategy : AvailableStrategies()) {
    SCOPED_TRACE(StrategyName(strategy));
    v1::TraceTilesRequest request = TileHeader(strategy);
    v1::TraceTilesHeader* const header = request.mutable_header();
    header->mutable_outputs()->set_mirror_bits(true);
    for (const Mirror& mirror : mirrors) {
      v1::Mirror* const out = header->add_mirrors();
      out->set_object_name(scene_->geometry.objects[mirror.object].name);
      EncodeVector(mirror.plane->point, out->mutable_plane()->mutable_point());
      EncodeVector(mirror.plane->normal, out->mutable_plane()->mutable_normal());
    }
    TileStream stream(harness_, request);
    stream.Write(TileRequest(1, 0, 0, 96, 64));
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    ASSERT_EQ(replies.size(), 1u);
    const auto& parts = replies.begin()->second;
    ASSERT_EQ(parts.back().reply().header().status().code(), 0)
        << parts.back().reply().header().status().message();
    // However the server cut the item.
    std::map<uint64_t, const v1::TileReply*> by_offset;
    for (const auto& part : parts) by_offset[part.reply().header().offset()] = &part.reply();
    std::string mirror_bits, depths, us, lit;
    for (const auto& [offset, reply] : by_offset) {
      mirror_bits += reply->tile().mirror_bits();
      depths += reply->tile().depths();
      us += reply->tile().barycentric_u();
      lit += reply->shadows().lit_bits();
    }
    EXPECT_EQ(mirror_bits, PackArray(engine.mirror_bits));
    EXPECT_EQ(depths, PackArray(engine.depth));
    EXPECT_EQ(us, PackArray(engine.u));
    EXPECT_EQ(lit, PackArray(engine.lit_bits));
  }
}

TEST_F(MirrorsServedTest, WhatIsNoMirrorFailsItsItems) {
  const auto status_of = [&](const char* object) {
    v1::TraceTilesRequest request = TileHeader(Strategy::kAuto);
    request.mutable_header()->add_mirrors()->set_object_name(object);
    TileStream stream(harness_, request);
    stream.Write(TileRequest(1, 0, 0, 32, 32));
    const auto replies = stream.ReadAll();
    EXPECT_TRUE(stream.Finish().ok());
    return replies.begin()->second.back().reply().header().status();
  };
  EXPECT_EQ(status_of("no such thing").code(), static_cast<int>(absl::StatusCode::kNotFound));
  const v1::ItemStatus curved = status_of("sofa");
  EXPECT_EQ(curved.code(), static_cast<int>(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(curved.message(), testing::HasSubstr("not flat"));
}

}  // namespace
}  // namespace sightline
