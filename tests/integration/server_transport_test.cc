// SPDX-License-Identifier: Apache-2.0
//
// What HTTP/2 and gRPC would let one client do to the real server, and it does not: send messages
// that expand as they are read, and keep calls without end on one connection.
#include <grpc/compression.h>
#include <grpcpp/generic/generic_stub.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "server/codec/wire_format.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/serving_process.h"
#include "tests/support/http_get.h"
#include "tests/support/test_scale.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using testing_support::MetricOf;
using testing_support::Until;

double ActiveCalls(const ServingProcess& server) {
  return MetricOf(server.metrics_port(), "sightline_active_calls");
}

// A quarter of a gibibyte of zeros is a quarter of a mebibyte on the wire. The server refuses it by
// the name of its compression, before anything is expanded; a limit on a message's length alone
// would come too late.
TEST(TransportTest, BombsAreNotExpanded) {
  ServingProcess server({"--scene=box=builtin:box:1000"});
  constexpr uint64_t kExpanded = uint64_t{256} << 20;
  const std::string zeros(kExpanded, '\0');
  v1::TestSegmentsRequest segments;
  segments.mutable_item()->set_segments(zeros);
  v1::CreateSceneRequest mesh;
  mesh.mutable_chunk()->set_vertices_f64(zeros);
  const auto channel = server.Channel();
  const uint64_t before = server.PeakResidentBytes();
  for (const grpc_compression_algorithm algorithm : {GRPC_COMPRESS_GZIP, GRPC_COMPRESS_DEFLATE}) {
    {
      grpc::ClientContext context;
      context.set_compression_algorithm(algorithm);
      const auto stream = v1::VisibilityService::NewStub(channel)->TestSegments(&context);
      v1::TestSegmentsRequest header;
      header.mutable_header()->mutable_stream()->set_scene("scenes/box");
      stream->Write(header);
      stream->Write(segments);
      stream->WritesDone();
      v1::TestSegmentsResponse response;
      while (stream->Read(&response)) {
      }
      const grpc::Status status = stream->Finish();
      EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
    }
    grpc::ClientContext context;
    context.set_compression_algorithm(algorithm);
    v1::Scene scene;
    const auto writer = v1::SceneService::NewStub(channel)->CreateScene(&context, &scene);
    writer->Write(WallUpload("wall")[0]);
    writer->Write(mesh);
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED) << status.error_message();
  }
  if (!testing_support::kSanitizerBuild) {
    EXPECT_LT(server.PeakResidentBytes(), before + kExpanded / 8);
  }
  server.Signal(SIGTERM);
  EXPECT_EQ(server.Wait(), 0);
}

// A call with one message of these bytes, whatever they are.
grpc::Status CallWith(const std::shared_ptr<grpc::Channel>& channel, const std::string& method,
                      const std::string& message) {
  grpc::GenericStub stub(channel);
  grpc::ClientContext context;
  // So that a server that never ends it fails a test.
  context.set_deadline(std::chrono::system_clock::now() + std::chrono::minutes(1));
  const grpc::Slice slice(message);
  const grpc::ByteBuffer request(&slice, 1);
  grpc::ByteBuffer response;
  std::promise<grpc::Status> ended;
  stub.UnaryCall(&context, method, grpc::StubOptions(), &request, &response,
                 [&](grpc::Status status) { ended.set_value(std::move(status)); });
  return ended.get_future().get();
}

// Four megabytes of fields that nobody knows, two bytes each, which protobuf keeps in seventy.
TEST(TransportTest, UnknownFieldsOfUploadsTakeNoMemory) {
  ServingProcess server({"--scene=box=builtin:box:1000"});
  constexpr size_t kBytes = 4'000'000;
  std::string junk;
  while (junk.size() < kBytes) AppendLengthHead(15, 0, &junk);
  v1::CreateSceneRequest scene;
  v1::UpdateSceneRequest edit;
  v1::CreatePointSetRequest points;
  scene.mutable_header()->mutable_builtin()->set_spec("builtin:box:1000");
  edit.mutable_header()->set_name("scenes/none");
  points.mutable_header()->set_parent("scenes/none");
  points.mutable_header()->mutable_upload()->set_point_count(1);
  const auto channel = server.Channel();
  const auto call = [&](const std::string& method, const std::string& message) {
    return CallWith(channel, absl::StrCat("/sightline.v1.", method), message);
  };
  ASSERT_TRUE(call("SceneService/CreateScene", scene.SerializeAsString()).ok());
  const uint64_t before = server.PeakResidentBytes();
  const grpc::Status made = call("SceneService/CreateScene", scene.SerializeAsString() + junk);
  EXPECT_TRUE(made.ok()) << made.error_message();
  const grpc::Status edited = call("SceneService/UpdateScene", edit.SerializeAsString() + junk);
  EXPECT_EQ(ReasonIn(edited), "SCENE_NOT_FOUND") << edited.error_message();
  const grpc::Status set =
      call("PointSetService/CreatePointSet", points.SerializeAsString() + junk);
  EXPECT_EQ(ReasonIn(set), "SCENE_NOT_FOUND") << set.error_message();
  if (!testing_support::kSanitizerBuild) {
    EXPECT_LT(server.PeakResidentBytes(), before + 8 * kBytes);
  }
  // What is no message at all is said to be none, with its length.
  const grpc::Status none = call("SceneService/CreateScene", junk + "\xff");
  EXPECT_EQ(ReasonIn(none), "INVALID_FIELD") << none.error_message();
  EXPECT_EQ(none.error_message(),
            "message = 4000001 bytes: must be a sightline.v1.CreateSceneRequest");
}

