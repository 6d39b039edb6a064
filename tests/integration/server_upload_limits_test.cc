// SPDX-License-Identifier: Apache-2.0
//
// Uploads whose clients stall, bring too much, or are too many, and connections that nobody uses:
// what they hold is bounded and comes back, whichever way they end.
#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/server_harness.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/temp_dir.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

constexpr auto kOver = grpc::StatusCode::RESOURCE_EXHAUSTED;

// An upload that its client leaves open.
template <typename Request, typename Response>
class OpenUpload {
 public:
  using Opener =
      std::function<std::unique_ptr<grpc::ClientWriter<Request>>(grpc::ClientContext*, Response*)>;

  explicit OpenUpload(const Opener& open) {
    // So that a server that never ends it fails a test.
    context_.set_deadline(absl::ToChronoTime(absl::Now() + absl::Minutes(1)));
    writer_ = open(&context_, &response_);
  }
  ~OpenUpload() {
    if (writer_ == nullptr) return;
    context_.TryCancel();
    writer_->Finish();
  }
  // False once the server has ended it.
  bool Write(const Request& message) { return writer_->Write(message); }
  void Cancel() { context_.TryCancel(); }
  // Without an end of the client's: waits for the server's.
  grpc::Status Finish() {
    const grpc::Status status = writer_->Finish();
    writer_ = nullptr;
    return status;
  }
  grpc::Status End() {
    writer_->WritesDone();
    return Finish();
  }

 private:
  grpc::ClientContext context_;
  Response response_;
  std::unique_ptr<grpc::ClientWriter<Request>> writer_;
};
using OpenScene = OpenUpload<v1::CreateSceneRequest, v1::Scene>;
using OpenEdit = OpenUpload<v1::UpdateSceneRequest, v1::Scene>;
using OpenPoints = OpenUpload<v1::CreatePointSetRequest, v1::PointSet>;

class UploadLimitsTest : public ::testing::Test {
 protected:
  void Start(const std::function<void(ServerOptions*)>& change) {
    ServerOptions options;
    options.threads = 1;
    options.build_threads = 1;
    change(&options);
    harness_ = std::make_unique<ServerHarness>(options);
  }
  std::unique_ptr<OpenScene> CreateScene() {
    return std::make_unique<OpenScene>(
        [&](grpc::ClientContext* c, v1::Scene* r) { return harness_->scenes->CreateScene(c, r); });
  }
  std::unique_ptr<OpenEdit> UpdateScene() {
    return std::make_unique<OpenEdit>(
        [&](grpc::ClientContext* c, v1::Scene* r) { return harness_->scenes->UpdateScene(c, r); });
  }
  std::unique_ptr<OpenPoints> CreatePoints() {
    return std::make_unique<OpenPoints>([&](grpc::ClientContext* c, v1::PointSet* r) {
      return harness_->point_sets->CreatePointSet(c, r);
    });
  }
  // A scene of a wall, made.
  void MakeWall() {
    v1::Scene scene;
    const grpc::Status status = harness_->CreateScene(WallUpload("wall"), &scene);
    ASSERT_TRUE(status.ok()) << status.error_message();
  }
  uint64_t SceneBytes() const { return harness_->server->scenes().MemoryBytes(); }
  void WaitForSceneBytes(uint64_t least) const {
    ASSERT_TRUE(
        testing_support::Until("the upload has arrived", [&] { return SceneBytes() >= least; }));
  }
  void WaitUntilIdle() const {
    ASSERT_TRUE(testing_support::Until("no call is under way",
                                       [&] { return harness_->server->active_calls() == 0; }));
  }
  // Ends those uploads that wait as if max_upload_idle had passed, until there are no calls.
  void EndWaitingUploads() const {
    ASSERT_TRUE(testing_support::Until("the uploads have ended", [&] {
      harness_->server->EndIdleUploads(IdleClock::Now() + std::chrono::seconds(61));
      return harness_->server->active_calls() == 0;
    }));
  }

