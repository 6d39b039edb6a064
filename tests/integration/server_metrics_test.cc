// SPDX-License-Identifier: Apache-2.0
//
// Probes and metrics of a real server, scraped over HTTP.
#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/server_harness.h"
#include "tests/support/http_get.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::HttpGet;
using testing_support::Until;

ServerOptions WithMetrics() {
  ServerOptions options;
  options.metrics_listen = "127.0.0.1:0";
  return options;
}

// The value of the sample that `name` (with its labels) has; -1 without.
double Sample(const ServerHarness& harness, const std::string& name) {
  const std::string page = HttpGet(harness.server->metrics_port(), "/metrics").body;
  for (const absl::string_view line : absl::StrSplit(page, '\n')) {
    double value = 0;
    if (line.substr(0, name.size() + 1) == absl::StrCat(name, " ") &&
        absl::SimpleAtod(line.substr(name.size() + 1), &value)) {
      return value;
    }
  }
  return -1;
}

TEST(ServerMetricsTest, WhatWasAskedIsCounted) {
  ServerOptions options = WithMetrics();
  options.scenes = {"builtin:box:1000"};
  ServerHarness harness(options);
  {
    TileStream stream(harness, BoxHeader());
    stream.Write(TileRequest(1, 0, 0, 64, 64));
    stream.Write(TileRequest(2, 0, 0, 16, 16));
    stream.Write(TileRequest(3, 60, 0, 64, 64));  // Beyond the image.
    v1::TraceTilesRequest late = TileRequest(4, 0, 0, 64, 64);
    late.mutable_item()->mutable_item()->mutable_timeout()->set_nanos(1);
    stream.Write(late);
    EXPECT_EQ(stream.ReadAll().size(), 4u);
    EXPECT_TRUE(stream.Finish().ok());
  }
  v1::Scene scene;
  EXPECT_TRUE(harness.CreateScene(WallUpload("wall"), &scene).ok());
  EXPECT_FALSE(harness.CreateScene(WallUpload("wall"), &scene).ok());
  const std::string tiles = "sightline_requests_total{method=\"TraceTiles\",result=";
  EXPECT_EQ(Sample(harness, tiles + "\"ok\"}"), 2);
  EXPECT_EQ(Sample(harness, tiles + "\"failed\"}"), 1);
  EXPECT_EQ(Sample(harness, tiles + "\"expired\"}"), 1);
  EXPECT_EQ(Sample(harness, "sightline_rays_total{method=\"TraceTiles\"}"), 64 * 64 + 16 * 16);
  EXPECT_EQ(Sample(harness, "sightline_compute_seconds_count{method=\"TraceTiles\"}"), 4);
  EXPECT_GT(Sample(harness, "sightline_compute_seconds_sum{method=\"TraceTiles\"}"), 0);
  EXPECT_GT(Sample(harness, "sightline_nodes_total"), 0);
  const std::string creations = "sightline_requests_total{method=\"CreateScene\",result=";
  EXPECT_EQ(Sample(harness, creations + "\"ok\"}"), 1);
  EXPECT_EQ(Sample(harness, creations + "\"failed\"}"), 1);
  EXPECT_EQ(Sample(harness, "sightline_scenes"), 2);
  EXPECT_GT(Sample(harness, "sightline_scene_bytes{scene=\"box\"}"), 0);
  EXPECT_EQ(Sample(harness, "sightline_scene_triangles{scene=\"wall\"}"), 2);
  EXPECT_EQ(Sample(harness, "sightline_pending_rays"), 0);
  const Limits limits;
  EXPECT_EQ(Sample(harness, "sightline_pending_rays_limit"), limits.max_queued_rays);
  EXPECT_EQ(Sample(harness, "sightline_scene_memory_limit_bytes"), limits.max_scene_bytes);
  EXPECT_EQ(Sample(harness, "sightline_point_set_limit_bytes"), limits.max_point_set_bytes);
  EXPECT_EQ(Sample(harness, "sightline_waiting_tasks"), 0);
  EXPECT_GT(Sample(harness, "sightline_rays_per_second"), 0);
  EXPECT_GT(Sample(harness, "process_resident_memory_bytes"), 1 << 20);
}

