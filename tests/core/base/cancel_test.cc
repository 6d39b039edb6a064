// SPDX-License-Identifier: Apache-2.0
#include "core/base/cancel.h"

#include <chrono>
#include <thread>

#include "gtest/gtest.h"

namespace sightline {
namespace {

using std::chrono::hours;

CancelToken::Clock::time_point Now() { return CancelToken::Clock::now(); }

TEST(CancelTokenTest, StartsLive) {
  CancelToken token;
  EXPECT_FALSE(token.cancelled());
  EXPECT_TRUE(token.ToStatus().ok());
}

TEST(CancelTokenTest, CancelIsSeenByAnotherThread) {
  CancelToken token;
  std::thread worker([&] {
    while (!token.cancelled()) std::this_thread::yield();
  });
  token.Cancel();
  worker.join();
  EXPECT_EQ(token.ToStatus().code(), absl::StatusCode::kCancelled);
}

TEST(CancelTokenTest, ADeadlineFires) {
  CancelToken token;
  token.set_deadline(Now() + hours(1));
  EXPECT_FALSE(token.cancelled());
  token.set_deadline(Now());
  EXPECT_TRUE(token.cancelled());
  EXPECT_EQ(token.ToStatus().code(), absl::StatusCode::kDeadlineExceeded);
}

TEST(CancelTokenTest, TheStatusAloneNoticesADeadline) {
  CancelToken token;
  token.set_deadline(Now() - hours(1));
  EXPECT_EQ(token.ToStatus().code(), absl::StatusCode::kDeadlineExceeded);
}

TEST(CancelTokenTest, TheFirstReasonIsKept) {
  CancelToken late;
  late.set_deadline(Now() - hours(1));
  EXPECT_TRUE(late.cancelled());
  late.Cancel();
  late.set_deadline(Now() + hours(1));
  EXPECT_EQ(late.ToStatus().code(), absl::StatusCode::kDeadlineExceeded);

  CancelToken cancelled;
  cancelled.Cancel();
  cancelled.set_deadline(Now() - hours(1));
  EXPECT_EQ(cancelled.ToStatus().code(), absl::StatusCode::kCancelled);
}

TEST(CancelTokenTest, FiresAfterSoManyLooks) {
  CancelToken token;
  token.set_looks_left(2);
  EXPECT_FALSE(token.cancelled());
  CancelToken child(&token);
  EXPECT_FALSE(child.cancelled());
  EXPECT_TRUE(child.cancelled());
  EXPECT_EQ(token.ToStatus().code(), absl::StatusCode::kDeadlineExceeded);

  CancelToken other;
  other.set_looks_left(0);
  other.set_deadline(Now() + hours(1));
  EXPECT_FALSE(other.cancelled());
  other.set_looks_left(0);
  EXPECT_TRUE(other.cancelled());
}

TEST(CancelTokenTest, AParentStopsItsChildrenAndNotTheReverse) {
  CancelToken stream;
  CancelToken first(&stream), second(&stream);
  first.Cancel();
  EXPECT_FALSE(stream.cancelled());
  EXPECT_FALSE(second.cancelled());
  stream.set_deadline(Now() - hours(1));
  EXPECT_TRUE(second.cancelled());
  EXPECT_EQ(first.ToStatus().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(second.ToStatus().code(), absl::StatusCode::kDeadlineExceeded);
}

}  // namespace
}  // namespace sightline
