// SPDX-License-Identifier: Apache-2.0
#include "server/base/request_log.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "server/base/error.h"

namespace sightline {
namespace {

TEST(RequestLogTest, ARepeatedIdReturnsWhatTheFirstMade) {
  RequestLog log;
  {
    absl::StatusOr<RequestClaim> first = log.Claim("r", "print");
    ASSERT_TRUE(first.ok());
    EXPECT_FALSE(first->repeated());
    const absl::Status busy = log.Claim("r", "print").status();
    EXPECT_EQ(ReasonOf(busy), v1::ERROR_REASON_SCENE_BUSY);
    v1::ItemStatus item;
    ToItemStatus(busy, &item);
    EXPECT_EQ(item.metadata().at("field"), "request_id");
    EXPECT_EQ(item.metadata().at("value"), "r");
    first->Complete("scenes/a");
  }
  const absl::StatusOr<RequestClaim> second = log.Claim("r", "print");
  ASSERT_TRUE(second.ok());
  EXPECT_TRUE(second->repeated());
  EXPECT_EQ(second->resource(), "scenes/a");
  EXPECT_EQ(ReasonOf(log.Claim("r", "other").status()), v1::ERROR_REASON_REQUEST_ID_REUSED);
}

TEST(RequestLogTest, AFailedCallLeavesNoTrace) {
  RequestLog log;
  { const absl::StatusOr<RequestClaim> dropped = log.Claim("r", "print"); }
  EXPECT_FALSE(log.Claim("r", "another print")->repeated());
}

TEST(RequestLogTest, WhatIsGoneCanBeMadeAgain) {
  RequestLog log;
  log.Claim("r", "print")->Complete("scenes/a");
  log.ForgetResource("scenes/b");
  EXPECT_TRUE(log.Claim("r", "print")->repeated());
  log.ForgetResource("scenes/a");
  EXPECT_FALSE(log.Claim("r", "print")->repeated());
}

TEST(RequestLogTest, IsBounded) {
  RequestLog log(2);
  for (int i = 0; i < 5; ++i) log.Claim(absl::StrCat("r", i), "")->Complete("scenes/a");
  EXPECT_FALSE(log.Claim("r0", "")->repeated());
  EXPECT_TRUE(log.Claim("r4", "")->repeated());
}

TEST(RequestLogTest, NoIdMeansNoPromise) {
  RequestLog log;
  log.Claim("", "print")->Complete("scenes/a");
  EXPECT_FALSE(log.Claim("", "print")->repeated());
  EXPECT_EQ(log.Claim(std::string(129, 'x'), "").status().code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace sightline
