// SPDX-License-Identifier: Apache-2.0
#include "server/base/error.h"

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "server/base/log.h"
#include "server/base/memory_guard.h"
#include "server/base/resource_name.h"
#include "server/base/shortened.h"
#include "server/services/unary.h"

namespace sightline {
namespace {

v1::ErrorInfo InfoOf(const grpc::Status& status) {
  v1::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  EXPECT_EQ(details.code(), static_cast<int>(status.error_code()));
  EXPECT_EQ(details.message(), status.error_message());
  EXPECT_EQ(details.details_size(), 1);
  EXPECT_EQ(details.details(0).type_url(), "type.googleapis.com/google.rpc.ErrorInfo");
  v1::ErrorInfo info;
  EXPECT_TRUE(info.ParseFromString(details.details(0).value()));
  return info;
}

TEST(ErrorTest, GrpcStatusCarriesReasonAndMetadata) {
  const grpc::Status status = ToGrpcStatus(OverLimit("rays", 7, "max_item_rays", 5, "cut it"));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(status.error_message(), "rays = 7 is over the limit max_item_rays = 5: cut it");
  const v1::ErrorInfo info = InfoOf(status);
  EXPECT_EQ(info.reason(), "LIMIT_EXCEEDED");
  EXPECT_EQ(info.domain(), "sightline");
  EXPECT_EQ(info.metadata().at("limit"), "max_item_rays");
  EXPECT_EQ(info.metadata().at("limit_value"), "5");
  EXPECT_EQ(info.metadata().at("value"), "7");
}

TEST(ErrorTest, NoErrorLeavesWithoutAReason) {
  for (int code = 1; code <= 16; ++code) {
    const grpc::Status status =
        ToGrpcStatus(absl::Status(static_cast<absl::StatusCode>(code), "text"));
    EXPECT_EQ(static_cast<int>(status.error_code()), code);
    EXPECT_FALSE(InfoOf(status).reason().empty()) << code;
  }
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
}

TEST(ErrorTest, TheFirstReasonIsKept) {
  absl::Status status = InvalidField("f", 3, "must be 4");
  status = WithReason(status, v1::ERROR_REASON_INTERNAL);
  EXPECT_EQ(ReasonOf(status), v1::ERROR_REASON_INVALID_FIELD);
  EXPECT_TRUE(WithReason(absl::OkStatus(), v1::ERROR_REASON_INTERNAL).ok());
}

// Whatever a client sends: its name for a scene may be megabytes, and comes back in a trailer.
TEST(ErrorTest, LongTextIsNotToldBack) {
  const std::string text(1 << 20, 'x');
  const absl::Status field = InvalidField("builtin.spec", text, "must be short");
  EXPECT_EQ(std::string(field.message()),
            "builtin.spec = " + std::string(200, 'x') + "... (1048576 bytes): must be short");
  EXPECT_LT(InfoOf(ToGrpcStatus(field)).metadata().at("value").size(), 230u);
  const absl::Status long_message =
      WithReason(absl::NotFoundError(text), v1::ERROR_REASON_OBJECT_NOT_FOUND, {{"a", text}});
  const grpc::Status sent = ToGrpcStatus(long_message);
  EXPECT_LT(sent.error_message().size(), 1060u);
  EXPECT_LT(InfoOf(sent).metadata().at("a").size(), 230u);
  EXPECT_LT(sent.error_details().size(), 1500u);
  v1::ItemStatus item;
  ToItemStatus(long_message, &item);
  EXPECT_LT(item.ByteSizeLong(), 1500u);
}

// A name that a mesh may have is nearly as long as a message, and stands before what is wrong.
TEST(ErrorTest, ALongMessageKeepsItsCauseAndItsRemedy) {
  const std::string name(1010, 'x');
  const absl::Status status = absl::InvalidArgumentError(
      absl::StrCat("object 1 \"", name, "\" has the name of object 0: rename one of them"));
  const std::string whole(status.message());
  ASSERT_GT(whole.size(), 1024u);
  const std::string told = absl::StrCat(whole.substr(0, 700), "... (", whole.size(), " bytes) ...",
                                        whole.substr(whole.size() - 324));
  EXPECT_EQ(ToGrpcStatus(status).error_message(), told);
  v1::ItemStatus item;
  ToItemStatus(status, &item);
  EXPECT_EQ(item.message(), told);
  const absl::Status longest = absl::InvalidArgumentError(whole.substr(0, 1024));
  EXPECT_EQ(ToGrpcStatus(longest).error_message(), whole.substr(0, 1024));
}

TEST(ErrorTest, CharactersAreNotCut) {
  EXPECT_EQ(Shortened("abc", 3), "abc");
  EXPECT_EQ(Shortened("abcd", 3), "abc... (4 bytes)");
  EXPECT_EQ(Shortened("a\u00e9x", 2), "a... (4 bytes)");
  EXPECT_EQ(Shortened("a\u00e9x", 3), "a\u00e9... (4 bytes)");
  EXPECT_EQ(Shortened("\U0001F600", 3), "... (4 bytes)");
  EXPECT_EQ(Shortened("\x80\x80\x80\x80\x80", 4), "\x80... (5 bytes)");
  EXPECT_EQ(ShortenedWithin("abcd", 2, 2), "abcd");
  EXPECT_EQ(ShortenedWithin("abcde", 2, 2), "ab... (5 bytes) ...de");
  EXPECT_EQ(ShortenedWithin("a\u00e9xy\u00e9b", 2, 2), "a... (8 bytes) ...b");
  EXPECT_EQ(ShortenedWithin("a\u00e9xy\u00e9b", 3, 3), "a\u00e9... (8 bytes) ...\u00e9b");
  EXPECT_EQ(ShortenedWithin("ab\U0001F600", 1, 3), "a... (6 bytes) ...");
  EXPECT_EQ(ShortenedWithin("ab\x80\x80\x80\x80\x80", 1, 4), "a... (7 bytes) ...\x80");
}

TEST(ErrorTest, ItemStatusSaysTheSame) {
  v1::ItemStatus item;
  ToItemStatus(InvalidField("item.width", 0, "must be at least 1"), &item);
  EXPECT_EQ(item.code(), 3);
  EXPECT_EQ(item.reason(), v1::ERROR_REASON_INVALID_FIELD);
  EXPECT_EQ(item.message(), "item.width = 0: must be at least 1");
  EXPECT_EQ(item.metadata().at("field"), "item.width");
  ToItemStatus(absl::OkStatus(), &item);
  EXPECT_EQ(item.ByteSizeLong(), 0u);
}

TEST(ResourceNameTest, TakesGoodNamesAndNothingElse) {
  EXPECT_EQ(*ParseSceneName("name", "scenes/hall-1.b_c"), "hall-1.b_c");
  const PointSetName set = *ParsePointSetName("name", "scenes/hall/pointSets/floor");
  EXPECT_EQ(set.scene_id, "hall");
  EXPECT_EQ(set.point_set_id, "floor");
  const std::string long_id(64, 'a');
  for (const std::string& bad :
       {std::string(), std::string("hall"), std::string("scenes/"), std::string("scenes/Hall"),
        std::string("scenes/../etc"), std::string("scenes/a/b"), std::string("scenes/-a"),
        std::string("scenes/a\n"), std::string("scenes/a\0b", 10), "scenes/" + long_id,
        std::string("scenes/h\xC3\xA4ll"), std::string(1 << 20, '/')}) {
    const absl::Status status = ParseSceneName("name", bad).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << bad.substr(0, 40);
    EXPECT_LT(status.message().size(), 300u);
  }
  EXPECT_FALSE(ParsePointSetName("name", "scenes/hall/points/floor").ok());
  EXPECT_FALSE(ParsePointSetName("name", "scenes/hall").ok());
  EXPECT_TRUE(CheckId("id", MakeId("scene")).ok());
  EXPECT_NE(MakeId("scene"), MakeId("scene"));
}

TEST(ErrorTest, SaysWhenToTryAgain) {
  const absl::Status refused = WithRetryDelay(
      OverLimit("rays", 2, "max_queued_rays", 1, "try again later", v1::ERROR_REASON_QUEUE_FULL),
      absl::Milliseconds(1250));
  v1::ItemStatus item;
  ToItemStatus(refused, &item);
  EXPECT_EQ(item.reason(), v1::ERROR_REASON_QUEUE_FULL);
  EXPECT_EQ(item.retry_delay().seconds(), 1);
  EXPECT_EQ(item.retry_delay().nanos(), 250'000'000);
  v1::Status details;
  ASSERT_TRUE(details.ParseFromString(ToGrpcStatus(refused).error_details()));
  ASSERT_EQ(details.details_size(), 2);
  EXPECT_EQ(details.details(1).type_url(), kRetryInfoUrl);
  v1::RetryInfo retry;
  ASSERT_TRUE(retry.ParseFromString(details.details(1).value()));
  EXPECT_EQ(retry.retry_delay().seconds(), 1);
  // Never at once, and never for ever.
  ToItemStatus(WithRetryDelay(refused, absl::ZeroDuration()), &item);
  EXPECT_EQ(item.retry_delay().nanos(), 1'000'000);
  ToItemStatus(WithRetryDelay(refused, absl::InfiniteDuration()), &item);
  EXPECT_EQ(item.retry_delay().seconds(), 60);
  ToItemStatus(absl::CancelledError("gone"), &item);
  EXPECT_FALSE(item.has_retry_delay());
}

TEST(MemoryGuardTest, TurnsAFailedAllocationIntoAStatus) {
  EXPECT_TRUE(GuardMemory([] { return absl::OkStatus(); }).ok());
  EXPECT_EQ(*GuardMemory([]() -> absl::StatusOr<int> { return 7; }), 7);
  const absl::Status failed = GuardMemory([]() -> absl::Status { throw std::bad_alloc(); });
  EXPECT_EQ(failed.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(failed), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  v1::ItemStatus item;
  ToItemStatus(failed, &item);
  EXPECT_TRUE(item.has_retry_delay());
}

TEST(PageTest, TokensGoBackAndForthAndNothingElseIsOne) {
  EXPECT_EQ(ParsePage(0, "")->size, 100u);
  EXPECT_EQ(ParsePage(5000, "")->size, 1000u);
  EXPECT_EQ(ParsePage(7, PageToken("hall"))->after, "hall");
  EXPECT_FALSE(ParsePage(-1, "").ok());
  EXPECT_FALSE(ParsePage(1, "hall").ok());
  EXPECT_FALSE(ParsePage(1, "~").ok());
}

TEST(LogTest, ValuesCannotForgeLines) {
  EXPECT_EQ(QuoteLogValue("hall"), "hall");
  EXPECT_EQ(QuoteLogValue(""), "\"\"");
  EXPECT_EQ(QuoteLogValue("a b"), "\"a b\"");
  EXPECT_EQ(QuoteLogValue("a\nlevel=error"), "\"a\\nlevel=error\"");
  EXPECT_EQ(QuoteLogValue("say \"hi\""), "\"say \\\"hi\\\"\"");
  EXPECT_FALSE(ParseLogLevel("loud").ok());
}

}  // namespace
}  // namespace sightline
