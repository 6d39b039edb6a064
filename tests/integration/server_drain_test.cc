// SPDX-License-Identifier: Apache-2.0
//
// How the real server ends at SIGTERM: what is under way is answered, plain calls and uploads as
// well as streams, and whoever looks at its readiness hears of the end before anybody is refused.
#include <csignal>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "gtest/gtest.h"
#include "server/version.h"
#include "tests/integration/grid_upload.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/serving_process.h"
#include "tests/support/http_get.h"
#include "tests/support/temp_dir.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using testing_support::HttpGet;
using testing_support::MetricOf;
using testing_support::Until;

constexpr char kMetricsFlag[] = "--metrics-listen=127.0.0.1:0";
// Far longer than any test: nothing here ends because time has passed.
constexpr char kLongDrain[] = "--drain-timeout=1h";

// A connection of its own each time.
grpc::Status GetCapabilities(const ServingProcess& server) {
  grpc::ClientContext context;
  v1::Capabilities capabilities;
  return v1::CapabilityService::NewStub(server.Channel())
      ->GetCapabilities(&context, {}, &capabilities);
}

testing::AssertionResult UntilNotReady(const ServingProcess& server) {
  return Until("the server is not ready any more",
               [&] { return HttpGet(server.metrics_port(), "/readyz").code == 503; });
}

// A plain call whose answer waits for its client to take it: the server has computed it, and it is
// under way until `client` sends a WindowUpdate.
void SendUntakenCall(const ServingProcess& server, const RawConnection& client) {
  client.Send(CallBytes("/sightline.v1.CapabilityService/GetCapabilities", {""},
                        {.whole = true, .initial_window = 0}));
  const std::string answered = "sightline_requests_total{method=\"GetCapabilities\",result=\"ok\"}";
  ASSERT_TRUE(Until("the call is answered",
                    [&] { return MetricOf(server.metrics_port(), answered) == 1; }));
  EXPECT_EQ(MetricOf(server.metrics_port(), "sightline_active_calls"), 1);
}

TEST(DrainTest, AnAnswerThatIsNotYetTakenIsWaitedFor) {
  ServingProcess server({kMetricsFlag, kLongDrain});
  const RawConnection client(server.port());
  ASSERT_TRUE(client.connected());
  SendUntakenCall(server, client);
  server.Signal(SIGTERM);
  ASSERT_TRUE(UntilNotReady(server));
  client.Send(WindowUpdate(1 << 20));
  // The message, then the trailers.
  const std::string reply = client.ReadUntil(absl::StrCat("grpc-status", "\x01", "0"));
  EXPECT_TRUE(absl::StrContains(reply, absl::StrCat("grpc-status", "\x01", "0")));
  EXPECT_TRUE(absl::StrContains(reply, kVersion));
  EXPECT_EQ(server.Wait(), 0);
}

// Both calls have been taken, and wait for the one thread that builds: the first is building, the
// second has not begun.
TEST(DrainTest, CallsThatWaitForTheirTurnAreAnswered) {
  ServingProcess server(
      {kMetricsFlag, kLongDrain, "--build-threads=1", "--scene=old=builtin:box:1000"});
  grpc::Status created, deleted;
  std::thread creator([&] {
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = v1::SceneService::NewStub(server.Channel())->CreateScene(&context, &scene);
    v1::CreateSceneRequest request;
    request.mutable_header()->mutable_builtin()->set_spec("builtin:sphere:1M");
    writer->Write(request);
    writer->WritesDone();
    created = writer->Finish();
  });
  EXPECT_TRUE(Until("the creation is under way", [&] {
    return MetricOf(server.metrics_port(), "sightline_active_calls") >= 1;
  }));
  std::thread deleter([&] {
    grpc::ClientContext context;
    v1::DeleteSceneRequest request;
    request.set_name("scenes/old");
    google::protobuf::Empty empty;
    deleted = v1::SceneService::NewStub(server.Channel())->DeleteScene(&context, request, &empty);
  });
  // Or, on a machine that built faster than this looks, when one is done.
  const auto done = [&](const char* method) {
    return MetricOf(server.metrics_port(), absl::StrCat("sightline_requests_total{method=\"",
                                                        method, "\",result=\"ok\"}")) > 0;
  };
  while (MetricOf(server.metrics_port(), "sightline_active_calls") < 2 && !done("CreateScene") &&
         !done("DeleteScene")) {
  }
  server.Signal(SIGTERM);
  creator.join();
  deleter.join();
  EXPECT_TRUE(created.ok()) << created.error_message();
  EXPECT_TRUE(deleted.ok() || ReasonIn(deleted) == "DRAINING") << deleted.error_message();
  EXPECT_EQ(server.Wait(), 0);
}

