// SPDX-License-Identifier: Apache-2.0
//
// A scene that is deleted while somebody is about it, and another of its name and revision: what
// was begun with the one never goes on with the other.
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "gtest/gtest.h"
#include "tests/integration/server_harness.h"
#include "tests/support/http_get.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using testing_support::Until;

constexpr auto kNotAsItWas = grpc::StatusCode::FAILED_PRECONDITION;

class SameNameTest : public ::testing::Test {
 protected:
  SameNameTest() : harness_(Options()) { Make("builtin:box:1000"); }

  static ServerOptions Options() {
    ServerOptions options;
    options.threads = 1;
    options.build_threads = 1;
    options.metrics_listen = "127.0.0.1:0";
    return options;
  }
  // The hall, revision 1.
  void Make(const std::string& spec) {
    v1::Scene scene;
    const grpc::Status status = harness_.CreateBuiltin("hall", spec, &scene);
    ASSERT_TRUE(status.ok()) << status.error_message();
    ASSERT_EQ(scene.revision(), 1);
  }
  void Delete() {
    const absl::Status status = harness_.server->scenes().Delete("hall");
    ASSERT_TRUE(status.ok()) << status;
  }
  // Another one in its stead.
  void Replace() {
    Delete();
    Make("builtin:sphere:2000");
  }
  uint64_t PointSetBytes() const {
    constexpr absl::string_view kName = "sightline_point_set_bytes ";
    const std::string page =
        testing_support::HttpGet(harness_.server->metrics_port(), "/metrics").body;
    for (absl::string_view line : absl::StrSplit(page, '\n')) {
      double value = 0;
      if (absl::ConsumePrefix(&line, kName) && absl::SimpleAtod(line, &value)) {
        return static_cast<uint64_t>(value);
      }
    }
    ADD_FAILURE() << "the metrics do not say what point sets hold";
    return 0;
  }
  int PointSets() const {
    grpc::ClientContext context;
    v1::ListPointSetsRequest request;
    request.set_parent("scenes/hall");
    v1::ListPointSetsResponse response;
    const grpc::Status status = harness_.point_sets->ListPointSets(&context, request, &response);
    EXPECT_TRUE(status.ok()) << status.error_message();
    return response.point_sets_size();
  }

  ServerHarness harness_;
};

TEST_F(SameNameTest, AStreamThatMayNotPinItsRevisionAnyMoreStaysWithItsScene) {
  const auto ask = [&](bool replace) {
    v1::TestSegmentsRequest request;
    v1::StreamHeader* const header = request.mutable_header()->mutable_stream();
    header->set_scene("scenes/hall");
    header->set_revision(1);
    header->mutable_max_pin_duration()->set_nanos(1);
    SegmentStream stream(harness_, request);
    v1::TestSegmentsResponse response;
    EXPECT_TRUE(stream.Read(&response));
    EXPECT_EQ(response.opened().revision(), 1);
    if (replace) {
      const std::weak_ptr<const Scene> pinned = *harness_.server->scenes().Pin("hall", 1);
      Delete();
      EXPECT_TRUE(Until("the pin's time is up", [&] { return pinned.expired(); }));
      Make("builtin:sphere:2000");
    }
    request.mutable_item()->mutable_item()->set_item_id(7);
    request.mutable_item()->set_segments(PackArray({0.0, 0.0, 0.0, 9.0, 9.0, 9.0}));
    stream.Write(request);
    EXPECT_TRUE(stream.Read(&response));
    return response.reply().header();
  };
  // Its time is up or not: the revision is still current.
  EXPECT_EQ(ask(/*replace=*/false).status().code(), 0);
  const v1::ReplyHeader reply = ask(/*replace=*/true);
  EXPECT_EQ(reply.status().code(), kNotAsItWas) << reply.status().message();
  EXPECT_EQ(reply.status().reason(), v1::ERROR_REASON_REVISION_MISMATCH);
  EXPECT_EQ(reply.revision(), 0);
}