  std::unique_ptr<ServerHarness> harness_;
};

v1::CreateSceneRequest SceneHeaderOf(const std::string& id, uint64_t vertices) {
  v1::CreateSceneRequest request;
  request.mutable_header()->set_scene_id(id);
  request.mutable_header()->mutable_upload()->set_object_count(1);
  request.mutable_header()->mutable_upload()->set_triangle_count(1);
  request.mutable_header()->mutable_upload()->set_vertex_count(vertices);
  return request;
}
v1::CreateSceneRequest ObjectOf(uint64_t vertices) {
  v1::CreateSceneRequest request;
  request.mutable_object()->set_triangle_count(1);
  request.mutable_object()->set_vertex_count(vertices);
  return request;
}
// A mebibyte of vertices, or nearly.
constexpr uint64_t kChunkVertices = 43'000;
std::string ChunkVertices() { return std::string(24 * kChunkVertices, '\0'); }

v1::UpdateSceneRequest EditHeaderOf(const std::string& name) {
  v1::UpdateSceneRequest request;
  request.mutable_header()->set_name(name);
  return request;
}

void ExpectIdle(const grpc::Status& status, const char* limit = "max_upload_idle = 60 s") {
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << status.error_message();
  EXPECT_EQ(ReasonIn(status), "DEADLINE_EXCEEDED");
  EXPECT_THAT(status.error_message(), HasSubstr(limit));
  EXPECT_THAT(status.error_message(), HasSubstr("--max-upload-idle-seconds"));
}

TEST_F(UploadLimitsTest, StalledOnesEndAndGiveBackWhatTheyHeld) {
  Start([](ServerOptions* options) { options->limits.max_concurrent_uploads = 3; });
  MakeWall();
  WaitUntilIdle();
  const uint64_t before = SceneBytes();
  const auto scene = CreateScene();
  const auto edit = UpdateScene();
  const auto points = CreatePoints();
  scene->Write(SceneHeaderOf("other", kChunkVertices));
  scene->Write(ObjectOf(kChunkVertices));
  edit->Write(EditHeaderOf("scenes/wall"));
  v1::CreatePointSetRequest request;
  request.mutable_header()->set_parent("scenes/wall");
  request.mutable_header()->mutable_upload()->set_point_count(2);
  points->Write(request);
  ASSERT_TRUE(testing_support::Until("all three have come",
                                     [&] { return harness_->server->active_calls() == 3; }));
  EndWaitingUploads();
  ExpectIdle(scene->Finish());
  ExpectIdle(edit->Finish());
  ExpectIdle(points->Finish());
  EXPECT_EQ(SceneBytes(), before);
  // Their slots are free, and so is the name that was asked for.
  v1::Scene made;
  const grpc::Status again = harness_->CreateScene(WallUpload("other"), &made);
  EXPECT_TRUE(again.ok()) << again.error_message();
}

TEST_F(UploadLimitsTest, ADrainEndsStalledOnesWhenItIsOver) {
  Start([](ServerOptions*) {});  // They may stall for a minute.
  const auto scene = CreateScene();
  scene->Write(SceneHeaderOf("hall", 3));
  WaitForSceneBytes(1);
  EXPECT_EQ(harness_->server->Drain(absl::Milliseconds(200)).code(),
            absl::StatusCode::kDeadlineExceeded);
  EXPECT_EQ(harness_->server->active_calls(), 0u);
  EXPECT_EQ(SceneBytes(), 0u);
  EXPECT_FALSE(scene->Finish().ok());
}

TEST_F(UploadLimitsTest, ADrainIsOverWhenTheStalledOnesAre) {
  Start([](ServerOptions*) {});
  const auto scene = CreateScene();
  scene->Write(SceneHeaderOf("hall", 3));
  WaitForSceneBytes(1);
  absl::Status drained;
  std::thread drain([&] { drained = harness_->server->Drain(absl::Minutes(2)); });
  EndWaitingUploads();
  drain.join();
  EXPECT_TRUE(drained.ok()) << drained;
  ExpectIdle(scene->Finish());
}

