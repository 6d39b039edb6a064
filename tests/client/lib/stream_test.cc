// SPDX-License-Identifier: Apache-2.0
//
// Streamed queries against a scripted server: whatever happens to the streams, every item is
// answered once, nothing is sent without credit, and what cannot be answered is an error.
#include <atomic>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/synchronization/notification.h"
#include "client/lib/client.h"
#include "client/lib/query_run.h"
#include "client/lib/status.h"
#include "client/lib/stored_segments.h"
#include "client/lib/stream_runner.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "tests/client/lib/fake_segments.h"
#include "tests/client/lib/mock_connection.h"

namespace sightline::client {
namespace {

using ::testing::_;
using ::testing::NiceMock;
using ::testing::Return;

class StreamTest : public testing::Test {
 protected:
  StreamTest() {
    capabilities_.mutable_limits()->set_max_item_rays(1 << 20);
    capabilities_.mutable_limits()->set_max_message_bytes(4 << 20);
    capabilities_.mutable_limits()->set_min_item_cost_rays(100);
    server_.min_cost = 100;
    ON_CALL(*mock_, GetCapabilities(_)).WillByDefault(Return(capabilities_));
    v1::Scene scene;
    scene.set_revision(7);
    ON_CALL(*mock_, GetScene(_, _)).WillByDefault(Return(scene));
    ON_CALL(*mock_, channel_count()).WillByDefault(Return(3));
    ON_CALL(*mock_, OpenSegments(_, _)).WillByDefault([this](int, const CallOptions&) {
      return std::make_unique<FakeSegmentStream>(&server_);
    });
    for (int i = 0; i < 1003; ++i) {
      const double x = i % 17 == 5 ? std::numeric_limits<double>::quiet_NaN() : (i * 37) % 11 - 5.0;
      segments_.insert(segments_.end(), {x, 0, 0, 1, 1, 1});
    }
    options_.retry = {.give_up_after = absl::Seconds(60),
                      .initial_delay = absl::Milliseconds(1),
                      .max_delay = absl::Milliseconds(4)};
  }

  absl::StatusOr<Segments> Test() {
    SegmentQuery query;
    query.scene = "scenes/x";
    query.segments = segments_;
    query.segments_per_item = 21;
    query.options.statistics = true;
    return client_.TestAllSegments(query, options_);
  }

  absl::Status TestWithCallback(const std::function<absl::Status(Segments)>& on_segments) {
    SegmentQuery query;
    query.scene = "scenes/x";
    query.segments = segments_;
    query.segments_per_item = 21;
    return client_.TestSegments(query, on_segments, options_).status();
  }

  void ExpectRight(const absl::StatusOr<Segments>& result) {
    ASSERT_TRUE(result.ok()) << result.status();
    ASSERT_EQ(result->blocked.size(), segments_.size() / 6);
    for (size_t i = 0; i < result->blocked.size(); ++i) {
      const double x = segments_[6 * i];
      EXPECT_EQ(result->blocked[i], std::isnan(x) ? 255 : x > 0 ? 1 : 0) << i;
      EXPECT_EQ(result->valid[i], std::isnan(x) ? 0 : 1) << i;
    }
    EXPECT_EQ(result->summary.revision, 7);
    EXPECT_EQ(result->summary.items, 48u);
    EXPECT_EQ(result->summary.statistics.rays, 1003u);
    EXPECT_GT(result->summary.bytes_received, 0u);
    MutexLock lock(&server_.mutex);
    EXPECT_EQ(server_.violations, 0);
  }