// An open stream of tiles.
struct OpenStream {
  explicit OpenStream(const std::shared_ptr<grpc::Channel>& channel)
      : stub(v1::VisibilityService::NewStub(channel)) {
    // So that one that never opens fails a test.
    context.set_deadline(std::chrono::system_clock::now() + std::chrono::minutes(1));
  }
  bool Opens() {
    stream = stub->TraceTiles(&context);
    return stream->Write(BoxHeader()) && stream->Read(&response) && response.has_opened();
  }
  bool Answers() {
    return stream->Write(TileRequest(1, 0, 0, 16, 16)) && stream->Read(&response) &&
           response.reply().header().status().code() == 0;
  }
  grpc::Status End() {
    stream->WritesDone();
    while (stream->Read(&response)) {
    }
    return stream->Finish();
  }

  const std::unique_ptr<v1::VisibilityService::Stub> stub;
  grpc::ClientContext context;
  std::unique_ptr<grpc::ClientReaderWriter<v1::TraceTilesRequest, v1::TraceTilesResponse>> stream;
  v1::TraceTilesResponse response;
};

// One call more than a connection may carry waits in its client, and comes when another ends. Calls
// of one connection reach the server in order: what the others ask for after it is answered first.
TEST(TransportTest, OneCallTooManyWaitsForAnotherToEnd) {
  ServingProcess server({"--scene=box=builtin:box:1000", "--metrics-listen=127.0.0.1:0"});
  const auto channel = server.Channel();
  uint64_t most = 0;
  {
    grpc::ClientContext context;
    v1::Capabilities capabilities;
    ASSERT_TRUE(
        v1::CapabilityService::NewStub(channel)->GetCapabilities(&context, {}, &capabilities).ok());
    most = capabilities.limits().max_concurrent_streams();
    ASSERT_GT(most, 0u);
  }
  std::vector<std::unique_ptr<OpenStream>> streams;
  for (uint64_t i = 0; i < most; ++i) {
    streams.push_back(std::make_unique<OpenStream>(channel));
    ASSERT_TRUE(streams.back()->Opens()) << i;
  }
  OpenStream more(channel);
  std::atomic<bool> begun = false, opened = false;
  std::thread opener([&] {
    begun = true;
    opened = more.Opens();
  });
  EXPECT_TRUE(Until("the thread runs", [&] { return begun.load(); }));
  for (int round = 0; round < 5; ++round) {
    for (const auto& stream : streams) EXPECT_TRUE(stream->Answers());
    EXPECT_EQ(ActiveCalls(server), static_cast<double>(most));
  }
  EXPECT_FALSE(opened);
  EXPECT_TRUE(streams.front()->End().ok());
  opener.join();
  EXPECT_TRUE(opened);
  EXPECT_TRUE(more.Answers());
  EXPECT_TRUE(more.End().ok());
  for (size_t i = 1; i < streams.size(); ++i) EXPECT_TRUE(streams[i]->End().ok());
}

// A client that was told so and goes beyond it all the same loses its connection, and all of its
// calls end.
TEST(TransportTest, WhoOpensOneCallTooManyIsCutOff) {
  ServingProcess server({"--max-concurrent-streams=10", "--metrics-listen=127.0.0.1:0"});
  constexpr char kPath[] = "/sightline.v1.VisibilityService/TraceTiles";
  const RawConnection client(server.port());
  ASSERT_TRUE(client.connected());
  client.Send(ConnectionBytes());
  ASSERT_EQ(client.FateWithin(absl::Minutes(1)), RawConnection::Fate::kTaken);
  client.Send(SettingsTaken());
  uint32_t stream = 1;
  for (int i = 0; i < 10; ++i, stream += 2) client.Send(OpenCall(stream, kPath));
  EXPECT_TRUE(Until("all calls have come", [&] { return ActiveCalls(server) == 10; }));
  client.Send(OpenCall(stream, kPath));
  EXPECT_TRUE(client.EndsWithin(absl::Minutes(1)));
  EXPECT_TRUE(Until("all calls have ended", [&] { return ActiveCalls(server) == 0; }));
}

// One that never says that it was told is held to that bound by nobody; what lasts is bounded all
// the same, by its client's share.
TEST(TransportTest, WhoHearsOfNoBoundHasAClientsShareOfWatches) {
  ServingProcess server({"--scene=box=builtin:box:1000", "--metrics-listen=127.0.0.1:0",
                         "--max-concurrent-streams=10", "--max-streams-per-client=20"});
  v1::WatchSceneRequest watch;
  watch.set_name("scenes/box");
  constexpr int kCalls = 50;
  {
    const RawConnection client(server.port());
    ASSERT_TRUE(client.connected());
    client.Send(ConnectionBytes());
    for (uint32_t i = 0; i < kCalls; ++i) {
      const uint32_t stream = 2 * i + 1;
      client.Send(absl::StrCat(OpenCall(stream, "/sightline.v1.SceneService/WatchScene"),
                               CallData(stream, watch.SerializeAsString(), /*last=*/true)));
    }
    const std::string refused =
        "sightline_requests_total{method=\"WatchScene\",result=\"rejected\"}";
    EXPECT_TRUE(Until("the others are refused",
                      [&] { return MetricOf(server.metrics_port(), refused) == kCalls - 20; }));
    EXPECT_TRUE(Until("no more are under way", [&] { return ActiveCalls(server) == 20; }));
  }
  EXPECT_TRUE(Until("all calls have ended", [&] { return ActiveCalls(server) == 0; }));
  // What it gives back another may have.
  grpc::ClientContext context;
  const auto watcher = v1::SceneService::NewStub(server.Channel())->WatchScene(&context, watch);
  v1::WatchSceneResponse state;
  EXPECT_TRUE(watcher->Read(&state));
  context.TryCancel();
  watcher->Finish();
}

}  // namespace
}  // namespace sightline