TEST_F(UploadLimitsTest, TheServerLooksForStalledOnesByItself) {
  Start([](ServerOptions* options) { options->limits.max_upload_idle_seconds = 1; });
  const auto scene = CreateScene();
  scene->Write(SceneHeaderOf("hall", 3));
  ExpectIdle(scene->Finish(), "max_upload_idle = 1 s");
}

// The client of a scene that is being stored when the server stops hears of no success, and nothing
// is left of the file.
TEST_F(UploadLimitsTest, AServerThatStopsGivesUpWhatItIsStoring) {
  const testing_support::TempDir dir;
  testing_support::FaultyFileCalls calls;
  Start([&](ServerOptions* options) {
    options->repository = dir.path();
    options->files = &calls;
  });
  std::promise<void> storing, ended;
  std::atomic<bool> first = true;
  calls.on_write = [&, end = ended.get_future().share()] {
    if (first.exchange(false)) storing.set_value();
    end.wait();
  };
  grpc::Status made;
  std::thread maker([&] {
    v1::Scene scene;
    made = harness_->CreateScene(WallUpload("wall"), &scene);
    ended.set_value();
  });
  storing.get_future().wait();
  harness_->server->Shutdown();
  maker.join();
  EXPECT_FALSE(made.ok());
  EXPECT_EQ(harness_->server->active_calls(), 0u);
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
  harness_.reset();  // Before the folder goes.
}

// One after the other is one at once, however soon the next follows and however the last one ended.
TEST_F(UploadLimitsTest, UploadsAndStreamsInARowAreOneAtATime) {
  Start([](ServerOptions* options) {
    options->limits.max_concurrent_uploads = 1;
    options->limits.max_concurrent_uploads_per_client = 1;
    options->limits.max_streams_per_client = 1;
  });
  MakeWall();
  v1::CreateSceneRequest bad_name;
  bad_name.mutable_header()->set_scene_id("a/b");
  v1::TestSegmentsRequest header;
  header.mutable_header()->mutable_stream()->set_scene("scenes/wall");
  for (int i = 0; i < 100; ++i) {
    v1::Scene scene;
    const grpc::Status made =
        harness_->CreateScene(WallUpload(absl::StrCat("wall", i % 2 == 0 ? i : 0)), &scene);
    EXPECT_EQ(ReasonIn(made), i % 2 == 0 ? "" : "ALREADY_EXISTS") << made.error_message();
    const auto refused = CreateScene();
    refused->Write(bad_name);
    const grpc::Status status = refused->Finish();
    EXPECT_EQ(ReasonIn(status), "INVALID_FIELD") << status.error_message();
    const auto edit = UpdateScene();
    edit->Write(EditHeaderOf("scenes/none"));
    const grpc::Status none = edit->Finish();
    EXPECT_EQ(ReasonIn(none), "SCENE_NOT_FOUND") << none.error_message();
    SegmentStream stream(*harness_, header);
    stream.HalfClose();
    v1::TestSegmentsResponse response;
    EXPECT_TRUE(stream.Read(&response));
    EXPECT_FALSE(stream.Read(&response));
    const grpc::Status closed = stream.Finish();
    EXPECT_TRUE(closed.ok()) << closed.error_message();
  }
}

