// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_endpoint.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/integration/raw_connection.h"
#include "tests/support/http_get.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;
using testing_support::HttpGet;
using testing_support::Until;
using Connections = std::vector<std::unique_ptr<RawConnection>>;

HttpReply Fine(const HttpRequest&) { return {.body = "fine\n"}; }

// Whose clients have no need to hurry, so that a slow machine closes no connection.
std::unique_ptr<HttpEndpoint> Serve(HttpEndpoint::Handlers handlers,
                                    std::chrono::seconds patience = std::chrono::hours(1)) {
  absl::StatusOr<std::unique_ptr<HttpEndpoint>> http =
      HttpEndpoint::Start("127.0.0.1:0", std::move(handlers), patience);
  EXPECT_TRUE(http.ok()) << http.status();
  return *std::move(http);
}

// All that comes in answer to `request`, to the connection's end.
std::string Ask(int port, const std::string& request) {
  const RawConnection connection(port);
  connection.Send(request);
  return connection.ReadUntil("no such text");
}

TEST(HttpEndpointTest, AnswersItsPathsAndNothingElse) {
  const auto http =
      Serve({{"/good", &Fine}, {"/bad", [](const HttpRequest& request) {
                                  return HttpReply{.code = 503, .body = request.authorization};
                                }}});
  const int port = http->port();
  ASSERT_GT(port, 0);
  EXPECT_EQ(HttpGet(port, "/good").code, 200);
  EXPECT_EQ(HttpGet(port, "/good").body, "fine\n");
  EXPECT_EQ(HttpGet(port, "/good?verbose=1").body, "fine\n");
  EXPECT_EQ(HttpGet(port, "/bad").code, 503);
  EXPECT_EQ(HttpGet(port, "/bad", "Authorization: Bearer x\r\n").body, "Bearer x");
  EXPECT_EQ(HttpGet(port, "/").code, 404);
  EXPECT_EQ(HttpGet(port, "/good/").code, 404);
  EXPECT_EQ(HttpGet(port, "/../etc/passwd").code, 404);
  EXPECT_EQ(HttpGet(port, "/ good").code, 0);  // No request: closed without a word.
}

