// SPDX-License-Identifier: Apache-2.0
#include "client/load/item_stream.h"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "client/lib/query_wire.h"
#include "client/load/recorder.h"
#include "tests/client/lib/fake_segments.h"
#include "tests/client/load/manual_clock.h"

namespace sightline::load {
namespace {

using client::FakeSegmentStream;
using client::FakeServer;
using SegmentStream = ItemStream<v1::TestSegmentsRequest, v1::TestSegmentsResponse>;

// Items of 20 segments, blocked where the number of the item is odd.
class ItemStreamTest : public testing::Test {
 protected:
  std::unique_ptr<SegmentStream> Open(absl::Duration give_up = absl::Minutes(1)) {
    query_.segments = std::span<const double>(kNoSegments, 120);
    SegmentStream::Wiring wiring;
    wiring.open = open_;
    *wiring.header.mutable_header() = client::SegmentsHeader(query_, 0);
    wiring.make_item = [](const Work& work) {
      std::vector<double> segments(120, work.item % 2 == 1 ? 1.0 : -1.0);
      v1::TestSegmentsRequest message;
      message.mutable_item()->set_segments(
          std::string(reinterpret_cast<const char*>(segments.data()), 120 * sizeof(double)));
      return message;
    };
    wiring.decode = [this](const Work&,
                           std::vector<v1::SegmentReply> replies) -> absl::StatusOr<Answer> {
      absl::StatusOr<client::Segments> segments =
          client::DecodeSegments(query_, 0, 20, std::move(replies));
      if (!segments.ok()) return segments.status();
      return ToAnswer(*std::move(segments));
    };
    LaneContext context;
    context.clock = &clock_;
    context.rays = [](const Work&) { return 20; };
    context.is_checked = [this](const Work&) { return checked_; };
    context.judge = [](const Answer& answer, Outcome* outcome) {
      const std::vector<uint8_t> due(20, outcome->request.work.item % 2 == 1 ? 1 : 0);
      outcome->verdict = answer.flags == due ? Verdict::kEqual : Verdict::kWrong;
      outcome->difference = "not as is due";
    };
    context.describe = [](const Work& work) { return absl::StrCat("item ", work.item); };
    context.on_done = [this](const Outcome& outcome) {
      MutexLock lock(mutex_);
      outcomes_.push_back(outcome);
      changed_.SignalAll();
    };
    context.on_gone = [] {};
    context.retry = {.give_up_after = give_up,
                     .initial_delay = absl::Microseconds(100),
                     .max_delay = absl::Milliseconds(1)};
    return std::make_unique<SegmentStream>(std::move(wiring), std::move(context));
  }
  static Request Item(uint64_t number) {
    return {.number = number, .work = {.kind = Kind::kSegments, .item = number}};
  }
  std::vector<Outcome> WaitFor(size_t count) {
    MutexLock lock(mutex_);
    while (outcomes_.size() < count) changed_.Wait(mutex_);
    return outcomes_;
  }
  static int CountOf(const std::vector<Outcome>& outcomes, absl::StatusCode code) {
    int count = 0;
    for (const Outcome& outcome : outcomes) count += outcome.status.code() == code ? 1 : 0;
    return count;
  }