TEST_F(UploadLimitsTest, WhatArrivesCountsAndComesBack) {
  Start([](ServerOptions* options) {
    options->limits.max_scene_bytes = options->limits.max_bytes_per_scene = 24 << 20;
  });
  constexpr uint64_t kVertices = 8 * kChunkVertices;
  v1::CreateSceneRequest chunk;
  chunk.mutable_chunk()->set_vertices_f64(ChunkVertices());
  const auto first = CreateScene();
  first->Write(SceneHeaderOf("first", kVertices));
  first->Write(ObjectOf(kVertices));
  for (int i = 0; i < 8; ++i) ASSERT_TRUE(first->Write(chunk));
  WaitForSceneBytes(24 * kVertices);
  // Beside it there is no room for another such, which is told of it before it sends any.
  const auto second = CreateScene();
  second->Write(SceneHeaderOf("second", 2 * kVertices));
  const grpc::Status refused = second->Finish();
  EXPECT_EQ(refused.error_code(), kOver) << refused.error_message();
  EXPECT_EQ(ReasonIn(refused), "OUT_OF_MEMORY_BUDGET");
  EXPECT_THAT(refused.error_message(), HasSubstr("max_scene_bytes = 25165824: delete or unload"));
  first->Cancel();
  first->Finish();
  WaitUntilIdle();
  EXPECT_EQ(SceneBytes(), 0u);
}

TEST_F(UploadLimitsTest, AnEditIsStoppedAsItArrives) {
  Start([](ServerOptions* options) {
    options->limits.max_scene_bytes = options->limits.max_bytes_per_scene = 8 << 20;
  });
  MakeWall();
  const uint64_t before = SceneBytes();
  {
    // New vertices are not announced as a growth of the scene; they arrive all the same.
    const auto edit = UpdateScene();
    edit->Write(EditHeaderOf("scenes/wall"));
    v1::UpdateSceneRequest request;
    request.mutable_replace_vertices()->set_object_name("wall");
    request.mutable_replace_vertices()->set_vertex_count(1000 * kChunkVertices);
    edit->Write(request);
    request.mutable_chunk()->set_vertices_f64(ChunkVertices());
    int sent = 0;
    while (sent < 1000 && edit->Write(request)) ++sent;
    EXPECT_LT(sent, 1000);
    const grpc::Status status = edit->Finish();
    EXPECT_EQ(status.error_code(), kOver) << status.error_message();
    EXPECT_EQ(ReasonIn(status), "OUT_OF_MEMORY_BUDGET");
    EXPECT_THAT(status.error_message(), HasSubstr("max_scene_bytes is 8388608: "));
  }
  {
    // What is announced is refused before any of it is sent.
    const auto edit = UpdateScene();
    edit->Write(EditHeaderOf("scenes/wall"));
    v1::UpdateSceneRequest request;
    request.mutable_add_object()->set_triangle_count(1'000'000);
    request.mutable_add_object()->set_vertex_count(3);
    edit->Write(request);
    const grpc::Status status = edit->Finish();
    EXPECT_EQ(status.error_code(), kOver) << status.error_message();
    EXPECT_THAT(status.error_message(), HasSubstr("max_scene_bytes = 8388608: "));
  }
  WaitUntilIdle();
  EXPECT_EQ(SceneBytes(), before);
}

