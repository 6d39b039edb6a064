// SPDX-License-Identifier: Apache-2.0
//
// The real server under what happens to servers: killed, restarted, drained, spoken to in garbage,
// abandoned and stalled by clients, out of descriptors and of memory. Clients go on asking all the
// while, and every answer that they get is held against the engine's.
#include <chrono>
#include <csignal>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/tile_load.h"
#include "tests/support/http_get.h"
#include "tests/support/random.h"
#include "tests/support/temp_dir.h"
#include "tests/support/test_scale.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

constexpr uint64_t kMiB = 1 << 20;

// What a client writes that calls TraceTiles and no more: no library takes its leave when the
// connection goes.
std::string TraceTilesBytes(const std::vector<v1::TraceTilesRequest>& requests) {
  std::vector<std::string> messages;
  messages.reserve(requests.size());
  for (const auto& request : requests) messages.push_back(request.SerializeAsString());
  return CallBytes("/sightline.v1.VisibilityService/TraceTiles", messages);
}

// Rays that are accepted and not answered.
double PendingRays(const ServingProcess& server) {
  return testing_support::MetricOf(server.metrics_port(), "sightline_pending_rays");
}

class FaultTest : public testing::Test {
 protected:
  FaultTest() : tiles_("room:15000") {}

  // A new connection gets an answer, and it is right.
  void ExpectServing(const ServingProcess& server) const {
    TileLoad load(tiles_, {.address = server.address(), .clients = 1});
    load.WaitForAnswers(1);
    load.Stop();
    EXPECT_EQ(load.wrong(), 0u);
  }

  const KnownTiles tiles_;
};

TEST_F(FaultTest, KilledUnderLoadAndRestartedItGoesOn) {
  auto server = std::make_unique<ServingProcess>(std::vector<std::string>{tiles_.flag()});
  const std::string address = server->address();
  TileLoad load(tiles_, {.address = address, .clients = 3});
  for (int kill = 0; kill < 3; ++kill) {
    load.WaitForAnswers(200);
    server->Signal(SIGKILL);
    EXPECT_EQ(server->Wait(), 1000 + SIGKILL);
    server = std::make_unique<ServingProcess>(std::vector<std::string>{tiles_.flag()},
                                              ServingProcess::Options{.listen = address});
  }
  load.WaitForAnswers(200);
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.refused(), 0u);
  EXPECT_GE(load.broken_streams(), 3u);
}

TEST_F(FaultTest, DrainedUnderLoadItLosesNothingThatItAccepted) {
  ServingProcess server({tiles_.flag()});
  TileLoad load(tiles_, {.address = server.address(), .clients = 4, .window = 16});
  load.WaitForAnswers(300);
  load.KeepStreams();
  server.Signal(SIGTERM);
  load.Join();
  EXPECT_EQ(server.Wait(), 0);
  EXPECT_EQ(load.drained_streams(), 4u);
  EXPECT_EQ(load.lost_accepted(), 0u);
  EXPECT_EQ(load.wrong(), 0u);
}

// Clients that ask for far more than they read, and clients that vanish in the middle: others are
// answered meanwhile, and what they leave behind is given back.
TEST_F(FaultTest, StalledAndVanishingClientsCostBoundedMemory) {
  // None of them is ended for being stalled.
  ServingProcess server(
      {tiles_.flag(), "--metrics-listen=127.0.0.1:0", "--max-stream-stall-seconds=3600"});
  TileLoad load(tiles_, {.address = server.address(), .clients = 1});
  load.WaitForAnswers(200);
  const uint64_t before = server.ResidentBytes();
  struct Client {
    std::shared_ptr<grpc::Channel> channel;
    std::unique_ptr<v1::VisibilityService::Stub> stub;
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReaderWriter<v1::TraceTilesRequest, v1::TraceTilesResponse>> stream;
  };
  v1::TraceTilesRequest header = tiles_.Header();
  v1::TileOutputs* outputs = header.mutable_header()->mutable_outputs();
  outputs->set_barycentrics(true);
  outputs->set_object_ids(true);
  outputs->set_triangle_ids(true);
  // As much as the credit allows; 20 bytes per ray, 80 MiB in all, and nothing is read.
  std::vector<v1::TraceTilesRequest> messages = {header};
  for (uint64_t id = 0; id < 1000; ++id) messages.push_back(tiles_.Request(id));
  std::vector<std::unique_ptr<Client>> stalled;
  std::vector<std::unique_ptr<RawConnection>> silent;
  constexpr uint64_t kStalled = 8;
  for (uint64_t i = 0; i < kStalled / 2; ++i) {
    silent.push_back(std::make_unique<RawConnection>(server.port()));
    ASSERT_TRUE(silent.back()->connected());
    silent.back()->Send(TraceTilesBytes(messages));
    auto client = std::make_unique<Client>();
    client->channel = server.Channel();
    client->stub = v1::VisibilityService::NewStub(client->channel);
    client->stream = client->stub->TraceTiles(&client->context);
    for (const auto& message : messages) ASSERT_TRUE(client->stream->Write(message));
    stalled.push_back(std::move(client));
  }
  load.WaitForAnswers(500);
  // 8 MiB of outbox each, and what the transport holds. A sanitizer's server holds on to what it
  // has freed.
  if (!testing_support::kSanitizerBuild) {
    EXPECT_LT(server.ResidentBytes(), before + kStalled * 24 * kMiB);
  }
  // Nobody reads: far more than what is asked beside them.
  const double all = PendingRays(server);
  // Half of them vanish without a word, half cancel.
  silent.clear();
  load.WaitForAnswers(100);
  for (const auto& client : stalled) {
    client->context.TryCancel();
    client->stream->Finish();
  }
  stalled.clear();
  load.WaitForAnswers(300);
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.refused(), 0u);
  EXPECT_GT(all, 1e6);
  const auto patience = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (PendingRays(server) > 0 && std::chrono::steady_clock::now() < patience) {
  }
  EXPECT_EQ(PendingRays(server), 0);
  // Nothing holds up the end.
  server.Signal(SIGTERM);
  EXPECT_EQ(server.Wait(), 0);
}