TEST(ServerMetricsTest, PlainCallsAndStreamsThatDoNotOpenAreCounted) {
  ServerOptions options = WithMetrics();
  options.scenes = {"builtin:box:1000"};
  ServerHarness harness(options);
  for (const char* name : {"scenes/box", "scenes/none"}) {
    grpc::ClientContext context;
    v1::GetSceneRequest request;
    v1::Scene scene;
    request.set_name(name);
    (void)harness.scenes->GetScene(&context, request, &scene);
  }
  {
    grpc::ClientContext context;
    v1::LoadSceneRequest request;
    v1::Scene scene;
    request.set_name("scenes/box");
    EXPECT_EQ(ReasonIn(harness.scenes->LoadScene(&context, request, &scene)), "NO_REPOSITORY");
  }
  {
    grpc::ClientContext context;
    v1::Capabilities capabilities;
    EXPECT_TRUE(harness.capabilities->GetCapabilities(&context, {}, &capabilities).ok());
  }
  {
    v1::TraceTilesRequest header = BoxHeader();
    header.mutable_header()->mutable_stream()->set_scene("scenes/none");
    TileStream stream(harness, header);
    stream.ReadAll();
    EXPECT_FALSE(stream.Finish().ok());
  }
  const auto requests = [&](const std::string& method, const std::string& result) {
    return Sample(harness, absl::StrCat("sightline_requests_total{method=\"", method,
                                        "\",result=\"", result, "\"}"));
  };
  EXPECT_EQ(requests("GetScene", "ok"), 1);
  EXPECT_EQ(requests("GetScene", "failed"), 1);
  EXPECT_EQ(requests("LoadScene", "failed"), 1);
  EXPECT_EQ(requests("GetCapabilities", "ok"), 1);
  EXPECT_EQ(requests("TraceTiles", "failed"), 1);
  EXPECT_EQ(requests("TraceTiles", "ok"), 0);
}