TEST_F(UploadLimitsTest, PointsCountAgainstTheirOwnBudget) {
  Start([](ServerOptions* options) { options->limits.max_point_set_bytes = 1 << 20; });
  MakeWall();
  const auto points = [](uint64_t count) {
    v1::CreatePointSetRequest request;
    request.mutable_header()->set_parent("scenes/wall");
    request.mutable_header()->mutable_upload()->set_point_count(count);
    return request;
  };
  const auto first = CreatePoints();
  first->Write(points(20'000));
  v1::CreatePointSetRequest chunk;
  chunk.mutable_chunk()->set_points(std::string(24 * 10'000, '\0'));
  // Normals count, too, though the header does not tell of them.
  chunk.mutable_chunk()->set_normals(std::string(24 * 10'000, '\0'));
  first->Write(chunk);
  first->Write(chunk);
  first->Write(chunk);  // One too many, to be told that all have arrived.
  const grpc::Status over = first->Finish();
  EXPECT_EQ(over.error_code(), kOver) << over.error_message();
  EXPECT_THAT(over.error_message(), HasSubstr("max_point_set_bytes = 1048576: delete"));
  WaitUntilIdle();
  // It gave all of it back.
  const auto second = CreatePoints();
  second->Write(points(20'000));
  chunk.mutable_chunk()->clear_normals();
  second->Write(chunk);
  second->Write(chunk);
  const grpc::Status status = second->End();
  EXPECT_TRUE(status.ok()) << status.error_message();
}

TEST_F(UploadLimitsTest, AClientHasItsShareOfUploadsAndStreams) {
  Start([](ServerOptions* options) {
    options->limits.max_concurrent_uploads_per_client = 1;
    options->limits.max_streams_per_client = 1;
  });
  MakeWall();
  const uint64_t before = SceneBytes();
  const auto first = CreateScene();
  first->Write(SceneHeaderOf("hall", 3));
  WaitForSceneBytes(before + 1);
  const grpc::Status refused = CreateScene()->Finish();
  EXPECT_EQ(refused.error_code(), kOver) << refused.error_message();
  EXPECT_EQ(ReasonIn(refused), "QUOTA_EXCEEDED");
  EXPECT_THAT(refused.error_message(), HasSubstr("max_concurrent_uploads_per_client = 1: try"));

  v1::TestSegmentsRequest request;
  request.mutable_header()->mutable_stream()->set_scene("scenes/wall");
  SegmentStream stream(*harness_, request);
  v1::TestSegmentsResponse response;
  ASSERT_TRUE(stream.Read(&response));  // It is open.
  SegmentStream other(*harness_, request);
  EXPECT_FALSE(other.Read(&response));
  const grpc::Status closed = other.Finish();
  EXPECT_EQ(ReasonIn(closed), "QUOTA_EXCEEDED") << closed.error_message();
  EXPECT_THAT(closed.error_message(), HasSubstr("max_streams_per_client = 1: try"));
}

TEST(ConnectionIdleTest, ConnectionsThatNobodyUsesAreClosedAndMadeAnew) {
  ServerOptions options;
  options.connection_idle_timeout = absl::Milliseconds(100);
  ServerHarness harness(options);
  const auto call = [&harness] {
    grpc::ClientContext context;
    v1::Capabilities capabilities;
    return harness.capabilities->GetCapabilities(&context, {}, &capabilities).ok();
  };
  ASSERT_TRUE(call());
  EXPECT_TRUE(harness.channel->WaitForStateChange(
      GRPC_CHANNEL_READY, absl::ToChronoTime(absl::Now() + absl::Minutes(1))));
  EXPECT_TRUE(call());
  // A connection with a call on it is in use, however quiet it is.
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateScene(WallUpload("wall"), &scene).ok());
  grpc::ClientContext context;
  v1::WatchSceneRequest watch;
  watch.set_name("scenes/wall");
  const auto watcher = harness.scenes->WatchScene(&context, watch);
  v1::WatchSceneResponse state;
  ASSERT_TRUE(watcher->Read(&state));
  // Others that come after it and have no call are closed while it stays.
  for (int i = 0; i < 2; ++i) {
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    const auto other = grpc::CreateCustomChannel(absl::StrCat("127.0.0.1:", harness.server->port()),
                                                 grpc::InsecureChannelCredentials(), arguments);
    grpc::ClientContext asked;
    v1::Capabilities capabilities;
    const auto stub = v1::CapabilityService::NewStub(other);
    ASSERT_TRUE(stub->GetCapabilities(&asked, {}, &capabilities).ok());
    EXPECT_TRUE(other->WaitForStateChange(GRPC_CHANNEL_READY,
                                          absl::ToChronoTime(absl::Now() + absl::Minutes(1))));
  }
  EXPECT_EQ(harness.channel->GetState(/*try_to_connect=*/false), GRPC_CHANNEL_READY);
  context.TryCancel();
  watcher->Finish();
}

}  // namespace
}  // namespace sightline
