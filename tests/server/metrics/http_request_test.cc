// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_request.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using State = HttpHead::State;

TEST(HttpRequestTest, ReadsWhatItAnswers) {
  const HttpHead head = ReadHttpHead(
      "GET /metrics?match=rays HTTP/1.1\r\nHost: x:9090\r\naUTHORIZATION: \t Bearer s3 cret \r\n"
      "Accept: */*\r\n\r\nwhat follows");
  EXPECT_EQ(head.state, State::kWhole);
  EXPECT_EQ(head.method, "GET");
  EXPECT_EQ(head.path, "/metrics");
  EXPECT_EQ(head.request.authorization, "Bearer s3 cret");
  EXPECT_EQ(ReadHttpHead("HEAD /livez HTTP/1.0\n\n").method, "HEAD");
  EXPECT_EQ(ReadHttpHead("GET http://x:9090/livez HTTP/1.1\r\n\r\n").path, "/livez");
  EXPECT_EQ(ReadHttpHead("GET http://x:9090 HTTP/1.1\r\n\r\n").path, "/");
  EXPECT_EQ(ReadHttpHead("OPTIONS * HTTP/1.1\r\n\r\n").path, "*");
}

TEST(HttpRequestTest, WhatIsNoRequestIsBad) {
  for (const char* bytes : {
           "\r\n",
           "\x16\x03\x01\n",                    // TLS.
           "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",  // gRPC.
           "GET /\r\n\r\n",                     // HTTP/0.9.
           "GET  / HTTP/1.1\r\n\r\n",
           "GET / HTTP/1.1 \r\n\r\n",
           "GET / HTTP/1.1\r\nno colon\r\n\r\n",
           "GET / HTTP/1.1\r\n: no name\r\n\r\n",
           "GET / HTTP/1.1\r\nHost : x\r\n\r\n",
           "GET / HTTP/1.1\r\nHost: x\r\n goes: on\r\n\r\n",
           "GET / HTTP/1.1\r\nHost: \x01\r\n\r\n",
           "GET / HTTP/1.1\r\nHost: a\rb\r\n\r\n",
           "GET / HTTP/1.1\r\nAuthorization: a\r\nAuthorization: a\r\n\r\n",
       }) {
    EXPECT_EQ(ReadHttpHead(bytes).state, State::kBad) << bytes;
  }
}

TEST(HttpRequestTest, AHeadIsBounded) {
  const std::string line = "GET / HTTP/1.1\r\nX: ";
  const std::string fits =
      absl::StrCat(line, std::string(kMostHeadBytes - line.size() - 4, 'x'), "\r\n\r\n");
  ASSERT_EQ(fits.size(), kMostHeadBytes);
  EXPECT_EQ(ReadHttpHead(fits).state, State::kWhole);
  EXPECT_EQ(ReadHttpHead(absl::StrCat(line, "x", fits.substr(line.size()))).state, State::kBad);
  EXPECT_EQ(ReadHttpHead(std::string(kMostHeadBytes, 'x')).state, State::kPartial);
  EXPECT_EQ(ReadHttpHead(std::string(kMostHeadBytes + 1, 'x')).state, State::kBad);
}

// Byte by byte: partial until it is whole, and the same then; and nothing is what it was not for
// what comes behind.
TEST(HttpRequestTest, EveryPrefixIsPartial) {
  const std::string whole = "GET /readyz HTTP/1.1\r\nHost: localhost\r\nAuthorization: a b\r\n\r\n";
  for (size_t n = 0; n < whole.size(); ++n) {
    EXPECT_EQ(ReadHttpHead(whole.substr(0, n)).state, State::kPartial) << n;
  }
  EXPECT_EQ(ReadHttpHead(whole).state, State::kWhole);
  testing_support::TestRng rng;
  for (int i = 0; i < 20'000; ++i) {
    std::string bytes = whole;
    for (uint64_t k = 1 + rng.Below(4); k-- > 0;) {
      bytes[rng.Below(bytes.size())] = static_cast<char>(rng.Below(256));
    }
    bool decided = false;
    State state = State::kPartial;
    for (size_t n = 0; n <= bytes.size(); n += 1 + rng.Below(7)) {
      const State now = ReadHttpHead(bytes.substr(0, n)).state;
      EXPECT_TRUE(!decided || now == state) << bytes.substr(0, n);
      decided = now != State::kPartial;
      state = now;
    }
  }
}

}  // namespace
}  // namespace sightline
