// SPDX-License-Identifier: Apache-2.0
//
// sightline-load as a process that is sent signals, where it would go on for hours, and where a
// server that is there and answers nothing holds it up.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <csignal>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/load/load_process.h"
#include "tests/integration/serving_process.h"

namespace sightline::load {
namespace {

using ::testing::HasSubstr;

constexpr char kNothing[] = "interrupted before the first request: there is nothing to report";

class LoadSignalTest : public ::testing::Test {
 protected:
  // Hours of everything; what `args` say wins.
  std::vector<std::string> Args(const std::vector<std::string>& args) const {
    std::vector<std::string> all = {absl::StrCat("--server=", server_.address()),
                                    "--scene=box",
                                    "--size=128x72",
                                    "--cameras=2",
                                    "--points=64",
                                    "--distinct=16",
                                    "--warm-up=0s",
                                    "--duration=20h",
                                    "--retry=100000",
                                    "--output=json"};
    all.insert(all.end(), args.begin(), args.end());
    return all;
  }
  size_t SceneCount() const {
    const client::Client client(client::MakeConnection(server_.address(), {}));
    const absl::StatusOr<std::vector<client::Scene>> scenes = client.ListScenes();
    EXPECT_TRUE(scenes.ok()) << scenes.status();
    return scenes.ok() ? scenes->size() : 0;
  }

  ServingProcess server_{{"--scene=box=builtin:box"}};
};

// Whom the kernel connects and nobody answers.
class SilentListener {
 public:
  SilentListener() : descriptor_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    auto* const at = reinterpret_cast<sockaddr*>(&address);
    EXPECT_EQ(bind(descriptor_, at, size), 0);
    EXPECT_EQ(listen(descriptor_, 8), 0);
    EXPECT_EQ(getsockname(descriptor_, at, &size), 0);
    port_ = ntohs(address.sin_port);
  }
  ~SilentListener() { close(descriptor_); }
  SilentListener(const SilentListener&) = delete;
  SilentListener& operator=(const SilentListener&) = delete;
  int port() const { return port_; }

 private:
  const int descriptor_;
  int port_ = 0;
};

TEST_F(LoadSignalTest, AServerThatSaysNothingIsGivenUp) {
  const SilentListener silent;
  for (const int signal : {SIGINT, SIGTERM}) {
    LoadProcess load(Args({absl::StrCat("--server=127.0.0.1:", silent.port())}));
    ASSERT_TRUE(load.Says("connecting to "));
    load.Signal(signal);
    EXPECT_EQ(load.Wait(), cli::kExitTemporary);
    EXPECT_THAT(load.said(), HasSubstr(kNothing));
    EXPECT_EQ(load.out(), "");
  }
}

// The server is stopped in the middle of it, or of what comes next.
TEST_F(LoadSignalTest, APreparationIsGivenUpAndWhatItMadeIsTakenAway) {
  const std::pair<int, const char*> steps[] = {
      {SIGINT, "opening builtin:box"}, {SIGTERM, "keeping points"}, {SIGINT, "opening streams"}};
  for (const auto& [signal, step] : steps) {
    LoadProcess load(Args({"--scene=builtin:box", "--workload=points", "--drain=10h"}));
    ASSERT_TRUE(load.Says(step));
    server_.Signal(SIGSTOP);
    load.Signal(signal);
    const bool heard = static_cast<bool>(load.Says("interrupted: once more"));
    server_.Signal(SIGCONT);
    ASSERT_TRUE(heard) << load.said();
    // The set of points may have been kept by then, or the streams opened, and the run begun.
    const int code = load.Wait();
    if (std::string(step) == "opening builtin:box") {
      EXPECT_EQ(code, cli::kExitTemporary);
      EXPECT_THAT(load.said(), HasSubstr(kNothing));
    }
    EXPECT_EQ(SceneCount(), 1u) << load.said();
  }
}

TEST_F(LoadSignalTest, AWarmUpThatIsInterruptedHasNothingMeasured) {
  LoadProcess load(Args({"--scene=builtin:box", "--warm-up=20h", "--workload=segments"}));
  ASSERT_TRUE(load.Says("warming up"));
  load.Signal(SIGINT);
  EXPECT_EQ(load.Wait(), 0) << load.said();
  const nlohmann::json json = nlohmann::json::parse(load.out());
  EXPECT_EQ(json["interrupted"], true);
  EXPECT_EQ(json["all"]["requests"], 0);
  EXPECT_EQ(SceneCount(), 1u);
}

TEST_F(LoadSignalTest, ARunIsReportedAsFarAsItCame) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    LoadProcess load(Args({"--scene=builtin:box", "--workload=mixed"}));
    ASSERT_TRUE(load.Says(" s of 72000.0 s"));
    load.Signal(signal);
    EXPECT_EQ(load.Wait(), 0) << load.said();
    const nlohmann::json json = nlohmann::json::parse(load.out());
    EXPECT_EQ(json["interrupted"], true);
    EXPECT_GT(json["all"]["requests"], 0);
    EXPECT_EQ(json["all"]["answered"], json["all"]["requests"]);
    EXPECT_EQ(SceneCount(), 1u);
  }
}

TEST_F(LoadSignalTest, ASearchEndsWithItsTrials) {
  LoadProcess load(Args({"--find-knee", "--rate=50", "--slo=p99=10h", "--trial=20h"}));
  ASSERT_TRUE(load.Says("trying 50/s"));
  load.Signal(SIGINT);
  EXPECT_EQ(load.Wait(), cli::kExitTemporary) << load.said();
  EXPECT_THAT(load.said(), HasSubstr("interrupted while the knee was searched"));
  EXPECT_EQ(nlohmann::json::parse(load.out())["interrupted"], true);
}

TEST_F(LoadSignalTest, ASecondSignalEndsItThereAndThen) {
  for (const int signal : {SIGINT, SIGTERM}) {
    LoadProcess load(Args({"--drain=10h"}));
    ASSERT_TRUE(load.Says(" s of 72000.0 s"));
    // So that what is under way is never answered.
    server_.Signal(SIGSTOP);
    load.Signal(signal);
    const bool heard = static_cast<bool>(load.Says("interrupted: once more"));
    load.Signal(signal);
    const int code = load.Wait();
    server_.Signal(SIGCONT);
    EXPECT_TRUE(heard);
    EXPECT_EQ(code, 1000 + signal) << load.said();
    EXPECT_EQ(load.out(), "");
  }
}

}  // namespace
}  // namespace sightline::load