  FakeServer server_;
  v1::Capabilities capabilities_;
  std::shared_ptr<NiceMock<MockConnection>> mock_ = std::make_shared<NiceMock<MockConnection>>();
  Client client_{mock_};
  std::vector<double> segments_;
  StreamOptions options_;
};

TEST_F(StreamTest, AnswersComeTogetherWhateverTheirOrder) {
  ExpectRight(Test());
  MutexLock lock(&server_.mutex);
  EXPECT_EQ(server_.items, 48);
}

TEST_F(StreamTest, KeepsWithinTheCreditOfOneItem) {
  server_.credit = 1;  // One item at a time: its cost leaves less than zero.
  options_.streams = 1;
  ExpectRight(Test());
}

TEST_F(StreamTest, ResumesElsewhereWhenAServerDrains) {
  server_.scripts = {{.drain_after = 3}, {.drain_after = 5}, {.drain_after = 1}, {}};
  ExpectRight(Test());
}

TEST_F(StreamTest, ResumesWhatALostConnectionLeft) {
  server_.scripts = {{.break_after = 2}, {.refuse = true}, {.break_after = 4}, {}};
  const absl::StatusOr<Segments> result = Test();
  ExpectRight(result);
  EXPECT_GT(result->summary.resent_items, 0u);
}

TEST_F(StreamTest, SendsAgainWhatFoundTheQueueFull) {
  server_.scripts = {{.full_every = 3}};
  const absl::StatusOr<Segments> result = Test();
  ExpectRight(result);
  EXPECT_GT(result->summary.resent_items, 0u);
}

// However many items a full queue refuses at once, they are one failure: forty-eight would be more
// than anybody waits for.
TEST_F(StreamTest, AFullQueueIsOneFailureHoweverManyItemsItRefuses) {
  server_.scripts = {{.full_first = 48}};
  options_.streams = 1;
  options_.timeout = absl::Minutes(5);
  options_.retry.give_up_after = options_.retry.max_delay = absl::InfiniteDuration();
  options_.retry.multiplier = 10;
  const absl::StatusOr<Segments> result = Test();
  ASSERT_TRUE(result.ok()) << result.status();
  ExpectRight(result);
  EXPECT_GE(result->summary.resent_items, 48u);
}

TEST_F(StreamTest, AnItemThatCannotBeAnsweredFailsTheQuery) {
  server_.scripts = {{.fail_item = 30}};
  const absl::Status status = Test().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(GetErrorDetail(status)->reason, "INVALID_FIELD");
}

TEST_F(StreamTest, GivesUpOnAServerThatIsNotThere) {
  server_.scripts = {{.refuse = true}};
  options_.retry.give_up_after = absl::Milliseconds(20);
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kUnavailable);
}

// The time is used up: a wait that goes beyond it ends with it, and one more attempt is made.
TEST_F(StreamTest, NoWaitIsLongerThanTheTimeThatIsLeft) {
  server_.scripts = {{.refuse = true}, {}};
  options_.streams = 1;
  options_.retry = {.give_up_after = absl::Milliseconds(20),
                    .initial_delay = absl::Hours(10),
                    .max_delay = absl::Hours(10)};
  ExpectRight(Test());
  {
    MutexLock lock(&server_.mutex);
    server_.streams = 0;
  }
  options_.retry.give_up_after = absl::ZeroDuration();
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kUnavailable);
  MutexLock lock(&server_.mutex);
  EXPECT_EQ(server_.streams, 1);
}

TEST_F(StreamTest, CancelEndsAQueryThatHangs) {
  server_.scripts = {{.hang = true}};
  Cancellation cancellation;
  options_.cancellation = &cancellation;
  std::thread cancel([&] {
    {
      MutexLock lock(&server_.mutex);
      const auto begun = [this] { return server_.items > 0; };
      server_.mutex.Await(absl::Condition(&begun));
    }
    cancellation.Cancel();
  });
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kCancelled);
  cancel.join();
  // And one that was cancelled before it began asks nothing.
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kCancelled);
}

// Where the origin is known, half the bytes are sent; where the server does not say that it reads
// them, or nobody knows the origin, doubles are.
TEST_F(StreamTest, SegmentsTravelAsTheSceneStoresThemWhereTheyCan) {
  const auto stored_items = [this] {
    MutexLock lock(&server_.mutex);
    return std::exchange(server_.stored_items, 0);
  };
  ExpectRight(Test());
  EXPECT_EQ(stored_items(), 0);
  capabilities_.add_encodings(v1::ENCODING_STORED_FLOAT32);
  ON_CALL(*mock_, GetCapabilities(_)).WillByDefault(Return(capabilities_));
  client_ = Client(mock_);
  ExpectRight(Test());
  EXPECT_EQ(stored_items(), 48);
  SegmentQuery query{.scene = "scenes/x", .segments = segments_, .segments_per_item = 21};
  query.options.revision = 7;
  query.options.statistics = true;
  ExpectRight(client_.TestAllSegments(query, options_));
  EXPECT_EQ(stored_items(), 0);
  query.origin = Point3{};
  ExpectRight(client_.TestAllSegments(query, options_));
  EXPECT_EQ(stored_items(), 48);
  const std::vector<float> stored(segments_.begin(), segments_.end());
  query.segments = {};
  query.stored_segments = stored;
  ExpectRight(client_.TestAllSegments(query, options_));
  EXPECT_EQ(stored_items(), 48);
}