TEST(ServerMetricsTest, CallsThatRunOutOfTimeAreNotCancelledOnes) {
  ServerOptions options = WithMetrics();
  options.scenes = {"builtin:box:1000"};
  ServerHarness harness(options);
  const auto counts = [&](const std::string& method, const std::string& result) {
    return Sample(harness, absl::StrCat("sightline_requests_total{method=\"", method,
                                        "\",result=\"", result, "\"}"));
  };
  v1::WatchSceneRequest watch;
  watch.set_name("scenes/box");
  {
    // Clients that are silent: it is the server's own clock that ends the calls.
    const auto late = [&](const std::string& path, const std::vector<std::string>& messages) {
      auto connection = std::make_unique<RawConnection>(harness.server->port());
      connection->Send(CallBytes(path, messages, {.timeout = "50m"}));
      return connection;
    };
    const auto upload = late("/sightline.v1.SceneService/CreateScene", {}),
               stream = late("/sightline.v1.VisibilityService/ComputeShadows", {}),
               watcher = late("/sightline.v1.SceneService/WatchScene", {watch.SerializeAsString()});
    for (const char* method : {"CreateScene", "ComputeShadows", "WatchScene"}) {
      EXPECT_TRUE(Until("it has expired", [&] {
        return counts(method, "expired") + counts(method, "cancelled") + counts(method, "failed") >
               0;
      })) << method;
      EXPECT_EQ(counts(method, "expired"), 1) << method;
    }
  }
  const auto in_an_hour = [](grpc::ClientContext* context) {
    context->set_deadline(std::chrono::system_clock::now() + std::chrono::hours(1));
  };
  const auto calls = [&](size_t n) {
    return [&, n] { return harness.server->active_calls() == n; };
  };
  ASSERT_TRUE(Until("the calls have ended", calls(0)));
  {
    grpc::ClientContext context;
    in_an_hour(&context);
    const auto watcher = harness.scenes->WatchScene(&context, watch);
    v1::WatchSceneResponse change;
    ASSERT_TRUE(watcher->Read(&change));
    context.TryCancel();
    EXPECT_EQ(watcher->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  ASSERT_TRUE(Until("the watch has ended", calls(0)));
  {
    grpc::ClientContext context;
    in_an_hour(&context);
    v1::Scene scene;
    const auto upload = harness.scenes->CreateScene(&context, &scene);
    ASSERT_TRUE(Until("the upload has begun", calls(1)));
    context.TryCancel();
    EXPECT_EQ(upload->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  ASSERT_TRUE(Until("the upload has ended", calls(0)));
  for (const char* method : {"CreateScene", "WatchScene"}) {
    EXPECT_EQ(counts(method, "cancelled"), 1) << method;
    EXPECT_EQ(counts(method, "failed"), 0) << method;
  }
}

// Of the first item of a stream, the seventeenth, ...; of all if statistics are asked for.
TEST(ServerMetricsTest, WhatAnsweredIsCountedBySamples) {
  ServerOptions options = WithMetrics();
  options.scenes = {"builtin:box:1000"};
  ServerHarness harness(options);
  const auto counted = [&] {
    double sum = 0;
    for (const char* by : {"shaft", "triangles", "packet", "ray"}) {
      sum += Sample(harness, absl::StrCat("sightline_answered_rays_total{by=\"", by, "\"}"));
    }
    return sum;
  };
  const auto ask = [&](bool statistics) {
    v1::TraceTilesRequest header = BoxHeader();
    header.mutable_header()->mutable_stream()->mutable_options()->set_statistics(statistics);
    TileStream stream(harness, header);
    for (uint64_t id = 0; id < 18; ++id) stream.Write(TileRequest(id, 0, 0, 16, 16));
    for (const auto& [id, replies] : stream.ReadAll()) {
      if (!statistics) continue;
      const v1::Statistics& stats = replies.back().reply().header().statistics();
      EXPECT_EQ(stats.shaft_answered_count() + stats.triangles_answered_count() +
                    stats.packet_answered_count() + stats.ray_answered_count(),
                256u);
    }
    EXPECT_TRUE(stream.Finish().ok());
  };
  ask(false);
  EXPECT_EQ(counted(), 2 * 256);
  ask(true);
  EXPECT_EQ(counted(), 20 * 256);
}

TEST(ServerMetricsTest, ProbesFollowTheServersLife) {
  ServerHarness harness(WithMetrics());
  const int port = harness.server->metrics_port();
  EXPECT_EQ(HttpGet(port, "/readyz").code, 200);
  EXPECT_EQ(HttpGet(port, "/livez").code, 200);
  EXPECT_THAT(HttpGet(port, "/livez").body, HasSubstr("alive"));
  EXPECT_EQ(HttpGet(port, "/other").code, 404);
  grpc::ClientContext context;
  v1::Capabilities capabilities;
  ASSERT_TRUE(harness.capabilities->GetCapabilities(&context, {}, &capabilities).ok());
  const double accepted = Sample(harness, "sightline_accepted_connections_total");
  EXPECT_GE(accepted, 1);
  ASSERT_TRUE(harness.server->Drain(absl::Seconds(20)).ok());
  EXPECT_EQ(HttpGet(port, "/readyz").code, 503);
  EXPECT_THAT(HttpGet(port, "/readyz").body, HasSubstr("draining"));
  EXPECT_EQ(HttpGet(port, "/livez").code, 200);
  EXPECT_EQ(Sample(harness, "sightline_draining"), 1);
  // A counter that falls says that there is another process. The client may have come once more.
  EXPECT_GE(Sample(harness, "sightline_accepted_connections_total"), accepted);
}

TEST(ServerMetricsTest, AMetricsPortThatIsTakenStopsTheStart) {
  ServerHarness harness(WithMetrics());
  ServerOptions options;
  options.metrics_listen = absl::StrCat("127.0.0.1:", harness.server->metrics_port());
  const absl::Status status = Server::Start(options).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(options.metrics_listen));
}

}  // namespace
}  // namespace sightline