// Its points' sources are triangles of the scene that they were uploaded for.
TEST_F(SameNameTest, APointSetIsOfTheSceneThatItsUploadBeganWith) {
  constexpr uint64_t kPoints = 1000;
  for (const bool replace : {false, true}) {
    grpc::ClientContext context;
    v1::PointSet set;
    const auto writer = harness_.point_sets->CreatePointSet(&context, &set);
    v1::CreatePointSetRequest request;
    request.mutable_header()->set_parent("scenes/hall");
    request.mutable_header()->mutable_upload()->set_point_count(kPoints);
    writer->Write(request);
    request.mutable_chunk()->set_points(PackArray(std::vector<Vec3d>(kPoints)));
    writer->Write(request);
    ASSERT_TRUE(Until("the points have arrived",
                      [&] { return PointSetBytes() >= kPoints * sizeof(Vec3d); }));
    if (replace) Replace();
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    if (replace) {
      EXPECT_EQ(status.error_code(), kNotAsItWas) << status.error_message();
      EXPECT_EQ(ReasonIn(status), "REVISION_MISMATCH");
      EXPECT_EQ(PointSets(), 0);
    } else {
      EXPECT_TRUE(status.ok()) << status.error_message();
      EXPECT_EQ(PointSets(), 1);
      ASSERT_TRUE(
          Until("the upload is gone", [&] { return PointSetBytes() == set.resident_bytes(); }));
      ASSERT_TRUE(harness_.server->scenes().Delete("hall").ok());
      Make("builtin:box:1000");
    }
  }
}

TEST_F(SameNameTest, AnEditIsOfTheSceneWhoseRevisionItNames) {
  constexpr uint64_t kVertices = 10'000;
  for (const bool replace : {false, true}) {
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = harness_.scenes->UpdateScene(&context, &scene);
    v1::UpdateSceneRequest request;
    request.mutable_header()->set_name("scenes/hall");
    request.mutable_header()->set_base_revision(1);
    writer->Write(request);
    request.mutable_add_object()->set_object_name("more");
    request.mutable_add_object()->set_triangle_count(1);
    request.mutable_add_object()->set_vertex_count(kVertices);
    writer->Write(request);
    const uint64_t before =
        harness_.server->scenes().Get("hall")->status.latest->report.memory_bytes;
    request.mutable_chunk()->set_vertices_f64(PackArray(std::vector<Vec3d>(kVertices)));
    request.mutable_chunk()->set_indices(PackArray<uint32_t>({0, 1, 2}));
    writer->Write(request);
    ASSERT_TRUE(Until("the edit has arrived", [&] {
      return harness_.server->scenes().MemoryBytes() >= before + kVertices * sizeof(Vec3d);
    }));
    if (replace) Replace();
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    if (replace) {
      EXPECT_EQ(status.error_code(), kNotAsItWas) << status.error_message();
      EXPECT_EQ(ReasonIn(status), "REVISION_MISMATCH");
    } else {
      EXPECT_TRUE(status.ok()) << status.error_message();
      EXPECT_EQ(scene.revision(), 2);
      Replace();
    }
  }
  EXPECT_EQ(harness_.server->scenes().Get("hall")->status.latest->revision, 1u);
}

// Not in time to be taken away with it, and found under the name of another.
TEST_F(SameNameTest, APointSetDoesNotOutliveAScene) {
  grpc::ClientContext context;
  v1::PointSet set;
  v1::CreatePointSetRequest request;
  request.mutable_header()->set_parent("scenes/hall");
  EncodeTestCamera(ViewCamera(FirstView("box:1000"), 512, 512),
                   request.mutable_header()->mutable_camera()->mutable_camera());
  request.mutable_header()->mutable_camera()->mutable_options()->set_strategy(
      v1::STRATEGY_BRUTE_FORCE);
  const auto writer = harness_.point_sets->CreatePointSet(&context, &set);
  writer->WriteLast(request, grpc::WriteOptions());
  ASSERT_TRUE(
      Until("the points are being traced", [&] { return harness_.server->queued_rays() > 0; }));
  Delete();
  const grpc::Status status = writer->Finish();
  // Unless it was made before the deletion: then that took it away.
  EXPECT_TRUE(status.ok() || ReasonIn(status) == "SCENE_NOT_FOUND") << status.error_message();
  ASSERT_TRUE(Until("no call is under way", [&] { return harness_.server->active_calls() == 0; }));
  EXPECT_EQ(PointSetBytes(), 0u);
  Make("builtin:box:1000");
  EXPECT_EQ(PointSets(), 0);
}

}  // namespace
}  // namespace sightline