TEST_F(FaultTest, GarbageOnThePortHurtsNobody) {
  ServingProcess server({tiles_.flag()});
  TileLoad load(tiles_, {.address = server.address(), .clients = 1});
  load.WaitForAnswers(100);
  const uint64_t before = server.ResidentBytes();
  testing_support::TestRng rng;
  const std::string preface = "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
  const std::string settings("\0\0\0\4\0\0\0\0\0", 9);
  std::vector<std::unique_ptr<RawConnection>> open;
  for (int i = 0; i < 200; ++i) {
    auto connection = std::make_unique<RawConnection>(server.port());
    ASSERT_TRUE(connection->connected());
    std::string garbage(1 + rng.Below(4096), '\0');
    for (char& c : garbage) c = static_cast<char>(rng.Below(256));
    switch (i % 4) {
      case 0:
        connection->Send(garbage);
        break;
      case 1:
        connection->Send("GET / HTTP/1.1\r\nHost: x\r\n\r\n");
        break;
      case 2:
        connection->Send(preface + settings + garbage);
        break;
      default:  // A header frame that promises 16 KiB and brings a few bytes.
        connection->Send(
            absl::StrCat(preface, settings, absl::string_view("\0\x40\0\1\4\0\0\0\1", 9), "abc"));
        break;
    }
    if (rng.Chance(0.5)) connection->Abort();
    if (rng.Chance(0.25)) open.push_back(std::move(connection));
  }
  load.WaitForAnswers(200);
  EXPECT_LT(server.ResidentBytes(), before + 64 * kMiB);
  ExpectServing(server);
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.broken_streams(), 0u);
}

// A connection that never says a word does not keep its slot.
TEST_F(FaultTest, ASilentConnectionIsClosedWithinSeconds) {
  ServingProcess server({tiles_.flag()});
  const RawConnection silent(server.port());
  ASSERT_TRUE(silent.connected());
  EXPECT_TRUE(silent.EndsWithin(absl::Seconds(40)));
}

