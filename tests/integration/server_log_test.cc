// SPDX-License-Identifier: Apache-2.0
//
// The real server's log: nobody reads it, and it answers and ends as ever; of items it has those
// that took as long as the operator wants to know of.
#include <fcntl.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <fstream>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/server_process.h"
#include "tests/integration/serving_process.h"
#include "tests/support/http_get.h"
#include "tests/support/temp_dir.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using testing_support::MetricOf;

std::string AfterEquals(const std::string& line, const std::string& name) {
  const size_t at = line.find(absl::StrCat(" ", name, "="));
  return at == std::string::npos ? "" : line.substr(at + name.size() + 2);
}

// Each item is a line, and the pipe holds a page of them.
TEST(ServerLogTest, AFullPipeHoldsNothingUp) {
  ServerProcess process({"--listen=127.0.0.1:0", "--metrics-listen=127.0.0.1:0",
                         "--scene=box=builtin:box:1000", "--slow-query-log=0s"},
                        [] { (void)fcntl(STDERR_FILENO, F_SETPIPE_SZ, 4096); });
  const std::string serving = process.ReadUntil("event=serving");
  const int port = std::atoi(AfterEquals(serving, "port").c_str());
  const int metrics_port = std::atoi(AfterEquals(serving, "metrics_port").c_str());
  ASSERT_GT(port, 0) << serving;
  ASSERT_GT(metrics_port, 0) << serving;

  const auto channel = ServingProcess::ChannelTo(absl::StrCat("127.0.0.1:", port));
  grpc::ClientContext context;
  const auto stream = v1::VisibilityService::NewStub(channel)->TraceTiles(&context);
  stream->Write(BoxHeader());
  v1::TraceTilesResponse response;
  ASSERT_TRUE(stream->Read(&response));
  const std::string dropped = "sightline_dropped_log_lines_total";
  uint64_t items = 0;
  for (; MetricOf(metrics_port, dropped) == 0; items += 256) {
    for (uint64_t i = 0; i < 256; ++i) stream->Write(TileRequest(items + i, 0, 0, 8, 8));
    for (uint64_t i = 0; i < 256; ++i) {
      ASSERT_TRUE(stream->Read(&response));
      ASSERT_EQ(response.reply().header().status().code(), 0);
    }
  }
  EXPECT_GT(items, 2000u);
  stream->WritesDone();
  while (stream->Read(&response)) {
  }
  EXPECT_TRUE(stream->Finish().ok());

  // As soon as somebody reads, it is said how many are missing.
  const std::string told = process.ReadUntil("event=log_lines_dropped");
  EXPECT_TRUE(absl::StrContains(told, "level=warning event=log_lines_dropped lines=")) << told;
  EXPECT_GT(std::atoi(AfterEquals(told, "lines").c_str()), 0) << told;
  process.Signal(SIGTERM);
  const std::string stopped = process.ReadUntil("event=stopped");
  EXPECT_TRUE(absl::StrContains(stopped, "event=stopped status=OK")) << stopped;
  EXPECT_EQ(process.Wait(), 0);
}

// Nobody ever reads, and the pipe is full when the end comes.
TEST(ServerLogTest, AFullPipeHoldsUpNoEnd) {
  const auto fill = [] {
    (void)fcntl(STDERR_FILENO, F_SETPIPE_SZ, 4096);
    (void)fcntl(STDERR_FILENO, F_SETFL, O_NONBLOCK);
    const std::string line(512, '.');
    while (write(STDERR_FILENO, line.data(), line.size()) > 0) {
    }
    (void)fcntl(STDERR_FILENO, F_SETFL, 0);
  };
  const testing_support::TempDir dir;
  ServerProcess good({"--listen=127.0.0.1:0", "--port-file", dir.File("port")}, fill);
  ASSERT_TRUE(testing_support::Until("the server says its port",
                                     [&] { return access(dir.File("port").c_str(), F_OK) == 0; }));
  std::string port;
  std::ifstream(dir.File("port")) >> port;
  // This one cannot start, since its port is taken.
  ServerProcess bad({absl::StrCat("--listen=127.0.0.1:", port)}, fill);
  EXPECT_EQ(bad.Wait(), 69);
  good.Signal(SIGTERM);
  EXPECT_EQ(good.Wait(), 0);
}

// Of the same item: a threshold below what anything takes, and one above what it could.
TEST(ServerLogTest, SlowItemsAreLoggedAndOthersAreNot) {
  for (const bool slow : {true, false}) {
    ServingProcess server({"--scene=box=builtin:box:1000", "--metrics-listen=127.0.0.1:0",
                           slow ? "--slow-query-log=1ns" : "--slow-query-log=1h"});
    const auto channel = server.Channel();
    grpc::ClientContext context;
    const auto stream = v1::VisibilityService::NewStub(channel)->TraceTiles(&context);
    stream->Write(BoxHeader());
    stream->Write(TileRequest(17, 0, 0, 64, 64));
    stream->WritesDone();
    v1::TraceTilesResponse response;
    while (stream->Read(&response)) {
    }
    EXPECT_TRUE(stream->Finish().ok());
    server.Signal(SIGTERM);
    // The last line: whatever was logged of the item is before it.
    ASSERT_TRUE(
        testing_support::Until("it has stopped", [&] { return server.HasSaid("event=stopped"); }));
    EXPECT_EQ(server.Wait(), 0);
    EXPECT_EQ(server.HasSaid("event=slow_query"), slow);
    EXPECT_EQ(server.HasSaid("level=warning event=slow_query method=TraceTiles scene=box "
                             "revision=1 item=17 peer="),
              slow);
    EXPECT_EQ(server.HasSaid(" status=OK total_ms="), slow);
    EXPECT_EQ(server.HasSaid(" rays=4096 "), slow);
  }
}

}  // namespace
}  // namespace sightline
