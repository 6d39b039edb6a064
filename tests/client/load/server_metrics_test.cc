// SPDX-License-Identifier: Apache-2.0
#include "client/load/server_metrics.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/temp_dir.h"

namespace sightline::load {
namespace {

using ::sightline::testing_support::TempDir;
using testing::HasSubstr;
using testing::StartsWith;

constexpr char kText[] =
    "# HELP sightline_requests_total Requests.\n"
    "# TYPE sightline_requests_total counter\n"
    "sightline_requests_total{result=\"ok\"} 12\n"
    "sightline_requests_total{result=\"a \\\" } b\"} 3 1700000000000\n"
    "\n"
    "sightline_pending 0.5\r\n"
    "sightline_seconds_bucket{le=\"+Inf\"} 9\n"
    "sightline_worst NaN\n"
    "process_cpu_seconds_total 4\n";

// Answers one HTTP request with `reply` on a free loopback port.
class OneAnswer {
 public:
  explicit OneAnswer(std::string reply) : reply_(std::move(reply)) {
    socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&address), size), 0);
    EXPECT_EQ(::listen(socket_, 1), 0);
    EXPECT_EQ(::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { Answer(); });
  }
  ~OneAnswer() {
    thread_.join();
    ::close(socket_);
  }
  std::string where() const { return absl::StrCat("127.0.0.1:", port_); }
  std::string request() const { return request_; }

 private:
  void Answer() {
    const int peer = ::accept(socket_, nullptr, nullptr);
    char buffer[4096];
    while (request_.find("\r\n\r\n") == std::string::npos) {
      const ssize_t got = ::read(peer, buffer, sizeof(buffer));
      if (got <= 0) break;
      request_.append(buffer, static_cast<size_t>(got));
    }
    for (size_t at = 0; at < reply_.size();) {
      const ssize_t put = ::send(peer, reply_.data() + at, reply_.size() - at, MSG_NOSIGNAL);
      if (put <= 0) break;
      at += static_cast<size_t>(put);
    }
    ::close(peer);
  }
  const std::string reply_;
  std::string request_;
  int socket_ = -1;
  int port_ = 0;
  std::thread thread_;
};

// The environment's proxy for a scope, with no host that goes without.
class ScopedProxy {
 public:
  explicit ScopedProxy(const std::string& where) {
    Set("http_proxy", absl::StrCat("http://", where));
    Set("no_proxy", std::nullopt);
    Set("NO_PROXY", std::nullopt);
  }
  ~ScopedProxy() {
    for (const auto& [name, value] : std::exchange(old_, {})) Set(name, value);
  }

 private:
  void Set(const char* name, const std::optional<std::string>& value) {
    const char* const was = std::getenv(name);
    old_.emplace_back(name, was == nullptr ? std::nullopt : std::optional<std::string>(was));
    if (value) {
      ::setenv(name, value->c_str(), 1);
    } else {
      ::unsetenv(name);
    }
  }
  std::vector<std::pair<const char*, std::optional<std::string>>> old_;
};

TEST(ServerMetricsTest, SamplesAreReadWithTheirLabels) {
  const absl::StatusOr<Metrics> metrics = ParseMetrics(kText);
  ASSERT_TRUE(metrics.ok()) << metrics.status();
  EXPECT_EQ(metrics->size(), 6u);
  EXPECT_EQ(metrics->at("sightline_requests_total{result=\"ok\"}"), 12);
  EXPECT_EQ(metrics->at("sightline_requests_total{result=\"a \\\" } b\"}"), 3);
  EXPECT_EQ(metrics->at("sightline_pending"), 0.5);
  EXPECT_TRUE(ParseMetrics("").ok());
}

TEST(ServerMetricsTest, WhatIsNoSampleIsNamedByItsLine) {
  for (const char* text :
       {"a 1\nb", "a 1\n<html>", "a 1\nb{c=\"d\" 4", "a 1\nb x", "a 1\nb 1 2 3", "a 1\n{x=\"y\""}) {
    const absl::StatusOr<Metrics> metrics = ParseMetrics(text);
    EXPECT_EQ(metrics.status().code(), absl::StatusCode::kInvalidArgument) << text;
    EXPECT_THAT(std::string(metrics.status().message()), HasSubstr("line 2")) << text;
  }
}

TEST(ServerMetricsTest, ChangesLeaveOutWhatIsNotTheServersOrDidNotChange) {
  const Metrics before = {{"a_total", 1}, {"b", 2}, {"process_x", 1}};
  const Metrics after = {
      {"a_total", 5}, {"b", 2}, {"c", 7}, {"process_x", 2}, {"d_bucket{le=\"1\"}", 3}};
  const std::map<std::string, MetricChange> changes = ChangedMetrics(before, after);
  ASSERT_EQ(changes.size(), 2u);
  EXPECT_EQ(changes.at("a_total").before, 1);
  EXPECT_EQ(changes.at("a_total").after, 5);
  EXPECT_EQ(changes.at("c").before, 0);
}