// More connections than it has descriptors, and no other bound that would come first: those that it
// has are served meanwhile, what wants a file is told why it cannot have it, and new connections
// get in once there is room.
TEST_F(FaultTest, OutOfDescriptorsItGoesOnServingAndRecovers) {
  if (testing_support::kSanitizerBuild) {
    GTEST_SKIP()
        << "sanitizers open pipes to look at pointers, and report those they cannot look at";
  }
  constexpr int kCrowd = 200;
  const testing_support::TempDir repository;
  ServingProcess server({tiles_.flag(), "--repository", repository.path(),
                         "--metrics-listen=127.0.0.1:0", "--max-connections-per-address=900",
                         "--max-connections=900"});
  const auto says = [&](const char* event) {
    return testing_support::Until(event, [&] { return server.HasSaid(event); });
  };
  const auto channel = server.Channel();
  const auto scenes = v1::SceneService::NewStub(channel);
  const auto load_scene = [&] {
    grpc::ClientContext context;
    v1::LoadSceneRequest request;
    request.set_name("scenes/attic");
    v1::Scene scene;
    return scenes->LoadScene(&context, request, &scene);
  };
  const auto unload_scene = [&] {
    grpc::ClientContext context;
    v1::UnloadSceneRequest request;
    request.set_name("scenes/attic");
    google::protobuf::Empty empty;
    const grpc::Status status = scenes->UnloadScene(&context, request, &empty);
    EXPECT_TRUE(status.ok()) << status.error_message();
  };
  {
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = scenes->CreateScene(&context, &scene);
    for (const auto& message : WallUpload("attic")) writer->Write(message);
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    ASSERT_TRUE(status.ok() && scene.stored()) << status.error_message() << scene.state_message();
  }
  unload_scene();
  TileLoad load(tiles_, {.address = server.address(), .clients = 1});
  load.WaitForAnswers(50);
  server.Limit(RLIMIT_NOFILE, server.OpenDescriptors() + 8);
  for (int round = 0; round < 3; ++round) {
    std::vector<std::unique_ptr<RawConnection>> crowd;
    int taken = 0, refused = 0;
    for (int i = 0; i < kCrowd; ++i) {
      crowd.push_back(std::make_unique<RawConnection>(server.port()));
      ASSERT_TRUE(crowd.back()->connected());
    }
    for (const auto& connection : crowd) {
      const RawConnection::Fate fate = connection->FateWithin(absl::Minutes(1));
      ASSERT_NE(fate, RawConnection::Fate::kIgnored) << "after " << taken << " and " << refused;
      ++(fate == RawConnection::Fate::kTaken ? taken : refused);
    }
    EXPECT_GT(taken, 0);
    EXPECT_GT(refused, kCrowd / 2);
    EXPECT_TRUE(says("event=out_of_descriptors"));
    // The loop that takes connections looks now and then whether there is a descriptor, and gives
    // up the one that it holds in reserve for that moment: a file that is opened just then gets it.
    grpc::Status status = load_scene();
    for (int luck = 0; status.ok() && luck < 10; ++luck) {
      unload_scene();
      status = load_scene();
    }
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_EQ(ReasonIn(status), "STORAGE_FAILED") << status.error_message();
    load.WaitForAnswers(50);
    EXPECT_EQ(load.wrong(), 0u);

    crowd.clear();
    ExpectServing(server);
    EXPECT_TRUE(testing_support::Until("the server is alive again", [&] {
      return testing_support::HttpGet(server.metrics_port(), "/livez").code == 200;
    }));
    EXPECT_TRUE(says("event=descriptors_again"));
    status = load_scene();
    EXPECT_TRUE(status.ok()) << status.error_message();
    unload_scene();
  }
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.refused(), 0u);
  EXPECT_EQ(load.broken_streams(), 0u);
  server.Signal(SIGTERM);
  EXPECT_EQ(server.Wait(), 0);
}

// A scene beyond the budget is refused before it is built, and what is there is served.
TEST_F(FaultTest, OutOfItsMemoryBudgetItGoesOnServing) {
  ServingProcess server({tiles_.flag(), "--max-scene-bytes=67108864"});
  TileLoad load(tiles_, {.address = server.address(), .clients = 1});
  const auto stub = v1::SceneService::NewStub(server.Channel());
  const uint64_t before = server.ResidentBytes();
  for (int i = 0; i < 5; ++i) {
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = stub->CreateScene(&context, &scene);
    v1::CreateSceneRequest request;
    request.mutable_header()->set_scene_id("large");
    request.mutable_header()->mutable_upload()->set_object_count(1);
    request.mutable_header()->mutable_upload()->set_triangle_count(50'000'000);
    request.mutable_header()->mutable_upload()->set_vertex_count(25'000'000);
    writer->Write(request);
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_EQ(ReasonIn(status), "OUT_OF_MEMORY_BUDGET");
  }
  // Sanitizers keep several bytes of their own for each one of the server's.
  const uint64_t grace = (testing_support::kSanitizerBuild ? 256 : 64) * kMiB;
  EXPECT_LT(server.ResidentBytes(), before + grace);
  load.WaitForAnswers(100);
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.broken_streams(), 0u);
}

// Out of address space in the middle of requests: they fail, the server and its other clients do
// not.
TEST_F(FaultTest, OutOfMemoryARequestFailsAndNothingElse) {
  if (testing_support::kSanitizerBuild) {
    GTEST_SKIP() << "sanitizers reserve terabytes of addresses, and map more of them as they run";
  }
  ServingProcess server({tiles_.flag()});
  TileLoad load(tiles_, {.address = server.address(), .clients = 1});
  load.WaitForAnswers(50);
  // Its stacks and arenas take addresses by the number of cores, so the limit is above what it has
  // once it serves.
  server.Limit(RLIMIT_AS, server.AddressBytes() + 324 * kMiB);
  const auto stub = v1::SceneService::NewStub(server.Channel());
  for (int i = 0; i < 3; ++i) {
    grpc::ClientContext context;
    v1::Scene scene;
    const auto writer = stub->CreateScene(&context, &scene);
    v1::CreateSceneRequest request;
    request.mutable_header()->set_scene_id("large");
    request.mutable_header()->mutable_builtin()->set_spec("builtin:sphere:10000000");
    writer->Write(request);
    writer->WritesDone();
    const grpc::Status status = writer->Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
    EXPECT_EQ(ReasonIn(status), "OUT_OF_MEMORY_BUDGET");
    // Who comes anew is served, too.
    ExpectServing(server);
  }
  load.WaitForAnswers(50);
  load.Stop();
  EXPECT_EQ(load.wrong(), 0u);
  EXPECT_EQ(load.broken_streams(), 0u);
}

}  // namespace
}  // namespace sightline
