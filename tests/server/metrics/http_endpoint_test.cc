// SPDX-License-Identifier: Apache-2.0
#include "server/metrics/http_endpoint.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/support/http_get.h"

namespace sightline {
namespace {

using testing_support::HttpGet;

TEST(HttpEndpointTest, AnswersItsPathsAndNothingElse) {
  const auto http = HttpEndpoint::Start(
      "127.0.0.1:0", {{"/good", [](const HttpRequest&) { return HttpReply{.body = "fine\n"}; }},
                      {"/bad", [](const HttpRequest& request) {
                         return HttpReply{.code = 503, .body = request.authorization};
                       }}});
  ASSERT_TRUE(http.ok()) << http.status();
  const int port = (*http)->port();
  ASSERT_GT(port, 0);
  EXPECT_EQ(HttpGet(port, "/good").code, 200);
  EXPECT_EQ(HttpGet(port, "/good").body, "fine\n");
  EXPECT_EQ(HttpGet(port, "/bad").code, 503);
  EXPECT_EQ(HttpGet(port, "/bad", "Authorization: Bearer x\r\n").body, "Bearer x");
  EXPECT_EQ(HttpGet(port, "/").code, 404);
  EXPECT_EQ(HttpGet(port, "/../etc/passwd").code / 100, 4);
}

TEST(HttpEndpointTest, WhatCannotBeBoundIsSaid) {
  const auto first = HttpEndpoint::Start("127.0.0.1:0", {});
  ASSERT_TRUE(first.ok()) << first.status();
  const std::string taken = absl::StrCat("127.0.0.1:", (*first)->port());
  const absl::Status status = HttpEndpoint::Start(taken, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr(taken));
  for (const char* wrong : {"9090", "unix:x", "", "127.0.0.1:many"}) {
    EXPECT_EQ(HttpEndpoint::Start(wrong, {}).status().code(), absl::StatusCode::kInvalidArgument)
        << wrong;
  }
}

}  // namespace
}  // namespace sightline
