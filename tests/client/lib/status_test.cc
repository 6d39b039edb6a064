// SPDX-License-Identifier: Apache-2.0
#include "client/lib/status.h"

#include "client/lib/backoff.h"
#include "gmock/gmock.h"
#include "google/protobuf/duration.pb.h"
#include "gtest/gtest.h"

namespace sightline::client {
namespace {

grpc::Status WithDetail(grpc::StatusCode code, const std::string& url, const std::string& value) {
  v1::Status details;
  details.set_code(code);
  google::protobuf::Any* any = details.add_details();
  any->set_type_url(url);
  any->set_value(value);
  return grpc::Status(code, "what was wrong", details.SerializeAsString());
}

TEST(StatusTest, KeepsCodeMessageAndReason) {
  v1::ErrorInfo info;
  info.set_reason("SCENE_NOT_FOUND");
  (*info.mutable_metadata())["resource"] = "scenes/x";
  const absl::Status status =
      FromGrpc(WithDetail(grpc::StatusCode::NOT_FOUND, kErrorInfoUrl, info.SerializeAsString()));
  EXPECT_EQ(status.code(), absl::StatusCode::kNotFound);
  EXPECT_EQ(status.message(), "what was wrong");
  const std::optional<ErrorDetail> detail = GetErrorDetail(status);
  ASSERT_TRUE(detail.has_value());
  EXPECT_EQ(detail->reason, "SCENE_NOT_FOUND");
  EXPECT_EQ(detail->metadata.at("resource"), "scenes/x");
  EXPECT_TRUE(FromGrpc(grpc::Status::OK).ok());
  EXPECT_FALSE(GetErrorDetail(absl::NotFoundError("plain")).has_value());
  // Details that are no message of ours do no harm.
  const absl::Status odd =
      FromGrpc(grpc::Status(grpc::StatusCode::INTERNAL, "x", "\xff\xff garbage"));
  EXPECT_EQ(odd.code(), absl::StatusCode::kInternal);
}

TEST(StatusTest, SaysThatTheServerDoesNotKnowACall) {
  const absl::Status status = FromGrpc(grpc::Status(grpc::StatusCode::UNIMPLEMENTED, ""));
  EXPECT_EQ(status.code(), absl::StatusCode::kUnimplemented);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("older than this client"));
  EXPECT_EQ(FromGrpc(grpc::Status(grpc::StatusCode::UNIMPLEMENTED, "no gzip")).message(),
            "no gzip");
}

// gRPC's own word for it is "Deadline Exceeded"; what the server says of one has details.
TEST(StatusTest, SaysWhoseDeadlinePassed) {
  const absl::Status own =
      FromGrpc(grpc::Status(grpc::StatusCode::DEADLINE_EXCEEDED, "Deadline Exceeded"));
  EXPECT_EQ(own.code(), absl::StatusCode::kDeadlineExceeded);
  EXPECT_THAT(std::string(own.message()), testing::HasSubstr("longer timeout"));
  v1::ErrorInfo info;
  info.set_reason("DEADLINE_EXCEEDED");
  const absl::Status told = FromGrpc(
      WithDetail(grpc::StatusCode::DEADLINE_EXCEEDED, kErrorInfoUrl, info.SerializeAsString()));
  EXPECT_EQ(told.message(), "what was wrong");
}

TEST(StatusTest, ItemsLikeCalls) {
  v1::ItemStatus item;
  EXPECT_TRUE(FromItem(item).ok());
  item.set_code(8);
  item.set_reason(v1::ERROR_REASON_QUEUE_FULL);
  item.set_message("full");
  (*item.mutable_metadata())["limit"] = "max_queued_rays";
  const absl::Status status = FromItem(item);
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(GetErrorDetail(status)->reason, "QUEUE_FULL");
  EXPECT_EQ(GetErrorDetail(status)->metadata.at("limit"), "max_queued_rays");
  EXPECT_TRUE(IsRetryable(status));
  item.set_reason(v1::ERROR_REASON_LIMIT_EXCEEDED);
  EXPECT_FALSE(IsRetryable(FromItem(item)));
  // A limit that others' uploads take up passes: the server says when to ask again.
  item.mutable_retry_delay()->set_seconds(1);
  EXPECT_TRUE(IsRetryable(FromItem(item)));
  item.set_code(99);
  EXPECT_EQ(FromItem(item).code(), absl::StatusCode::kUnknown);
}

TEST(StatusTest, RetryDelayIsHeard) {
  google::protobuf::Duration delay;
  delay.set_seconds(2);
  delay.set_nanos(500'000'000);
  // google.rpc.RetryInfo: field 1, length-delimited.
  const std::string bytes = delay.SerializeAsString();
  const std::string info = std::string("\x0a") + static_cast<char>(bytes.size()) + bytes;
  const absl::Status status =
      FromGrpc(WithDetail(grpc::StatusCode::RESOURCE_EXHAUSTED, kRetryInfoUrl, info));
  EXPECT_EQ(RetryDelay(status), absl::Milliseconds(2500));
  EXPECT_TRUE(IsRetryable(status));
  Backoff backoff({.initial_delay = absl::Milliseconds(1)});
  EXPECT_GE(backoff.Next(status), absl::Milliseconds(2500));
  EXPECT_FALSE(RetryDelay(absl::UnavailableError("x")).has_value());
  EXPECT_TRUE(IsRetryable(absl::UnavailableError("x")));
  EXPECT_FALSE(IsRetryable(absl::InvalidArgumentError("x")));
  EXPECT_FALSE(IsRetryable(absl::OkStatus()));
}

TEST(BackoffTest, GrowsToItsBoundWithJitter) {
  Backoff backoff({.initial_delay = absl::Milliseconds(100),
                   .max_delay = absl::Milliseconds(300),
                   .multiplier = 2});
  for (absl::Duration bound : {absl::Milliseconds(100), absl::Milliseconds(200),
                               absl::Milliseconds(300), absl::Milliseconds(300)}) {
    const absl::Duration wait = backoff.Next(absl::UnavailableError(""));
    EXPECT_GE(wait, bound / 2);
    EXPECT_LE(wait, bound);
  }
  backoff.Reset();
  EXPECT_LE(backoff.Next(absl::UnavailableError("")), absl::Milliseconds(100));
}

TEST(BackoffTest, StaysForMoreOfTheSameAndWithinTheTimeLeft) {
  const absl::Status status = absl::UnavailableError("");
  Backoff backoff({.initial_delay = absl::Milliseconds(100), .multiplier = 10});
  EXPECT_LE(backoff.Next(status), absl::Milliseconds(100));
  for (int i = 0; i < 10; ++i) {
    const absl::Duration wait = backoff.Again(status);
    EXPECT_GE(wait, absl::Milliseconds(50));
    EXPECT_LE(wait, absl::Milliseconds(100));
  }
  EXPECT_EQ(backoff.Next(status, absl::Milliseconds(7)), absl::Milliseconds(7));
  EXPECT_EQ(backoff.Again(status, absl::Milliseconds(8)), absl::Milliseconds(8));
}

}  // namespace
}  // namespace sightline::client