  static constexpr double kNoSegments[120] = {};
  client::SegmentQuery query_{.scene = "scenes/x"};
  bool checked_ = true;  // What is answered.
  FakeServer server_;
  std::function<std::unique_ptr<FakeSegmentStream>(const client::CallOptions&)> open_ =
      [this](const client::CallOptions&) { return std::make_unique<FakeSegmentStream>(&server_); };
  ManualClock clock_;
  Mutex mutex_;
  CondVar changed_;
  std::vector<Outcome> outcomes_ ABSL_GUARDED_BY(mutex_);
};

TEST_F(ItemStreamTest, EveryItemIsAnsweredOnceAndWithinTheCredit) {
  server_.credit = 100;  // Five items at once.
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  constexpr uint64_t kItems = 500;
  for (uint64_t i = 0; i < kItems; ++i) stream->Send(Item(i));
  const std::vector<Outcome> outcomes = WaitFor(kItems);
  std::vector<int> seen(kItems);
  for (const Outcome& outcome : outcomes) {
    ASSERT_TRUE(outcome.status.ok()) << outcome.status;
    EXPECT_EQ(outcome.verdict, Verdict::kEqual);
    EXPECT_EQ(outcome.rays, 20u);
    EXPECT_GT(outcome.bytes_sent, 20u * 48);
    EXPECT_GT(outcome.bytes_received, 0u);
    ++seen[outcome.request.number];
  }
  EXPECT_EQ(seen, std::vector<int>(kItems, 1));
  client::MutexLock lock(&server_.mutex);
  EXPECT_EQ(server_.violations, 0);
  EXPECT_EQ(server_.streams, 1);
}

TEST_F(ItemStreamTest, SeveralSendersShareAStream) {
  server_.credit = 60;
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  std::vector<std::thread> senders;
  for (uint64_t t = 0; t < 4; ++t) {
    senders.emplace_back([&, t] {
      for (uint64_t i = 0; i < 100; ++i) stream->Send(Item(t * 100 + i));
    });
  }
  for (std::thread& sender : senders) sender.join();
  EXPECT_EQ(CountOf(WaitFor(400), absl::StatusCode::kOk), 400);
  client::MutexLock lock(&server_.mutex);
  EXPECT_EQ(server_.violations, 0);
}

TEST_F(ItemStreamTest, AFailedItemFailsAloneWithItsReason) {
  server_.scripts = {{.full_every = 10}};
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  for (uint64_t i = 0; i < 100; ++i) stream->Send(Item(i));
  const std::vector<Outcome> outcomes = WaitFor(100);
  EXPECT_EQ(CountOf(outcomes, absl::StatusCode::kOk), 90);
  for (const Outcome& outcome : outcomes) {
    if (!outcome.status.ok()) {
      EXPECT_EQ(ErrorName(outcome.status), "RESOURCE_EXHAUSTED QUEUE_FULL");
    }
  }
}

// An answer that was looked at and is none is wrong, however small a share of them it is.
TEST_F(ItemStreamTest, AnAnswerThatCannotBeDecodedIsWrong) {
  server_.scripts = {{.short_every = 10}};
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  for (uint64_t i = 0; i < 100; ++i) stream->Send(Item(i));
  int wrong = 0;
  for (const Outcome& outcome : WaitFor(100)) {
    EXPECT_TRUE(outcome.status.ok()) << outcome.status;
    if (outcome.verdict == Verdict::kEqual) continue;
    ASSERT_EQ(outcome.verdict, Verdict::kWrong);
    ++wrong;
    const uint64_t number = outcome.request.number;
    EXPECT_EQ(outcome.difference, absl::StrCat("request ", number, ", item ", number,
                                               ": the server answered 16 of 20 elements of an "
                                               "item"));
  }
  EXPECT_EQ(wrong, 10);
}

TEST_F(ItemStreamTest, WhatIsNotCheckedIsNotLookedAt) {
  server_.scripts = {{.short_every = 1}};
  checked_ = false;
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  stream->Send(Item(0));
  const std::vector<Outcome> outcomes = WaitFor(1);
  EXPECT_TRUE(outcomes[0].status.ok()) << outcomes[0].status;
  EXPECT_EQ(outcomes[0].verdict, Verdict::kNotChecked);
}

TEST_F(ItemStreamTest, AConnectionThatIsLostFailsWhatWasUnderWayAndIsMadeAgain) {
  server_.scripts = {{.break_after = 3}, {}};
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  for (uint64_t i = 0; i < 50; ++i) stream->Send(Item(i));
  const std::vector<Outcome> outcomes = WaitFor(50);
  const int lost = CountOf(outcomes, absl::StatusCode::kUnavailable);
  EXPECT_GE(lost, 1);  // The item that broke it; others may have been answered before.
  EXPECT_EQ(lost + CountOf(outcomes, absl::StatusCode::kOk), 50);
  EXPECT_TRUE(stream->status().ok());
  client::MutexLock lock(&server_.mutex);
  EXPECT_EQ(server_.streams, 2);
}

TEST_F(ItemStreamTest, ADrainingServerKeepsWhatItAcceptedAndTheRestGoesToTheNext) {
  server_.scripts = {{.drain_after = 4}, {}};
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  for (uint64_t i = 0; i < 4; ++i) stream->Send(Item(i));
  EXPECT_EQ(CountOf(WaitFor(4), absl::StatusCode::kOk), 4);
  // A real server ends the stream; the scripted one waits for a client that half-closes.
  stream->CancelAll();
}

TEST_F(ItemStreamTest, AServerThatCannotBeReachedIsGivenUp) {
  server_.scripts = {{.refuse = true}};
  const auto stream = Open(absl::ZeroDuration());
  EXPECT_EQ(stream->WaitUntilOpen().code(), absl::StatusCode::kUnavailable);
  stream->Send(Item(0));
  const std::vector<Outcome> outcomes = WaitFor(1);
  EXPECT_EQ(outcomes[0].status.code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(outcomes[0].sent, absl::InfiniteFuture());
  EXPECT_EQ(stream->status().code(), absl::StatusCode::kUnavailable);
}

TEST_F(ItemStreamTest, CancellingEndsWhatHangsAndWhatWaits) {
  server_.credit = 100;
  server_.scripts = {{.hang = true}, {}};
  const auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  for (uint64_t i = 0; i < 20; ++i) stream->Send(Item(i));
  stream->CancelAll();
  EXPECT_EQ(CountOf(WaitFor(20), absl::StatusCode::kCancelled), 20);
  // The next run finds the lane open again.
  for (uint64_t i = 0; i < 20; ++i) stream->Send(Item(i));
  EXPECT_EQ(CountOf(WaitFor(40), absl::StatusCode::kOk), 20);
  EXPECT_TRUE(stream->status().ok());
}

// A connection that does not come about holds up neither who waits for it nor the lane's end.
TEST_F(ItemStreamTest, AnOpeningThatHangsIsGivenUp) {
  absl::Notification opening;
  open_ = [&](const client::CallOptions& call) {
    absl::Notification given_up;
    const client::Cancellation::Registration on_cancel(call.cancellation,
                                                       [&] { given_up.Notify(); });
    if (!opening.HasBeenNotified()) opening.Notify();
    // The minute is for this test's own failure.
    EXPECT_TRUE(given_up.WaitForNotificationWithTimeout(absl::Minutes(1)));
    return std::make_unique<FakeSegmentStream>(&server_);
  };
  {
    const auto stream = Open();
    std::thread give_up([&] {
      opening.WaitForNotification();
      stream->Close();
    });
    EXPECT_EQ(stream->WaitUntilOpen().code(), absl::StatusCode::kCancelled);
    give_up.join();
  }
  const auto stream = Open();  // And goes while it opens.
}

TEST_F(ItemStreamTest, ALaneMayGoWhileItemsAreUnanswered) {
  server_.scripts = {{.hang = true}};
  auto stream = Open();
  ASSERT_TRUE(stream->WaitUntilOpen().ok());
  for (uint64_t i = 0; i < 5; ++i) stream->Send(Item(i));
  stream.reset();
}

}  // namespace
}  // namespace sightline::load
