// SPDX-License-Identifier: Apache-2.0
//
// Streamed queries against a scripted server: whatever happens to the streams, every item is
// answered once, nothing is sent without credit, and what cannot be answered is an error.
#include <cmath>
#include <limits>
#include <memory>
#include <thread>
#include <vector>

#include "client/lib/client.h"
#include "client/lib/status.h"
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
    v1::Capabilities capabilities;
    capabilities.mutable_limits()->set_max_item_rays(1 << 20);
    capabilities.mutable_limits()->set_max_message_bytes(4 << 20);
    capabilities.mutable_limits()->set_min_item_cost_rays(100);
    server_.min_cost = 100;
    ON_CALL(*mock_, GetCapabilities(_)).WillByDefault(Return(capabilities));
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

TEST_F(StreamTest, AnErrorOfTheCallbackEndsTheQuery) {
  SegmentQuery query;
  query.scene = "scenes/x";
  query.segments = segments_;
  query.segments_per_item = 21;
  int calls = 0;
  const absl::Status status = client_
                                  .TestSegments(
                                      query,
                                      [&](const Segments&) -> absl::Status {
                                        if (++calls == 3) return absl::DataLossError("disk full");
                                        return absl::OkStatus();
                                      },
                                      options_)
                                  .status();
  EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
  EXPECT_EQ(calls, 3);
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