TEST(ServerMetricsTest, MetricsComeOverHttp) {
  const OneAnswer server(absl::StrCat("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n",
                                      "4\r\na 1\n\r\n4\r\nb 2\n\r\n0\r\n\r\n"));
  const absl::StatusOr<Metrics> metrics = ReadMetrics(server.where());
  ASSERT_TRUE(metrics.ok()) << metrics.status();
  EXPECT_EQ(metrics->size(), 2u);
  EXPECT_THAT(server.request(), HasSubstr("GET /metrics HTTP/1.1"));
}

TEST(ServerMetricsTest, AnErrorOfTheServerIsAnError) {
  const OneAnswer server("HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n");
  const absl::StatusOr<Metrics> metrics =
      ReadMetrics(absl::StrCat("http://", server.where(), "/elsewhere"));
  EXPECT_EQ(metrics.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(metrics.status().message()), HasSubstr("404"));
}

TEST(ServerMetricsTest, ATokenIsShown) {
  const OneAnswer server("HTTP/1.1 200 OK\r\nContent-Length: 4\r\n\r\na 1\n");
  EXPECT_TRUE(ReadMetrics(server.where(), "a-token").ok());
  EXPECT_THAT(server.request(), HasSubstr("\r\nAuthorization: Bearer a-token\r\n"));
}

// One that is asked for another host is told which: it would get the token with that.
TEST(ServerMetricsTest, WhatIsOnThisMachineIsReadWithoutTheEnvironmentsProxy) {
  for (const char* where : {"127.0.0.1:", "http://localhost:"}) {
    const OneAnswer server("HTTP/1.1 200 OK\r\nContent-Length: 4\r\n\r\na 1\n");
    const ScopedProxy proxy(server.where());
    const std::string port = server.where().substr(server.where().find(':') + 1);
    const std::string path = absl::StrContains(where, "//") ? "/metrics" : "";
    EXPECT_TRUE(ReadMetrics(absl::StrCat(where, port, path), "a-token").ok());
    EXPECT_THAT(server.request(), StartsWith("GET /metrics HTTP/1.1\r\n")) << where;
  }
  const OneAnswer server("HTTP/1.1 200 OK\r\nContent-Length: 4\r\n\r\na 1\n");
  const ScopedProxy proxy(server.where());
  EXPECT_TRUE(ReadMetrics("far.invalid:9090").ok());
  EXPECT_THAT(server.request(), StartsWith("GET http://far.invalid:9090/metrics HTTP/1.1\r\n"));
}

TEST(ServerMetricsTest, ARefusalNamesTheFlagThatIsMissing) {
  const OneAnswer server("HTTP/1.1 401 Unauthorized\r\nContent-Length: 0\r\n\r\n");
  EXPECT_THAT(std::string(ReadMetrics(server.where()).status().message()),
              HasSubstr("HTTP status 401: give a token with the role metrics by "
                        "--metrics-token-file"));
}

TEST(ServerMetricsTest, ATokenLeavesTheMachineOverTlsAlone) {
  const TempDir dir;
  const std::string path = dir.File("token");
  std::ofstream(path) << "a-token\n";
  std::filesystem::permissions(path, std::filesystem::perms::owner_read);
  for (const char* where : {"127.0.0.1:9090", "http://localhost/metrics", "https://far.org/m"}) {
    EXPECT_EQ(MetricsToken(path, where).value_or("none"), "a-token") << where;
  }
  for (const char* where : {"far.org:9090", "http://127.0.0.1@far.org/", "http://far.org/m",
                            "unix:9090", "http://unix/m"}) {
    EXPECT_THAT(std::string(MetricsToken(path, where).status().message()),
                HasSubstr("in the clear"))
        << where;
  }
  EXPECT_EQ(MetricsToken("", "far.org:9090").value_or("none"), "");
  EXPECT_FALSE(MetricsToken(dir.File("nothing"), "127.0.0.1:9090").ok());
}

TEST(ServerMetricsTest, OnlyHttpIsSpoken) {
  EXPECT_FALSE(ReadMetrics("file:///etc/hostname").ok());
  EXPECT_EQ(MetricsUrl("host:9"), "http://host:9/metrics");
  EXPECT_EQ(MetricsUrl("https://host/m"), "https://host/m");
}

}  // namespace
}  // namespace sightline::load
