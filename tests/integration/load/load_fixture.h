// SPDX-License-Identifier: Apache-2.0
//
// Runs of sightline-load within a test's process, and a server to run them against.
//
// Thread safety: one thread.
//
//   TEST_F(LoadRunTest, Answers) { EXPECT_EQ(RunWith({ServerFlag(), "--scene=box"}).code, 0); }
#ifndef SIGHTLINE_TESTS_INTEGRATION_LOAD_LOAD_FIXTURE_H_
#define SIGHTLINE_TESTS_INTEGRATION_LOAD_LOAD_FIXTURE_H_

#include <atomic>
#include <memory>
#include <nlohmann/json.hpp>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "client/load/run.h"
#include "gtest/gtest.h"
#include "server/base/log.h"
#include "server/server.h"

namespace sightline::load {

struct RunResult {
  int code = 0;
  std::string out, err;
  nlohmann::json json() const { return nlohmann::json::parse(out); }
};

// What a run of RunWith is told while it lasts.
struct Watched {
  const std::atomic<bool>* interrupted = nullptr;
  std::ostream* terminal = nullptr;  // Gets the live line, and what else goes to standard error.
};

// Small pictures of a small scene; no warm-up, and far more time than is needed. What `args` say
// wins.
inline RunResult RunWith(std::vector<std::string> args, const Watched& watched = {}) {
  for (const char* arg : {"--size=128x72", "--tile=32", "--cameras=2", "--points=64",
                          "--distinct=16", "--warm-up=0s", "--duration=10m"}) {
    args.insert(args.begin(), arg);
  }
  std::ostringstream out, err;
  RunResult result;
  result.code = RunLoad(args, out, watched.terminal != nullptr ? *watched.terminal : err,
                        /*err_is_terminal=*/watched.terminal != nullptr, watched.interrupted);
  result.out = out.str();
  result.err = err.str();
  return result;
}

// A server that has scenes/box, unless StartServer was told otherwise.
class LoadRunTest : public testing::Test {
 protected:
  void SetUp() override { StartServer({.scenes = {"box=builtin:box"}}); }
  // In place of the one before.
  void StartServer(ServerOptions options) {
    server_.reset();
    options.listen = {"127.0.0.1:0"};
    options.log_level = LogLevel::kOff;
    SetLogLevel(LogLevel::kOff);
    absl::StatusOr<std::unique_ptr<Server>> server = Server::Start(options);
    ASSERT_TRUE(server.ok()) << server.status();
    server_ = *std::move(server);
  }
  std::string Address() const { return absl::StrCat("127.0.0.1:", server_->port()); }
  std::string ServerFlag() const { return absl::StrCat("--server=", Address()); }
  client::Client Client() const { return client::Client(client::MakeConnection(Address(), {})); }
  std::vector<client::Scene> Scenes() const {
    absl::StatusOr<std::vector<client::Scene>> scenes = Client().ListScenes();
    EXPECT_TRUE(scenes.ok()) << scenes.status();
    return scenes.ok() ? *std::move(scenes) : std::vector<client::Scene>();
  }

  std::unique_ptr<Server> server_;
};

}  // namespace sightline::load

#endif  // SIGHTLINE_TESTS_INTEGRATION_LOAD_LOAD_FIXTURE_H_