// The default fits into a message of 4 MiB, as floats and as doubles.
TEST_F(StreamTest, ItemsAreAsLargeAsAskedForWhereAMessageHoldsThem) {
  SegmentQuery query{.scene = "scenes/x"};
  const std::vector<double> segments(6 * (2 * size_t{query.segments_per_item} + 1));
  query.segments = segments;
  const auto items = [&](uint64_t max_message_bytes) {
    capabilities_.mutable_limits()->set_max_message_bytes(max_message_bytes);
    ON_CALL(*mock_, GetCapabilities(_)).WillByDefault(Return(capabilities_));
    client_ = Client(mock_);
    const absl::StatusOr<Segments> result = client_.TestAllSegments(query, options_);
    EXPECT_TRUE(result.ok()) << result.status();
    return result.ok() ? result->summary.items : 0;
  };
  EXPECT_EQ(items(4 << 20), 3u);
  EXPECT_EQ(items((2 << 20) + 4096), 4u);  // 43,690 doubles each.
  capabilities_.add_encodings(v1::ENCODING_STORED_FLOAT32);
  EXPECT_EQ(items(4 << 20), 3u);
  EXPECT_EQ(items((2 << 20) + 4096), 3u);
  EXPECT_EQ(items((1 << 20) + 4096), 4u);
}

TEST(CutIntoItemsTest, BytesAndRaysBound) {
  Limits limits{.max_message_bytes = 4 << 20, .max_item_rays = 1 << 20};
  EXPECT_EQ(CutIntoItems(1 << 20, 65536, 1, 56, limits).per_item, 65536u);
  EXPECT_EQ(CutIntoItems(1 << 20, 1 << 20, 1, 0, limits).per_item, uint64_t{1} << 20);
  EXPECT_EQ(CutIntoItems(1 << 20, 65536, 64, 24, limits).per_item, 16384u);
  limits.max_message_bytes = 1 << 16;
  EXPECT_EQ(CutIntoItems(1 << 20, 65536, 1, 24, limits).per_item, 2560u);
}

TEST_F(StreamTest, StoredSegmentsNeedAnOriginAndNoOthers) {
  const std::vector<float> stored(12);
  SegmentQuery query{.scene = "scenes/x", .stored_segments = stored};
  EXPECT_EQ(client_.TestAllSegments(query).status().code(), absl::StatusCode::kInvalidArgument);
  query.origin = Point3{};
  EXPECT_EQ(client_.TestAllSegments(query).status().code(), absl::StatusCode::kUnimplemented);
  query.segments = segments_;
  EXPECT_EQ(client_.TestAllSegments(query).status().code(), absl::StatusCode::kInvalidArgument);
  query.segments = {};
  query.stored_segments = std::span(stored).first(7);
  EXPECT_EQ(client_.TestAllSegments(query).status().code(), absl::StatusCode::kInvalidArgument);
}

// What is stored is the difference in double, rounded once; what is out of range is no number.
TEST(StoredSegmentsTest, AreTheDifferencesToTheOrigin) {
  const Point3 origin = {447'422.999, -1e6, 0.1};
  constexpr double kMost = 1099511627776.0;
  const std::vector<double> segments = {447'423.5, -1e6 + 1e-7, 0.1, 447'422.999, 2, 3,  //
                                        kMost,     0,           0,   0,           0, 0,  //
                                        0,         -kMost,      0,   0,           0, 0,  //
                                        0,         0,           0,   0,           0, 2 * kMost};
  const std::string bytes = StoreSegments(segments, origin);
  ASSERT_EQ(bytes.size(), segments.size() * sizeof(float));
  std::vector<float> stored(segments.size());
  std::memcpy(stored.data(), bytes.data(), bytes.size());
  for (size_t i = 0; i < 12; ++i) {
    EXPECT_EQ(stored[i], static_cast<float>(segments[i] - origin[i % 3])) << i;
  }
  // -2^40 is in the world's range; that far from an origin below zero it is too, from above not.
  for (size_t i = 12; i < 18; ++i) {
    EXPECT_EQ(stored[i], static_cast<float>(segments[i] - origin[i % 3])) << i;
  }
  for (size_t i = 18; i < 24; ++i) EXPECT_TRUE(std::isnan(stored[i])) << i;
  const std::string beyond = StoreSegments(std::span(segments).subspan(12, 6), {0, 1, 0});
  std::memcpy(stored.data(), beyond.data(), beyond.size());
  EXPECT_TRUE(std::isnan(stored[0]));
}

TEST_F(StreamTest, AnErrorOfTheCallbackEndsTheQuery) {
  int calls = 0;
  const absl::Status status = TestWithCallback([&](const Segments&) -> absl::Status {
    if (++calls == 3) return absl::DataLossError("disk full");
    return absl::OkStatus();
  });
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(calls, 3);
}

// Memory that runs out while the answers are put together ends the query, in whichever lane that
// was, and not the process.
TEST_F(StreamTest, RunningOutOfMemoryInTheCallbackEndsTheQuery) {
  int calls = 0;
  const absl::Status status = TestWithCallback([&](const Segments&) -> absl::Status {
    if (++calls == 3) throw std::bad_alloc();
    return absl::OkStatus();
  });
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("out of memory"));
  EXPECT_FALSE(IsRetryable(status));
  EXPECT_EQ(calls, 3);
}

