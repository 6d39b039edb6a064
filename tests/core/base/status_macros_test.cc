// SPDX-License-Identifier: Apache-2.0
#include "core/base/status_macros.h"

#include <memory>

#include "gtest/gtest.h"

namespace sightline {
namespace {

absl::StatusOr<std::unique_ptr<int>> Half(int n) {
  if (n % 2 != 0) return absl::InvalidArgumentError("odd");
  return std::make_unique<int>(n / 2);
}

absl::StatusOr<int> Quarter(int n) {
  SL_ASSIGN_OR_RETURN(std::unique_ptr<int> half, Half(n));
  SL_ASSIGN_OR_RETURN(half, Half(*half));
  return *half;
}

absl::Status Twice(int& calls, const absl::Status& first) {
  SL_RETURN_IF_ERROR((++calls, first));
  ++calls;
  return absl::OkStatus();
}

TEST(StatusMacrosTest, AssignsOrReturnsTheError) {
  EXPECT_EQ(*Quarter(12), 3);
  EXPECT_EQ(Quarter(3).status(), absl::InvalidArgumentError("odd"));
  EXPECT_EQ(Quarter(6).status(), absl::InvalidArgumentError("odd"));
}

TEST(StatusMacrosTest, ReturnsOnErrorAndEvaluatesOnce) {
  int calls = 0;
  EXPECT_TRUE(Twice(calls, absl::OkStatus()).ok());
  EXPECT_EQ(calls, 2);
  calls = 0;
  EXPECT_EQ(Twice(calls, absl::NotFoundError("x")), absl::NotFoundError("x"));
  EXPECT_EQ(calls, 1);
}

}  // namespace
}  // namespace sightline