// Sends the messages from `begin` to `end`.
template <typename Writer, typename Message>
void SendPart(Writer& writer, const std::vector<Message>& messages, size_t begin, size_t end) {
  for (size_t i = begin; i < end; ++i) ASSERT_TRUE(writer.Write(messages[i])) << i;
}

// An upload, an edit and a point set of which half was sent before the signal: the rest is taken,
// each is answered, and the end has waited for it.
TEST(DrainTest, WhatIsHalfUploadedIsTakenInWhole) {
  const GridUpload grid(100);
  const testing_support::TempDir repository;
  const std::vector<std::string> flags = {kMetricsFlag, kLongDrain, "--repository",
                                          repository.path()};
  {
    ServingProcess server(flags);
    const auto channel = server.Channel();
    const auto scenes = v1::SceneService::NewStub(channel);
    const auto point_sets = v1::PointSetService::NewStub(channel);
    for (const char* id : {"moved", "asked"}) {
      grpc::ClientContext context;
      v1::Scene scene;
      const auto messages = grid.Scene(id, 1);
      const auto writer = scenes->CreateScene(&context, &scene);
      SendPart(*writer, messages, 0, messages.size());
      writer->WritesDone();
      const grpc::Status status = writer->Finish();
      ASSERT_TRUE(status.ok()) << status.error_message();
    }
    const auto upload = grid.Scene("made", 3);
    const auto edit = grid.Move("scenes/moved", 2);
    const auto points = grid.Points("scenes/asked", 0);
    grpc::ClientContext uploading, editing, keeping;
    v1::Scene made, moved;
    v1::PointSet kept;
    const auto upload_writer = scenes->CreateScene(&uploading, &made);
    const auto edit_writer = scenes->UpdateScene(&editing, &moved);
    const auto points_writer = point_sets->CreatePointSet(&keeping, &kept);
    SendPart(*upload_writer, upload, 0, upload.size() / 2);
    SendPart(*edit_writer, edit, 0, edit.size() / 2);
    SendPart(*points_writer, points, 0, points.size() / 2);
    ASSERT_TRUE(Until("all three have come", [&] {
      return MetricOf(server.metrics_port(), "sightline_active_uploads") == 3;
    }));
    server.Signal(SIGTERM);
    ASSERT_TRUE(Until("the server drains", [&] { return server.HasSaid("event=draining"); }));
    EXPECT_EQ(ReasonIn(GetCapabilities(server)), "DRAINING");

    const auto finish = [](auto& writer, const auto& messages) {
      SendPart(writer, messages, messages.size() / 2, messages.size());
      writer.WritesDone();
      const grpc::Status status = writer.Finish();
      EXPECT_TRUE(status.ok()) << status.error_message();
    };
    finish(*points_writer, points);
    EXPECT_EQ(kept.point_count(), grid.vertices());
    finish(*edit_writer, edit);
    EXPECT_TRUE(moved.stored()) << moved.state_message();
    finish(*upload_writer, upload);
    EXPECT_TRUE(made.stored()) << made.state_message();
    EXPECT_EQ(server.Wait(), 0);
  }
  ServingProcess again(flags);
  EXPECT_FALSE(GridBlocks(again.Channel(), "scenes/moved", 1.5));
  EXPECT_TRUE(GridBlocks(again.Channel(), "scenes/moved", 2.5));
  EXPECT_FALSE(GridBlocks(again.Channel(), "scenes/made", 2.5));
  EXPECT_TRUE(GridBlocks(again.Channel(), "scenes/made", 3.5));
}

