// SPDX-License-Identifier: Apache-2.0
//
// Starting, being found, being healthy, and stopping; the last as a process.
#include <grpcpp/generic/generic_stub.h>
#include <linux/capability.h>
#include <signal.h>  // NOLINT(modernize-deprecated-headers): kill is POSIX, not in <csignal>.
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/server_process.h"
#include "tests/support/temp_dir.h"

namespace sightline {
namespace {

grpc::ByteBuffer Buffer(const std::string& bytes) {
  const grpc::Slice slice(bytes);
  return grpc::ByteBuffer(&slice, 1);
}

std::string Text(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  std::string text;
  if (!buffer.Dump(&slices).ok()) return text;
  for (const grpc::Slice& slice : slices) {
    text.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
  }
  return text;
}

// grpc.health.v1.Health.Check, by hand: Debian ships no generated class for it. 1: SERVING, 2:
// NOT_SERVING, -1: the service is unknown.
int Health(const std::shared_ptr<grpc::Channel>& channel, const std::string& service) {
  grpc::GenericStub stub(channel);
  grpc::CompletionQueue queue;
  grpc::ClientContext context;
  std::string request;
  if (!service.empty()) request = absl::StrCat("\x0a", std::string(1, service.size()), service);
  auto call =
      stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check", Buffer(request), &queue);
  call->StartCall();
  grpc::ByteBuffer response;
  grpc::Status status;
  call->Finish(&response, &status, nullptr);
  void* tag;
  bool ok;
  EXPECT_TRUE(queue.Next(&tag, &ok));
  if (!status.ok()) return -1;
  const std::string text = Text(response);
  return text.size() == 2 && text[0] == 8 ? text[1] : 0;
}

TEST(LifecycleTest, HealthIsReportedPerScene) {
  ServerHarness harness;
  EXPECT_EQ(Health(harness.channel, ""), 1);
  EXPECT_EQ(Health(harness.channel, "scenes/wall"), -1);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateScene(WallUpload("wall"), &scene).ok());
  EXPECT_EQ(Health(harness.channel, "scenes/wall"), 1);
  ASSERT_TRUE(harness.server->scenes().Delete("wall").ok());
  EXPECT_EQ(Health(harness.channel, "scenes/wall"), 2);
}

// gRPC's health service forgets no name, so that it hears of no scene that nobody named, and of no
// more names than there is room for.
TEST(LifecycleTest, HealthDoesNotGrowWithTheScenesThatWere) {
  ServerOptions options;
  options.limits.max_scenes = 1;
  ServerHarness harness(options);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateScene(WallUpload(""), &scene).ok());
  EXPECT_EQ(Health(harness.channel, scene.name()), -1);
  const std::string id = scene.name().substr(std::string("scenes/").size());
  ASSERT_TRUE(harness.server->scenes().Delete(id).ok());
  // Nor of those that never came to be.
  for (const char* name : {"u", "v", "w", "x", "y"}) {
    auto flat = WallUpload(name);
    std::string* const vertices = flat[2].mutable_chunk()->mutable_vertices_f64();
    vertices->assign(vertices->size(), '\0');
    EXPECT_FALSE(harness.CreateScene(flat, &scene).ok());
    EXPECT_EQ(Health(harness.channel, absl::StrCat("scenes/", name)), -1) << name;
  }
  for (const auto& [name, health] :
       {std::pair("a", 1), {"b", 1}, {"c", 1}, {"d", 1}, {"e", -1}, {"a", 1}}) {
    ASSERT_TRUE(harness.CreateScene(WallUpload(name), &scene).ok());
    EXPECT_EQ(Health(harness.channel, absl::StrCat("scenes/", name)), health) << name;
    ASSERT_TRUE(harness.server->scenes().Delete(name).ok());
  }
  EXPECT_EQ(Health(harness.channel, "scenes/b"), 2);
}

