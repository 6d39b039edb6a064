// SPDX-License-Identifier: Apache-2.0
//
// What the probes say of a server that is not well, and of one that is not there yet: /livez fails
// when the gRPC port is dead although old connections go on, /readyz while the server starts.
#include <sys/socket.h>

#include <atomic>
#include <future>
#include <map>
#include <string>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/server_harness.h"
#include "tests/support/faulty_file_calls.h"
#include "tests/support/http_get.h"
#include "tests/support/listening_socket.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_scale.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using ::testing::StartsWith;
using testing_support::HttpAnswer;
using testing_support::HttpGet;
using testing_support::ListeningSockets;
using testing_support::Until;

class LivenessTest : public ::testing::Test {
 protected:
  static ServerOptions WithMetrics() {
    ServerOptions options;
    options.metrics_listen = "127.0.0.1:0";
    return options;
  }
};

TEST_F(LivenessTest, AListenerThatTakesNothingIsNotAlive) {
  if (testing_support::kThreadSanitizerBuild) {
    GTEST_SKIP() << "a descriptor is exchanged while the server uses it, which is reported";
  }
  ServerOptions options = WithMetrics();
  options.scenes = {"builtin:box:1000"};
  ServerHarness harness(options);
  const int probes = harness.server->metrics_port();
  TileStream old(harness, BoxHeader());
  v1::TraceTilesResponse response;
  ASSERT_TRUE(old.Read(&response));
  ASSERT_EQ(HttpGet(probes, "/livez").code, 200);
  {
    const testing_support::DeadListener dead(harness.server->port());
    const HttpAnswer answer = HttpGet(probes, "/livez");
    EXPECT_EQ(answer.code, 503);
    EXPECT_THAT(answer.body, StartsWith("not alive: "));
    // A connection from before says nothing of it.
    old.Write(TileRequest(1, 0, 0, 64, 64));
    ASSERT_TRUE(old.Read(&response));
    EXPECT_EQ(response.reply().header().status().code(), 0);
  }
  EXPECT_TRUE(Until("it is alive again", [&] { return HttpGet(probes, "/livez").code == 200; }));
}

TEST_F(LivenessTest, APortThatRefusesIsNotAlive) {
  ServerHarness harness(WithMetrics());
  const int probes = harness.server->metrics_port();
  ASSERT_EQ(HttpGet(probes, "/livez").code, 200);
  ASSERT_EQ(shutdown(ListeningSockets().at(harness.server->port()), SHUT_RDWR), 0);
  const HttpAnswer answer = HttpGet(probes, "/livez");
  EXPECT_EQ(answer.code, 503);
  EXPECT_THAT(answer.body, StartsWith("not alive: "));
}

// Connections that say nothing take up the room that there is, and no more. The probe comes in all
// the same, through each socket that the server listens on.
TEST_F(LivenessTest, AServerWithoutRoomIsAlive) {
  const testing_support::TempDir dir;
  ServerOptions options = WithMetrics();
  options.limits.max_connections = 2;
  options.listen.push_back(absl::StrCat("unix:", dir.File("s.sock")));
  ServerHarness harness(options);
  const auto ask = [&](bool patient) {
    grpc::ClientContext context;
    context.set_wait_for_ready(patient);
    v1::Capabilities capabilities;
    return harness.capabilities->GetCapabilities(&context, {}, &capabilities);
  };
  {
    const RawConnection first(harness.server->port()), second(harness.server->port());
    EXPECT_EQ(first.FateWithin(absl::Minutes(1)), RawConnection::Fate::kTaken);
    EXPECT_EQ(second.FateWithin(absl::Minutes(1)), RawConnection::Fate::kTaken);
    const RawConnection third(harness.server->port());
    EXPECT_EQ(third.FateWithin(absl::Minutes(1)), RawConnection::Fate::kRefused);
    EXPECT_EQ(ask(/*patient=*/false).error_code(), grpc::StatusCode::UNAVAILABLE);
    const HttpAnswer answer = HttpGet(harness.server->metrics_port(), "/livez");
    EXPECT_EQ(answer.code, 200) << answer.body;
  }
  // gRPC notices that they are gone in its own time; the client tries until then.
  const grpc::Status later = ask(/*patient=*/true);
  EXPECT_TRUE(later.ok()) << later.error_message();
}

// The start waits in the file system for a scene that is stored.
TEST_F(LivenessTest, AServerThatStartsIsAliveAndNotReady) {
  const testing_support::TempDir repository;
  ServerOptions options = WithMetrics();
  options.repository = repository.path();
  {
    const ServerHarness harness(options);
    v1::Scene scene;
    const grpc::Status status = harness.CreateScene(WallUpload("wall"), &scene);
    ASSERT_TRUE(status.ok() && scene.stored()) << status.error_message() << scene.state_message();
  }
  testing_support::FaultyFileCalls calls;
  std::promise<void> goes_on;
  std::atomic<bool> loads = false;
  calls.on_map = [&] {
    loads = true;
    goes_on.get_future().wait();
  };
  options.files = &calls;
  const std::map<int, int> before = ListeningSockets();
  absl::StatusOr<std::unique_ptr<Server>> server;
  std::thread starter([&] { server = Server::Start(options); });
  EXPECT_TRUE(Until("a scene is being loaded", [&] { return loads.load(); }));
  // Of its ports there is the one of the probes alone.
  std::map<int, int> ports = ListeningSockets();
  for (const auto& [port, descriptor] : before) ports.erase(port);
  EXPECT_EQ(ports.size(), 1u);
  const int probes = ports.empty() ? 0 : ports.begin()->first;
  const HttpAnswer ready = HttpGet(probes, "/readyz"), alive = HttpGet(probes, "/livez");
  goes_on.set_value();
  starter.join();
  EXPECT_EQ(ready.code, 503);
  EXPECT_EQ(ready.body, "starting\n");
  EXPECT_EQ(alive.code, 200);
  ASSERT_TRUE(server.ok()) << server.status();
  EXPECT_EQ((*server)->metrics_port(), probes);
  EXPECT_EQ(HttpGet(probes, "/readyz").code, 200);
}

}  // namespace
}  // namespace sightline
