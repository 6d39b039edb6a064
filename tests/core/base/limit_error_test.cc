// SPDX-License-Identifier: Apache-2.0
#include "core/base/limit_error.h"

#include "gtest/gtest.h"

namespace sightline {
namespace {

TEST(LimitErrorTest, NamesTheLimitForPeopleAndForCallers) {
  const absl::Status error = LimitError("max_scenes", 10, "the server holds 10", "delete one");
  EXPECT_EQ(error.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(error.message(), "the server holds 10; max_scenes is 10: delete one");
  const std::optional<ExceededLimit> limit = ExceededLimitOf(error);
  ASSERT_TRUE(limit.has_value());
  EXPECT_EQ(limit->name, "max_scenes");
  EXPECT_EQ(limit->value, 10u);
}

TEST(LimitErrorTest, OtherErrorsHaveNone) {
  EXPECT_FALSE(ExceededLimitOf(absl::ResourceExhaustedError("out of memory")).has_value());
  EXPECT_FALSE(ExceededLimitOf(absl::OkStatus()).has_value());
}

}  // namespace
}  // namespace sightline