TEST(LifecycleTest, ReflectionListsTheServices) {
  ServerHarness harness;
  grpc::GenericStub stub(harness.channel);
  grpc::CompletionQueue queue;
  grpc::ClientContext context;
  auto call = stub.PrepareCall(
      &context, "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo", &queue);
  void* tag;
  bool ok = false;
  call->StartCall(nullptr);
  ASSERT_TRUE(queue.Next(&tag, &ok) && ok);
  call->Write(Buffer("\x3a\x01*"), nullptr);  // list_services: "*"
  ASSERT_TRUE(queue.Next(&tag, &ok) && ok);
  grpc::ByteBuffer response;
  call->Read(&response, nullptr);
  ASSERT_TRUE(queue.Next(&tag, &ok) && ok);
  const std::string services = Text(response);
  for (const char* service : {"Scene", "PointSet", "Visibility", "Capability"}) {
    EXPECT_TRUE(absl::StrContains(services, absl::StrCat("sightline.v1.", service, "Service")));
  }
  context.TryCancel();
  grpc::Status status;
  call->Finish(&status, nullptr);
  queue.Next(&tag, &ok);
}

TEST(LifecycleTest, CapabilitiesSayWhatTheServerIs) {
  ServerOptions options;
  options.threads = 3;
  options.limits.max_lights = 17;
  ServerHarness harness(options);
  grpc::ClientContext context;
  v1::Capabilities capabilities;
  ASSERT_TRUE(harness.capabilities->GetCapabilities(&context, {}, &capabilities).ok());
  EXPECT_EQ(capabilities.limits().max_lights(), 17u);
  EXPECT_EQ(capabilities.thread_count(), 3u);
  EXPECT_FALSE(capabilities.version().empty());
}

TEST(LifecycleTest, APortIsNeverShared) {
  ServerHarness harness;
  ServerOptions options;
  options.listen = {absl::StrCat("127.0.0.1:", harness.server->port())};
  const absl::Status status = Server::Start(options).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_TRUE(absl::StrContains(status.message(), options.listen.front())) << status;
}

TEST(LifecycleTest, AServerWithoutASocketAnswersInProcess) {
  ServerOptions options;
  options.listen.clear();
  options.scenes = {"small=builtin:box:1000", "builtin:box:2k"};
  SetLogLevel(LogLevel::kOff);
  absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
  ASSERT_TRUE(server.ok()) << server.status();
  EXPECT_EQ((*server)->port(), 0);
  {
    auto stub = v1::SceneService::NewStub((*server)->InProcessChannel(grpc::ChannelArguments()));
    for (const char* name : {"scenes/small", "scenes/box"}) {
      grpc::ClientContext context;
      v1::GetSceneRequest request;
      v1::Scene scene;
      request.set_name(name);
      EXPECT_TRUE(stub->GetScene(&context, request, &scene).ok()) << name;
    }
  }
  EXPECT_TRUE((*server)->Drain(absl::Seconds(20)).ok());
  (*server)->Shutdown();  // Once more does no harm.
}

// Whoever drains and whoever loses patience need not be one.
TEST(LifecycleTest, SeveralMayEndAServerAtOnce) {
  ServerOptions options;
  options.listen.clear();
  SetLogLevel(LogLevel::kOff);
  absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
  ASSERT_TRUE(server.ok()) << server.status();
  std::thread drainer([&] { EXPECT_TRUE((*server)->Drain(absl::Minutes(1)).ok()); });
  std::thread impatient([&] { (*server)->Shutdown(); });
  (*server)->Shutdown();
  drainer.join();
  impatient.join();
}