// The same of what is made in the threads that write.
TEST(StreamRunnerTest, RunningOutOfMemoryForAnItemEndsTheRun) {
  FakeServer server;
  StreamJob<v1::TestSegmentsRequest, v1::TestSegmentsResponse> job;
  job.item_count = 10;
  job.header.mutable_header();
  job.open = [&](int, const CallOptions&) { return std::make_unique<FakeSegmentStream>(&server); };
  job.make_item = [](size_t item) -> v1::TestSegmentsRequest {
    if (item == 5) throw std::bad_alloc();
    v1::TestSegmentsRequest request;
    request.mutable_item()->mutable_item()->set_item_id(item);
    request.mutable_item()->set_segments(std::string(6 * sizeof(double), '\0'));
    return request;
  };
  job.cost = [](size_t) { return 1; };
  job.deliver = [](size_t, const auto&) { return absl::OkStatus(); };
  RunTotals totals;
  EXPECT_EQ(RunStreams(job, {.lanes = 2, .min_item_cost = 1}, &totals).code(),
            absl::StatusCode::kResourceExhausted);
}

// A lane whose connection does not come about holds up neither a query that is over nor one that is
// cancelled.
TEST_F(StreamTest, WhatIsNotYetOpenIsGivenUpWithTheQuery) {
  // Returns when the call is cancelled; the minute is for this test's own failure.
  const auto never_opens = [this](int, const CallOptions& call) {
    absl::Notification given_up;
    const Cancellation::Registration on_cancel(call.cancellation, [&] { given_up.Notify(); });
    EXPECT_TRUE(given_up.WaitForNotificationWithTimeout(absl::Minutes(1)));
    return std::make_unique<FakeSegmentStream>(&server_);
  };
  EXPECT_CALL(*mock_, OpenSegments(_, _)).WillRepeatedly(never_opens);
  EXPECT_CALL(*mock_, OpenSegments(0, _)).WillOnce([this](int, const CallOptions&) {
    return std::make_unique<FakeSegmentStream>(&server_);
  });
  ExpectRight(Test());
  testing::Mock::VerifyAndClearExpectations(mock_.get());

  Cancellation cancellation;
  options_.cancellation = &cancellation;
  std::atomic<int> opening = 0;
  EXPECT_CALL(*mock_, OpenSegments(_, _)).WillRepeatedly([&](int lane, const CallOptions& call) {
    if (++opening == 3) cancellation.Cancel();
    return never_opens(lane, call);
  });
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kCancelled);
}

// A stream that names no revision would see whichever comes.
TEST_F(StreamTest, ASceneWithoutARevisionIsNotAskedAbout) {
  v1::Scene scene;
  scene.set_state(v1::SCENE_STATE_BUILDING);
  ON_CALL(*mock_, GetScene(_, _)).WillByDefault(Return(scene));
  EXPECT_CALL(*mock_, OpenSegments(_, _)).Times(0);
  absl::Status status = Test().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(GetErrorDetail(status)->reason, "SCENE_NOT_READY");
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("scenes/x is still being built"));
  scene.set_state(v1::SCENE_STATE_FAILED);
  scene.set_state_message("out of room");
  ON_CALL(*mock_, GetScene(_, _)).WillByDefault(Return(scene));
  EXPECT_THAT(std::string(Test().status().message()),
              testing::HasSubstr("scenes/x could not be built: out of room"));
}