// Of the server as a whole ("") or of a scene, as the standard health service says it.
client::Health HealthOf(const ServingProcess& server, const std::string& service) {
  const client::Client client(client::MakeConnection(server.address(), {.channels = 1}));
  const absl::StatusOr<client::Health> health = client.CheckHealth(service);
  EXPECT_TRUE(health.ok()) << health.status();
  return health.value_or(client::Health::kUnknown);
}

TEST(DrainTest, ReadinessTurnsBeforeAnybodyIsRefused) {
  ServingProcess server({kMetricsFlag, "--drain-delay=1h", "--scene=box=builtin:box:1000"});
  EXPECT_EQ(HttpGet(server.metrics_port(), "/readyz").code, 200);
  for (const char* service : {"", "scenes/box"}) {
    EXPECT_EQ(HealthOf(server, service), client::Health::kServing) << service;
  }
  EXPECT_EQ(MetricOf(server.metrics_port(), "sightline_draining"), 0);
  server.Signal(SIGTERM);
  ASSERT_TRUE(UntilNotReady(server));
  EXPECT_EQ(MetricOf(server.metrics_port(), "sightline_draining"), 1);
  EXPECT_EQ(HttpGet(server.metrics_port(), "/livez").body, "alive\n");
  const auto expect_not_serving = [&] {
    for (const char* service : {"", "scenes/box"}) {
      EXPECT_EQ(HealthOf(server, service), client::Health::kNotServing) << service;
    }
  };
  // Readiness goes first.
  ASSERT_TRUE(Until("health has turned",
                    [&] { return HealthOf(server, "") == client::Health::kNotServing; }));
  expect_not_serving();
  // Nor does what would end a process that does not expect it.
  server.Signal(SIGHUP);
  for (int i = 0; i < 3; ++i) {
    const grpc::Status status = GetCapabilities(server);
    EXPECT_TRUE(status.ok()) << status.error_message();
  }
  grpc::ClientContext context;
  const auto channel = server.Channel();
  const auto stream = v1::VisibilityService::NewStub(channel)->TraceTiles(&context);
  stream->Write(BoxHeader());
  stream->Write(TileRequest(1, 0, 0, 64, 64));
  v1::TraceTilesResponse response;
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_TRUE(response.has_opened());
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.reply().header().status().code(), 0);
  stream->WritesDone();
  while (stream->Read(&response)) {
  }
  EXPECT_TRUE(stream->Finish().ok());
  // For good, whatever becomes of scenes.
  {
    grpc::ClientContext creating;
    v1::Scene scene;
    const auto writer = v1::SceneService::NewStub(channel)->CreateScene(&creating, &scene);
    for (const auto& message : WallUpload("wall")) writer->Write(message);
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    EXPECT_TRUE(status.ok()) << status.error_message();
  }
  EXPECT_NE(HealthOf(server, "scenes/wall"), client::Health::kServing);
  expect_not_serving();
  // The second one ends it, whatever is left of the delay.
  server.Signal(SIGTERM);
  EXPECT_EQ(server.Wait(), 1000 + SIGTERM);
}

// Then it drains by itself, and says so to whoever goes on asking. An answer that is not yet taken
// keeps it from shutting down, when gRPC would cut off a call that comes at that very moment.
TEST(DrainTest, AfterTheDelayItDrains) {
  ServingProcess server({kMetricsFlag, kLongDrain, "--drain-delay=50ms"});
  const RawConnection client(server.port());
  ASSERT_TRUE(client.connected());
  SendUntakenCall(server, client);
  server.Signal(SIGTERM);
  grpc::Status status;
  while (status.ok()) status = GetCapabilities(server);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE) << status.error_message();
  EXPECT_EQ(ReasonIn(status), "DRAINING");
  client.Send(WindowUpdate(1 << 20));
  EXPECT_EQ(server.Wait(), 0);
}

}  // namespace
}  // namespace sightline
