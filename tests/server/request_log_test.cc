// SPDX-License-Identifier: Apache-2.0
#include "server/base/request_log.h"

#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "gtest/gtest.h"
#include "server/base/error.h"

namespace sightline {
namespace {

TEST(RequestLogTest, ARepeatedIdReturnsWhatTheFirstMade) {
  RequestLog log;
  {
    absl::StatusOr<RequestClaim> first = log.Claim("r", FingerprintOf("print"));
    ASSERT_TRUE(first.ok());
    EXPECT_FALSE(first->repeated());
    const absl::Status busy = log.Claim("r", FingerprintOf("print")).status();
    EXPECT_EQ(ReasonOf(busy), v1::ERROR_REASON_SCENE_BUSY);
    EXPECT_TRUE(absl::StrContains(busy.message(), "ask again")) << busy;
    v1::ItemStatus item;
    ToItemStatus(busy, &item);
    EXPECT_EQ(item.metadata().at("field"), "request_id");
    EXPECT_EQ(item.metadata().at("value"), "r");
    first->Complete("scenes/a");
  }
  const absl::StatusOr<RequestClaim> second = log.Claim("r", FingerprintOf("print"));
  ASSERT_TRUE(second.ok());
  EXPECT_TRUE(second->repeated());
  EXPECT_EQ(second->resource(), "scenes/a");
  EXPECT_EQ(ReasonOf(log.Claim("r", FingerprintOf("other")).status()),
            v1::ERROR_REASON_REQUEST_ID_REUSED);
}

TEST(RequestLogTest, AFailedCallLeavesNoTrace) {
  RequestLog log;
  { const absl::StatusOr<RequestClaim> dropped = log.Claim("r", FingerprintOf("print")); }
  EXPECT_FALSE(log.Claim("r", FingerprintOf("another print"))->repeated());
}

TEST(RequestLogTest, WhatIsGoneCanBeMadeAgain) {
  RequestLog log;
  log.Claim("r", FingerprintOf("print"))->Complete("scenes/a");
  log.ForgetResource("scenes/b");
  EXPECT_TRUE(log.Claim("r", FingerprintOf("print"))->repeated());
  log.ForgetResource("scenes/a");
  EXPECT_FALSE(log.Claim("r", FingerprintOf("print"))->repeated());
}

TEST(RequestLogTest, IsBounded) {
  RequestLog log(2);
  for (int i = 0; i < 5; ++i)
    log.Claim(absl::StrCat("r", i), FingerprintOf(""))->Complete("scenes/a");
  EXPECT_FALSE(log.Claim("r0", FingerprintOf(""))->repeated());
  EXPECT_TRUE(log.Claim("r4", FingerprintOf(""))->repeated());
}

// A header may be as large as a message: what is kept of it is not.
TEST(RequestLogTest, OfARequestItsDigestIsKept) {
  static_assert(sizeof(Fingerprint) == 32);
  std::string request(1 << 20, 'x');
  const Fingerprint kept = FingerprintOf(request);
  request.back() = 'y';
  EXPECT_NE(FingerprintOf(request), kept);
  request.back() = 'x';
  EXPECT_EQ(FingerprintOf(request), kept);
  // FIPS 180-4's example.
  EXPECT_EQ(absl::BytesToHexString(absl::string_view(
                reinterpret_cast<const char*>(FingerprintOf("abc").data()), sizeof(Fingerprint))),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
}

TEST(RequestLogTest, NoIdMeansNoPromise) {
  RequestLog log;
  log.Claim("", FingerprintOf("print"))->Complete("scenes/a");
  EXPECT_FALSE(log.Claim("", FingerprintOf("print"))->repeated());
  EXPECT_EQ(log.Claim(std::string(129, 'x'), FingerprintOf("")).status().code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace sightline
