// SPDX-License-Identifier: Apache-2.0
//
// What a client hears when it goes over a limit: which of its values that was, the limit by the
// name and value that are published, and what to do.
#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "core/base/parallel.h"
#include "gtest/gtest.h"
#include "server/admission/call_quota.h"
#include "server/admission/ray_queue.h"
#include "server/admission/upload_slots.h"
#include "server/base/error.h"
#include "server/codec/geometry_codec.h"
#include "server/points/point_set_store.h"
#include "server/points/point_upload.h"
#include "server/scenes/scene_catalog.h"
#include "server/scenes/scene_upload.h"
#include "server/stream/item_work.h"
#include "server/stream/stream_method.h"

namespace sightline {
namespace {

struct Case {
  std::string limit;
  absl::Status status;
};

Limits SmallLimits() {
  Limits limits;
  limits.max_image_width = limits.max_image_height = 16;
  limits.max_lights = 2;
  limits.max_samples_per_light = 8;
  limits.max_light_samples = 10;
  limits.max_scenes = 1;
  limits.max_objects_per_scene = 2;
  limits.max_triangles_per_scene = 100;
  limits.max_vertices_per_scene = 300;
  limits.max_points_per_set = 10;
  limits.max_point_sets = 1;
  limits.max_item_rays = 1000;
  limits.max_scene_bytes = 8 << 20;
  limits.max_bytes_per_scene = 4 << 20;
  limits.max_point_set_bytes = 1 << 10;
  return limits;
}

absl::Status Image(uint32_t width, uint32_t height) {
  v1::Camera camera;
  for (v1::Vector3* axis : {camera.mutable_eye(), camera.mutable_right(), camera.mutable_up(),
                            camera.mutable_forward()}) {
    axis->set_x(1);
  }
  camera.set_tan_half_fov_y(1);
  camera.set_width(width);
  camera.set_height(height);
  return DecodeCamera(camera, SmallLimits()).status();
}

absl::Status Lights(const std::vector<uint32_t>& samples) {
  google::protobuf::RepeatedPtrField<v1::Light> lights;
  for (const uint32_t count : samples) {
    lights.Add()->mutable_rectangular_area()->set_sample_count(count);
  }
  return CheckLights(lights, SmallLimits()).status();
}

absl::Status Mesh(uint32_t objects, uint64_t triangles, uint64_t vertices) {
  SceneUpload upload(SmallLimits());
  v1::CreateSceneRequest request;
  v1::UploadSource* const source = request.mutable_header()->mutable_upload();
  source->set_object_count(objects);
  source->set_triangle_count(triangles);
  source->set_vertex_count(vertices);
  return upload.Add(request);
}

absl::Status Edits(int count) {
  SceneEditUpload upload(SmallLimits());
  v1::UpdateSceneRequest request;
  request.mutable_header()->set_name("scenes/hall");
  absl::Status status = upload.Add(request);
  for (int i = 0; i < count && status.ok(); ++i) {
    request.mutable_remove_object()->set_object_name(absl::StrCat("chair ", i));
    status = upload.Add(request);
  }
  return status;
}

absl::Status Points(uint64_t count) {
  PointUpload upload(SmallLimits());
  v1::CreatePointSetRequest request;
  request.mutable_header()->set_parent("scenes/hall");
  request.mutable_header()->mutable_upload()->set_point_count(count);
  return upload.Add(request);
}

PointSet Set(const std::string& id) {
  PointSet set;
  set.scene_id = "hall";
  set.point_set_id = id;
  return set;
}

// One of every way to go over a limit.
std::vector<Case> Cases() {
  const Limits limits = SmallLimits();
  std::vector<Case> cases = {
      {"max_image_width", Image(17, 1)},
      {"max_image_height", Image(1, 17)},
      {"max_lights", Lights({1, 1, 1})},
      {"max_samples_per_light", Lights({9})},
      {"max_light_samples", Lights({8, 8})},
      {"max_objects_per_scene", Mesh(3, 1, 3)},
      {"max_triangles_per_scene", Mesh(1, 101, 3)},
      {"max_vertices_per_scene", Mesh(1, 1, 301)},
      {"max_objects_per_scene", Edits(3)},
      {"max_points_per_set", Points(11)},
      {"max_item_rays", CheckItemRays(1001, limits)},
      {"max_message_bytes",
       CutIntoParts(8, 8, 1, 8, limits, [](uint64_t) { return uint64_t{1} << 40; }).status()},
  };
  ThreadPool pool(1);
  SceneCatalog catalog(limits, pool);
  cases.push_back({"max_bytes_per_scene", catalog.CheckRoom("a", 50'000, 0)});
  cases.push_back({"max_scene_bytes", catalog.CheckRoom("a", 100'000, 0)});
  cases.push_back({"max_scene_bytes", catalog.CheckRoom("a", 10, 0, 9 << 20)});
  cases.push_back({"max_scene_bytes", catalog.SetAside(9 << 20)});
  cases.push_back(
      {"max_triangles_per_scene",
       catalog.CreateBuiltin({.scene_id = "a", .builtin = "builtin:sphere:1500"}, {}).status()});
  const std::vector<ObjectInput> objects = {
      {.name = "o", .vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .indices = {0, 1, 2}}};
  EXPECT_TRUE(catalog.Create({.scene_id = "hall"}, objects, nullptr).ok());
  cases.push_back({"max_scenes", catalog.CheckRoom("b", 1, 3)});
  cases.push_back({"max_bytes_per_scene", catalog.CheckEditRoom("hall", 50'000, 0)});
  cases.push_back({"max_scene_bytes", catalog.CheckEditRoom("hall", 100'000, 0)});
  // Those that the engine finds, under the names that are published.
  std::vector<ObjectInput> many(3, objects[0]);
  for (size_t i = 0; i < many.size(); ++i) many[i].name = absl::StrCat("o", i);
  EXPECT_TRUE(catalog.Delete("hall").ok());
  cases.push_back({"max_objects_per_scene", catalog.Create({.scene_id = "c"}, many, {}).status()});

  PointSetStore points(limits, &absl::Now);
  cases.push_back({"max_point_set_bytes", points.SetAside(2 << 10)});
  cases.push_back({"max_point_set_bytes", points.CheckRoom("hall", "a", 1 << 10)});
  EXPECT_TRUE(points.Add(Set("a"), absl::Minutes(1)).ok());
  cases.push_back({"max_point_sets", points.CheckRoom("hall", "b", 1)});

  RayQueue queue(100, 50);
  const RayAccount a = queue.Open("a"), b = queue.Open("b"), role = queue.Open("role", 20);
  const auto held_a = queue.Admit(a, 50), held_b = queue.Admit(b, 10), held = queue.Admit(role, 20);
  cases.push_back({"max_queued_rays_per_client", queue.Admit(a, 10).status()});
  cases.push_back({"limit rays of the access file", queue.Admit(role, 10).status()});
  cases.push_back({"max_queued_rays", queue.Admit(b, 30).status()});

  UploadSlots slots(1);
  const auto slot = slots.Take();
  cases.push_back({"max_concurrent_uploads", slots.Take().status()});
  CallQuota uploads("uploads", CallQuota::Shares::kPass, {"max_concurrent_uploads_per_client", 1});
  CallQuota streams("streams", CallQuota::Shares::kPass, {"max_streams_per_client", 1});
  CallQuota scenes("scenes", CallQuota::Shares::kLast);
  const auto upload = uploads.Take("a", 0), stream = streams.Take("a", 0),
             scene = scenes.Take("a", 1);
  cases.push_back({"max_concurrent_uploads_per_client", uploads.Take("a", 0).status()});
  cases.push_back({"max_streams_per_client", streams.Take("a", 0).status()});
  cases.push_back({"limit streams of the access file", streams.Take("a", 1).status()});
  cases.push_back({"limit scenes of the access file", scenes.Take("a", 1).status()});
  CallQuota bytes("upload-bytes");
  cases.push_back({"limit upload-bytes of the access file", bytes.Take("a", 5, 6).status()});
  return cases;
}

TEST(LimitErrorsTest, EachNamesTheValueTheLimitAndARemedy) {
  for (const Case& c : Cases()) {
    EXPECT_EQ(c.status.code(), absl::StatusCode::kResourceExhausted) << c.limit << c.status;
    v1::ItemStatus item;
    ToItemStatus(c.status, &item);
    EXPECT_EQ(item.metadata().at("limit"), c.limit) << c.status;
    const std::string value = item.metadata().at("limit_value");
    // "<what> = <value> is over the limit <limit> = <limit value>: <remedy>", or the engine's
    // "<what happened>; <limit> is <limit value>: <remedy>".
    const std::string message = item.message();
    size_t at = message.find(absl::StrCat(c.limit, " = ", value, ": "));
    if (at == std::string::npos) at = message.find(absl::StrCat(c.limit, " is ", value, ": "));
    ASSERT_NE(at, std::string::npos) << c.limit << ": " << message;
    EXPECT_GT(message.size() - message.find(": ", at), 10u) << message;
    EXPECT_NE(message.substr(0, at).find_first_of("0123456789"), std::string::npos) << message;
  }
}

TEST(LimitErrorsTest, AStalledStreamIsToldWhatItKeptWaiting) {
  Limits limits;
  limits.max_stream_stall_seconds = 7;
  const absl::Status status = StreamStallError(limits);
  EXPECT_EQ(status.code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_DEADLINE_EXCEEDED);
  EXPECT_TRUE(absl::StrContains(status.message(), "max_stream_stall = 7 s")) << status;
  // A watch has no credit, and no replies that could be shorter.
  const absl::Status watch = WatchStallError(limits);
  EXPECT_EQ(watch.code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(ReasonOf(watch), v1::ERROR_REASON_DEADLINE_EXCEEDED);
  EXPECT_TRUE(absl::StrContains(watch.message(), "watch of a scene")) << watch;
  EXPECT_TRUE(absl::StrContains(watch.message(), "max_stream_stall = 7 s")) << watch;
  EXPECT_FALSE(absl::StrContains(watch.message(), "credit")) << watch;
  EXPECT_FALSE(absl::StrContains(watch.message(), "target-reply")) << watch;
}

// A new limit has a line above, or a reason why none is needed.
TEST(LimitErrorsTest, NoLimitIsLeftOut) {
  const std::map<std::string, std::string> others = {
      {"target_reply_bytes", "cuts replies"},
      {"max_concurrent_streams", "more wait in the client"},
      {"stream_credit_rays", "CREDIT_EXCEEDED, server_stream_rules_test.cc"},
      {"min_item_cost_rays", "refuses nothing"},
      {"max_lease_seconds", "INVALID_FIELD"},
      {"max_pin_seconds", "INVALID_FIELD"},
      {"max_connections", "closes connections"},
      {"max_connections_per_address", "closes connections"},
      {"max_upload_idle_seconds", "DEADLINE_EXCEEDED, server_upload_limits_test.cc"},
      {"max_stream_stall_seconds", "DEADLINE_EXCEEDED, server_stream_rules_test.cc"},
  };
  std::set<std::string> covered;
  for (const Case& c : Cases()) covered.insert(c.limit);
  for (const LimitEntry& entry : LimitTable()) {
    const std::string name(entry.name);
    EXPECT_NE(covered.contains(name), others.contains(name)) << name;
  }
}

}  // namespace
}  // namespace sightline