TEST(LifecycleTest, BadOptionsDoNotStart) {
  ServerOptions options;
  options.scenes = {"builtin:nothing"};
  EXPECT_EQ(Server::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
  // What the limits say of a scene names the option.
  options.scenes = {"builtin:box:1000"};
  options.limits.max_triangles_per_scene = 100;
  const absl::Status large = Server::Start(options).status();
  EXPECT_EQ(large.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_TRUE(absl::StrContains(large.message(), "--scene = \"builtin:box:1000\": ")) << large;
  EXPECT_TRUE(absl::StrContains(large.message(), "max_triangles_per_scene")) << large;
  options.limits = Limits();
  options.scenes.clear();
  options.limits.max_message_bytes = 1;
  EXPECT_EQ(Server::Start(options).status().code(), absl::StatusCode::kInvalidArgument);
}

// A watcher does not hold up a drain.
TEST(LifecycleTest, DrainEndsWatchers) {
  ServerHarness harness;
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateScene(WallUpload("wall"), &scene).ok());
  grpc::ClientContext context;
  v1::WatchSceneRequest request;
  request.set_name("scenes/wall");
  auto reader = harness.scenes->WatchScene(&context, request);
  v1::WatchSceneResponse change;
  ASSERT_TRUE(reader->Read(&change));
  EXPECT_TRUE(harness.server->Drain(absl::Seconds(20)).ok());
  while (reader->Read(&change)) {
  }
  EXPECT_EQ(ReasonIn(reader->Finish()), "DRAINING");
}

TEST(SightlinedTest, SigtermDrainsAndExitsWithZero) {
  const testing_support::TempDir dir;
  const std::string port_file = dir.File("port");
  ServerProcess process(
      {"--scene=builtin:box:1000", "--port-file", port_file, "--threads=2", "--slow-query-log=0s"});
  const std::string serving = process.ReadUntil("event=serving");
  ASSERT_TRUE(absl::StrContains(serving, "event=serving")) << serving;
  int port = 0;
  std::ifstream(port_file) >> port;
  ASSERT_GT(port, 0);
  EXPECT_TRUE(absl::StrContains(serving, absl::StrCat("port=", port))) << serving;

  auto channel =
      grpc::CreateChannel(absl::StrCat("127.0.0.1:", port), grpc::InsecureChannelCredentials());
  EXPECT_EQ(Health(channel, "scenes/box"), 1);
  // A stream under way when the signal comes is told, and its item is answered.
  auto stub = v1::VisibilityService::NewStub(channel);
  grpc::ClientContext context;
  auto stream = stub->TraceTiles(&context);
  stream->Write(BoxHeader());
  stream->Write(TileRequest(1, 0, 0, 64, 64));
  v1::TraceTilesResponse response;
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_TRUE(response.has_opened());
  ASSERT_TRUE(stream->Read(&response));
  EXPECT_EQ(response.reply().header().status().code(), 0);
  const std::string slow = process.ReadUntil("event=slow_query");
  for (const char* field : {" method=TraceTiles", " scene=box", " revision=1", " item=1",
                            " status=OK", " rays=4096", " total_ms=", " nodes="}) {
    EXPECT_TRUE(absl::StrContains(slow, field)) << field << " in " << slow;
  }
  process.Signal(SIGTERM);
  while (stream->Read(&response)) {
  }
  EXPECT_EQ(ReasonIn(stream->Finish()), "DRAINING");
  EXPECT_EQ(process.Wait(), 0);
  EXPECT_FALSE(std::ifstream(port_file).good());
}

TEST(SightlinedTest, TheFirstSceneWithoutAHealthIsWarnedAbout) {
  ServerProcess process({"--scene=box=builtin:box:1000", "--max-scenes=2"});
  const std::string serving = process.ReadUntil("event=serving");
  const size_t at = serving.find("port=");
  ASSERT_NE(at, std::string::npos) << serving;
  const auto channel =
      grpc::CreateChannel(absl::StrCat("127.0.0.1:", std::atoi(serving.c_str() + at + 5)),
                          grpc::InsecureChannelCredentials());
  const auto stub = v1::SceneService::NewStub(channel);
  for (int i = 1; i <= 9; ++i) {
    const std::string id = absl::StrCat("s", i);
    v1::Scene scene;
    grpc::ClientContext creating, deleting;
    const auto writer = stub->CreateScene(&creating, &scene);
    for (const auto& message : WallUpload(id)) writer->Write(message);
    writer->WritesDone();
    ASSERT_TRUE(writer->Finish().ok()) << id;
    EXPECT_EQ(Health(channel, absl::StrCat("scenes/", id)), i < 8 ? 1 : -1) << id;
    v1::DeleteSceneRequest request;
    request.set_name(absl::StrCat("scenes/", id));
    google::protobuf::Empty nothing;
    ASSERT_TRUE(stub->DeleteScene(&deleting, request, &nothing).ok()) << id;
  }
  process.Signal(SIGTERM);
  const std::string log = process.ReadThrough("event=stopped");
  const size_t told = log.find("level=warning event=health_names_full");
  ASSERT_NE(told, std::string::npos) << log;
  EXPECT_TRUE(absl::StrContains(log, "without_health=scenes/s8")) << log;
  EXPECT_EQ(log.find("event=health_names_full", told + 20), std::string::npos) << log;
}

TEST(SightlinedTest, MetricsForEverybodyAreWarnedAbout) {
  ServerProcess process({"--listen=127.0.0.1:0", "--metrics-listen=0.0.0.0:0"});
  const std::string line = process.ReadUntil("event=metrics_without_roles");
  EXPECT_TRUE(absl::StrContains(line, "level=warning event=metrics_without_roles")) << line;
  EXPECT_TRUE(absl::StrContains(line, "address=0.0.0.0:0")) << line;
}

// A role's token would be read by whoever listens on the way: the port has no TLS, whatever the
// other one has.
TEST(SightlinedTest, MetricsTokensInTheClearAreWarnedAbout) {
  const testing_support::TempDir dir;
  const std::string access = dir.File("access.conf");
  std::ofstream(access) << "metrics token prometheus plain:a-secret-of-16-characters\n";
  std::filesystem::permissions(access, std::filesystem::perms(0600));
  ServerProcess beyond(
      {"--listen=127.0.0.1:0", "--metrics-listen=0.0.0.0:0", "--access-file", access});
  const std::string line = beyond.ReadUntil("event=metrics_");
  EXPECT_TRUE(absl::StrContains(line, "level=warning event=metrics_tokens_in_the_clear")) << line;
  EXPECT_TRUE(absl::StrContains(line, "address=0.0.0.0:0")) << line;
  ServerProcess within(
      {"--listen=127.0.0.1:0", "--metrics-listen=127.0.0.1:0", "--access-file", access});
  const std::string log = within.ReadThrough("event=serving");
  EXPECT_TRUE(absl::StrContains(log, "event=serving")) << log;
  EXPECT_FALSE(absl::StrContains(log, "event=metrics_")) << log;
}

// The second scene takes seconds to make.
TEST(SightlinedTest, SigtermEndsItWhileItStarts) {
  const testing_support::TempDir dir;
  const std::string port_file = dir.File("port");
  ServerProcess process({"--scene=first=builtin:box:1000", "--scene=second=builtin:sphere:8M",
                         "--port-file", port_file});
  ASSERT_TRUE(absl::StrContains(process.ReadUntil("event=scene_created"), "scene=first"));
  process.Signal(SIGTERM);
  const std::string rest = process.ReadUntil("event=serving");
  EXPECT_TRUE(absl::StrContains(rest, "event=stopped_while_starting")) << rest;
  EXPECT_FALSE(absl::StrContains(rest, "scene=second")) << rest;
  EXPECT_EQ(process.Wait(), 0);
  EXPECT_FALSE(std::ifstream(port_file).good());
}

// As a shell without job control starts what it puts into the background.
TEST(SightlinedTest, ASecondSigintEndsItAlsoWhereItWasIgnored) {
  ServerProcess process({"--drain-delay=1h"}, [] { signal(SIGINT, SIG_IGN); });
  process.ReadUntil("event=serving");
  process.Signal(SIGINT);
  const std::string leaving = process.ReadUntil("event=leaving");
  EXPECT_TRUE(absl::StrContains(leaving, "event=leaving")) << leaving;
  process.Signal(SIGINT);
  EXPECT_EQ(process.Wait(), 1000 + SIGINT);
}

TEST(SightlinedTest, WrongFlagsAreAUsageError) {
  ServerProcess process({"--thread=2"});
  const std::string line = process.ReadUntil("--thread");
  EXPECT_TRUE(absl::StrContains(line, "there is no flag --thread")) << line;
  EXPECT_EQ(process.Wait(), 64);
}

// Whoever wants no log is told all the same.
TEST(SightlinedTest, WhyItDoesNotStartIsSaidWithoutALog) {
  const ServerHarness other;
  const std::string address = absl::StrCat("127.0.0.1:", other.server->port());
  ServerProcess process({"--listen", address, "--log-level=off"});
  const std::string said = process.ReadThrough("no such line");
  EXPECT_EQ(said,
            absl::StrCat("sightlined: cannot listen on ", address, ": Address already in use\n"));
  EXPECT_EQ(process.Wait(), 69);
}

TEST(SightlinedTest, TheConfigurationIsCheckedAndPrinted) {
  const testing_support::TempDir dir;
  std::ofstream(dir.File("good.yaml")) << "threads: 3\n";
  std::ofstream(dir.File("bad.yaml")) << "threads: 3\nscene: builtin:nothing\n";
  ServerProcess good({"--config", dir.File("good.yaml"), "--check-config"});
  EXPECT_TRUE(absl::StrContains(good.ReadUntil("good"), "the configuration is good"));
  EXPECT_EQ(good.Wait(), 0);
  ServerProcess bad({"--config", dir.File("bad.yaml"), "--check-config"});
  EXPECT_TRUE(absl::StrContains(bad.ReadUntil("nothing"), "nothing"));
  EXPECT_EQ(bad.Wait(), 64);
  ServerProcess print({"--config", dir.File("good.yaml"), "--print-config"});
  EXPECT_TRUE(absl::StrContains(print.ReadUntil("threads: 3"), "good.yaml:1"));
  print.ReadUntil("no such line");
  EXPECT_EQ(print.Wait(), 0);
}

TEST(SightlinedTest, ARepositoryThatCannotBeWrittenIsWarnedAbout) {
  const testing_support::TempDir dir;
  ASSERT_EQ(::chmod(dir.path().c_str(), 0500), 0);
  // Root may write anywhere, unless it gives that up.
  const auto bound_by_modes = [] {
    if (geteuid() == 0 && prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0) != 0) _exit(1);
  };
  const std::string warning = absl::StrCat("cannot write to the folder ", dir.path());
  ServerProcess check({"--repository", dir.path(), "--check-config"}, bound_by_modes);
  const std::string said = check.ReadThrough("the configuration is good");
  EXPECT_TRUE(absl::StrContains(said, warning)) << said;
  EXPECT_EQ(check.Wait(), 0);
  ServerProcess server({"--repository", dir.path(), "--listen=127.0.0.1:0"}, bound_by_modes);
  const std::string started = server.ReadThrough("event=serving");
  EXPECT_TRUE(absl::StrContains(started, warning)) << started;
}

TEST(SightlinedTest, HelpAndVersion) {
  ServerProcess help({"--help"});
  EXPECT_TRUE(absl::StrContains(help.ReadUntil("--drain-timeout"), "DURATION"));
  help.ReadUntil("no such line");
  EXPECT_EQ(help.Wait(), 0);
  ServerProcess version({"--version"});
  EXPECT_TRUE(absl::StrContains(version.ReadUntil("sightlined"), "."));
  EXPECT_EQ(version.Wait(), 0);
}

}  // namespace
}  // namespace sightline