TEST(HttpEndpointTest, AnswersByTheBook) {
  const auto http = Serve({{"/good", &Fine}, {"/secret", [](const HttpRequest&) {
                                                return HttpReply{.code = 401, .body = "who?\n"};
                                              }}});
  const std::string good = Ask(http->port(), "GET /good HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_TRUE(absl::StartsWith(good, "HTTP/1.1 200 OK\r\n")) << good;
  for (const char* header : {"Content-Type: text/plain; charset=utf-8", "Content-Length: 5",
                             "Cache-Control: no-store", "Connection: close"}) {
    EXPECT_THAT(good, HasSubstr(absl::StrCat("\r\n", header, "\r\n")));
  }
  EXPECT_TRUE(absl::EndsWith(good, "\r\n\r\nfine\n")) << good;
  const std::string head = Ask(http->port(), "HEAD /good HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(head, HasSubstr("Content-Length: 5\r\n"));
  EXPECT_TRUE(absl::EndsWith(head, "\r\n\r\n")) << head;
  EXPECT_THAT(Ask(http->port(), "GET /secret HTTP/1.1\r\nHost: x\r\n\r\n"),
              HasSubstr("401 Unauthorized\r\n"));
  EXPECT_THAT(Ask(http->port(), "GET /secret HTTP/1.1\r\nHost: x\r\n\r\n"),
              HasSubstr("WWW-Authenticate: Bearer\r\n"));
  // Its body is there when the answer is sent, and does not make a reset of the end.
  const std::string post =
      Ask(http->port(), absl::StrCat("POST /good HTTP/1.1\r\nHost: x\r\n",
                                     "Content-Length: 100000\r\n\r\n", std::string(100'000, 'x')));
  EXPECT_THAT(post, HasSubstr("405 Method Not Allowed\r\n"));
  EXPECT_THAT(post, HasSubstr("Allow: GET, HEAD\r\n"));
  EXPECT_TRUE(absl::EndsWith(post, "GET or HEAD\n")) << post;
  // No HTTP/1, no host, two of what there may be one of, or a head beyond all measure.
  EXPECT_THAT(Ask(http->port(), "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"), HasSubstr(" 505 "));
  EXPECT_THAT(Ask(http->port(), "GET /good HTTP/1.1\r\n\r\n"), HasSubstr(" 400 "));
  EXPECT_THAT(
      Ask(http->port(), "GET /good HTTP/1.0\r\nAuthorization: x\r\nauthorization: y\r\n\r\n"),
      HasSubstr(" 400 "));
  EXPECT_THAT(
      Ask(http->port(),
          absl::StrCat("GET /good HTTP/1.1\r\nHost: ", std::string(64 << 10, 'x'), "\r\n\r\n")),
      HasSubstr(" 431 "));
}

// More bytes than the kernel takes at once.
TEST(HttpEndpointTest, LongAnswersComeWhole) {
  const std::string body(32 << 20, 'x');
  const auto http = Serve({{"/long", [&](const HttpRequest&) { return HttpReply{.body = body}; }}});
  EXPECT_EQ(HttpGet(http->port(), "/long").body, body);
}

// Whoever asks is answered while others say nothing, or half of what they have to say: those are
// still there then, so none had to time out first.
TEST(HttpEndpointTest, SilentAndSlowClientsKeepNobodyOut) {
  const auto http = Serve({{"/livez", &Fine}});
  Connections others;
  for (const char* says : {"", "GET /livez HTTP/1.1\r\nHost:"}) {
    for (int i = 0; i < 12; ++i) {
      others.push_back(std::make_unique<RawConnection>(http->port()));
      ASSERT_TRUE(others.back()->connected());
      others.back()->Send(says);
    }
  }
  for (int i = 0; i < 20; ++i) EXPECT_EQ(HttpGet(http->port(), "/livez").code, 200);
  for (const auto& other : others) EXPECT_TRUE(other->IsOpen());
  // A slow one that ends what it says is answered, too.
  others.back()->Send(" x\r\n\r\n");
  EXPECT_THAT(others.back()->ReadUntil("fine"), HasSubstr("200 OK"));
}

// Silent or slow: none stays for ever.
TEST(HttpEndpointTest, WhoeverTakesTooLongIsClosed) {
  const auto http = Serve({{"/fine", Fine}}, std::chrono::seconds(1));
  for (const char* says : {"", "GET /fine HTTP/1.1\r\n"}) {
    const RawConnection slow(http->port());
    slow.Send(says);
    EXPECT_TRUE(Until("it is closed", [&] { return !slow.IsOpen(); })) << says;
  }
}

// Beyond the bound the oldest make room; the newest are still there.
TEST(HttpEndpointTest, ConnectionsAreBoundedAndTheOldestMakeRoom) {
  constexpr size_t kMost = HttpEndpoint::kMostConnections;
  const auto http = Serve({{"/livez", &Fine}});
  Connections silent;
  for (size_t i = 0; i < 4 * kMost; ++i) {
    silent.push_back(std::make_unique<RawConnection>(http->port()));
    ASSERT_TRUE(silent.back()->connected());
  }
  EXPECT_EQ(HttpGet(http->port(), "/livez").code, 200);
  ASSERT_TRUE(Until("the oldest have made room", [&] { return !silent[3 * kMost - 1]->IsOpen(); }));
  for (size_t i = 0; i < 3 * kMost; ++i) EXPECT_FALSE(silent[i]->IsOpen()) << i;
  for (size_t i = 3 * kMost + 2; i < silent.size(); ++i) EXPECT_TRUE(silent[i]->IsOpen()) << i;
}

// A path whose handler hangs: its own callers wait or are sent away, and the others' do not.
TEST(HttpEndpointTest, APathThatHangsHoldsUpNoOther) {
  Mutex mutex;
  CondVar changed;
  bool go_on = false;
  std::atomic<size_t> running = 0;
  const auto http = Serve({{"/readyz", &Fine}, {"/livez", [&](const HttpRequest&) {
                                                  ++running;
                                                  MutexLock lock(mutex);
                                                  while (!go_on) changed.Wait(mutex);
                                                  return HttpReply{.body = "late\n"};
                                                }}});
  // One more than may wait: whichever of them comes last is told so.
  Connections callers;
  for (size_t i = 0; i <= HttpPath::kMostAtOnce; ++i) {
    callers.push_back(std::make_unique<RawConnection>(http->port()));
    callers.back()->Send("GET /livez HTTP/1.1\r\nHost: x\r\n\r\n");
  }
  const auto answered = [](const auto& caller) { return !caller->IsOpen(); };
  EXPECT_TRUE(Until("one is sent away", [&] { return std::ranges::any_of(callers, answered); }));
  const auto one = std::ranges::find_if(callers, answered);
  EXPECT_THAT((*one)->ReadUntil("no such text"), HasSubstr("503 Service Unavailable"));
  callers.erase(one);
  EXPECT_TRUE(std::ranges::none_of(callers, answered));
  for (int i = 0; i < 20; ++i) EXPECT_EQ(HttpGet(http->port(), "/readyz").body, "fine\n");
  EXPECT_LE(running, size_t{HttpPath::kThreads});
  {
    MutexLock lock(mutex);
    go_on = true;
    changed.SignalAll();
  }
  for (const auto& caller : callers) {
    EXPECT_THAT(caller->ReadUntil("no such text"), HasSubstr("late\n"));
  }
}

// Whoever says nothing does not hold up its end.
TEST(HttpEndpointTest, EndsWithConnectionsOpen) {
  Connections silent;
  {
    const auto http = Serve({{"/livez", &Fine}});
    silent.push_back(std::make_unique<RawConnection>(http->port()));
    EXPECT_EQ(HttpGet(http->port(), "/livez").code, 200);
  }
  EXPECT_FALSE(silent[0]->IsOpen());
}

// While what runs is waited for, the others' requests still come in.
TEST(HttpEndpointTest, WhoeverAsksWhileItEndsIsTold) {
  Mutex mutex;
  CondVar changed;
  bool go_on = false;
  std::atomic<size_t> running = 0;
  auto http = Serve({{"/livez", [&](const HttpRequest&) {
                        ++running;
                        MutexLock lock(mutex);
                        while (!go_on) changed.Wait(mutex);
                        return HttpReply{.body = "late\n"};
                      }}});
  const int port = http->port();
  const std::string request = "GET /livez HTTP/1.1\r\nHost: x\r\n\r\n";
  // Connections are taken in turn: once the second's request runs, the first's is in, too.
  const RawConnection waits(port), runs(port);
  runs.Send(request);
  ASSERT_TRUE(Until("it runs", [&] { return running == 1; }));
  std::thread end([&] { http.reset(); });
  EXPECT_TRUE(Until("nobody is let in", [&] { return !RawConnection(port).connected(); }));
  waits.Send(request);
  EXPECT_THAT(waits.ReadUntil("no such text"), HasSubstr("the server ends\n"));
  {
    MutexLock lock(mutex);
    go_on = true;
    changed.SignalAll();
  }
  end.join();
}

TEST(HttpEndpointTest, WhatCannotBeBoundIsSaid) {
  const auto first = Serve({});
  const std::string taken = absl::StrCat("127.0.0.1:", first->port());
  const absl::Status status = HttpEndpoint::Start(taken, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), HasSubstr(taken));
  for (const char* wrong : {"9090", "unix:x", "", "127.0.0.1:many"}) {
    EXPECT_EQ(HttpEndpoint::Start(wrong, {}).status().code(), absl::StatusCode::kInvalidArgument)
        << wrong;
  }
}

}  // namespace
}  // namespace sightline