// An edit may come between the question which revision is current and the first stream.
TEST_F(StreamTest, TheCurrentRevisionIsAskedForOnceMoreWhereItWasReplaced) {
  server_.gone_revision = 7;
  int64_t revision = 7;
  int asked = 0;
  ON_CALL(*mock_, GetScene(_, _))
      .WillByDefault([&](const v1::GetSceneRequest&, const CallOptions&) {
        v1::Scene scene;
        scene.set_revision(revision);
        if (++asked == 1) revision = 8;
        return scene;
      });
  const absl::StatusOr<Segments> result = Test();
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->summary.revision, 8);
  EXPECT_EQ(asked, 2);
  // Once, and not where the caller has named it.
  revision = 7;
  absl::Status status = Test().status();
  EXPECT_EQ(GetErrorDetail(status)->reason, "REVISION_MISMATCH");
  EXPECT_EQ(asked, 4);
  SegmentQuery query{.scene = "scenes/x", .segments = segments_};
  query.options.revision = 7;
  status = client_.TestAllSegments(query, options_).status();
  EXPECT_EQ(GetErrorDetail(status)->reason, "REVISION_MISMATCH");
  EXPECT_EQ(asked, 4);
}

// A server that came in the place of another may allow less.
TEST_F(StreamTest, LimitsAreAskedAnewOnceTheServerMayBeAnother) {
  options_.streams = 1;  // Of several, the one that breaks may come to no item.
  int asked = 0;
  EXPECT_CALL(*mock_, GetCapabilities(_)).WillRepeatedly([&](const CallOptions&) {
    ++asked;
    return capabilities_;
  });
  const auto restart = [this](std::vector<FakeServer::Script> scripts) {
    MutexLock lock(&server_.mutex);
    server_.scripts = std::move(scripts);
    server_.streams = 0;
  };
  ExpectRight(Test());
  ExpectRight(Test());
  EXPECT_EQ(asked, 1);
  restart({{.break_after = 2}, {}});
  ExpectRight(Test());
  EXPECT_EQ(asked, 1);
  ExpectRight(Test());
  EXPECT_EQ(asked, 2);
  restart({{.fail_item = 0}});
  capabilities_.mutable_limits()->set_max_item_rays(10);
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kInvalidArgument);
  restart({{}});
  const absl::StatusOr<Segments> result = Test();
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->summary.items, 101u);
  EXPECT_EQ(asked, 3);
}

TEST_F(StreamTest, NothingAskedNothingSent) {
  segments_.clear();
  const absl::StatusOr<Segments> result = Test();
  ASSERT_TRUE(result.ok());
  EXPECT_TRUE(result->blocked.empty());
  segments_ = {1, 2, 3, 4, 5};
  EXPECT_EQ(Test().status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(StreamTest, RepliesToNobodyOrOfTheWrongSizeAreErrors) {
  // A stream that answers an item with too few bytes.
  class Short final : public Connection::SegmentStream {
   public:
    bool Write(const v1::TestSegmentsRequest& request) override {
      MutexLock lock(&mutex_);
      last_ = request;
      ++written_;
      return !ended_;
    }
    bool WritesDone() override { return true; }
    bool Read(v1::TestSegmentsResponse* response) override {
      MutexLock lock(&mutex_);
      response->Clear();
      if (ended_) return false;
      if (!opened_) {
        opened_ = true;
        response->mutable_opened()->set_credit_rays(1);
        return true;
      }
      const auto item = [this] { return written_ >= 2 || ended_; };
      mutex_.Await(absl::Condition(&item));
      if (ended_ || answered_) {
        const auto end = [this] { return ended_; };
        mutex_.Await(absl::Condition(&end));
        return false;
      }
      answered_ = true;
      v1::ReplyHeader* header = response->mutable_reply()->mutable_header();
      header->set_item_id(last_.item().item().item_id());
      header->set_element_count(21);
      header->set_last(true);
      response->mutable_reply()->mutable_segments()->set_blocked_bits("x");
      return true;
    }
    void Cancel() override {
      MutexLock lock(&mutex_);
      ended_ = true;
    }
    absl::Status Finish() override { return absl::CancelledError(""); }

   private:
    Mutex mutex_;
    v1::TestSegmentsRequest last_;
    int written_ = 0;
    bool opened_ = false, answered_ = false, ended_ = false;
  };
  ON_CALL(*mock_, OpenSegments(_, _)).WillByDefault([](int, const CallOptions&) {
    return std::make_unique<Short>();
  });
  const absl::Status status = Test().status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInternal);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("blocked_bits"));
}

}  // namespace
}  // namespace sightline::client
