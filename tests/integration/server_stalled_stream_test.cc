// SPDX-License-Identifier: Apache-2.0
//
// Streams, and watches, whose clients take nothing end after a while, so that what they hold is
// free for others. No test but one waits for time to pass: the server is told of another time.
#include <chrono>
#include <string>
#include <thread>

#include "gmock/gmock.h"
#include "tests/integration/raw_connection.h"
#include "tests/integration/stream_rules_fixture.h"
#include "tests/support/until.h"

namespace sightline {
namespace {

// Whether or not its last reply was on its way at that moment: so the details need not be there.
void ExpectStalled(const grpc::Status& status, const std::string& limit) {
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << status.error_message();
  EXPECT_THAT(status.error_message(), testing::HasSubstr(limit));
  EXPECT_THAT(status.error_message(), testing::HasSubstr("--max-stream-stall-seconds"));
}

// Streams whose clients take nothing, and time that passes for the server's sweeps alone.
class StalledStreamTest : public SmallQueueTest {
 protected:
  using Clock = std::chrono::steady_clock;
  static constexpr uint64_t kTile = 64;  // Pixels of a side; more rays than the least cost.

  // Grants one ray of credit: the first reply goes out, and the next waits for a grant.
  v1::TraceTilesRequest CreditHeader() const {
    v1::TraceTilesRequest request = Header(v1::STRATEGY_PACKET);
    request.mutable_header()->mutable_stream()->set_result_credit_rays(1);
    return request;
  }
  static v1::TraceTilesRequest Tile(uint64_t id) { return TileRequest(id, 0, 0, kTile, kTile); }
  static v1::TraceTilesRequest GrantOf(int64_t rays) {
    v1::TraceTilesRequest request;
    request.mutable_grant_result_credit()->set_rays(rays);
    return request;
  }
  void WaitForQueuedRays(uint64_t rays) const {
    ASSERT_TRUE(testing_support::Until("so many rays are left in the queue", [&] {
      return harness_.server->queued_rays() == rays;
    })) << harness_.server->queued_rays();
  }
  // As if max_stream_stall had passed, until there are no calls.
  void EndStalledStreams() const {
    ASSERT_TRUE(testing_support::Until("the stalled streams have ended", [&] {
      harness_.server->EndStalledStreams(Clock::now() + std::chrono::seconds(kStallSeconds));
      return harness_.server->active_calls() == 0;
    }));
  }
};

TEST_F(StalledStreamTest, TheyEndAndOthersAreServed) {
  TileStream withheld(harness_, CreditHeader());
  for (uint64_t id = 0; id < 2; ++id) withheld.Write(Tile(id));
  EXPECT_EQ(ReadLast(withheld).header().status().code(), 0);
  // Half a million rays, and no byte of a reply may be sent.
  const RawConnection unread(harness_.server->port());
  unread.Send(CallBytes("/sightline.v1.VisibilityService/TraceTiles",
                        {Header(v1::STRATEGY_PACKET).SerializeAsString(),
                         TileRequest(0, 0, 0, kSide, kSide / 2).SerializeAsString()},
                        {.initial_window = 0}));
  WaitForQueuedRays(kTile * kTile + uint64_t{kSide} * kSide / 2);
  {
    TileStream other(harness_, Header(v1::STRATEGY_PACKET));
    other.Write(Endless(1));
    EXPECT_EQ(ReadLast(other).header().status().reason(), v1::ERROR_REASON_QUEUE_FULL);
    EXPECT_TRUE(other.ReadAll().empty());
    EXPECT_TRUE(other.Finish().ok());
  }
  EndStalledStreams();
  EXPECT_EQ(harness_.server->queued_rays(), 0u);
  TileStream other(harness_, Header(v1::STRATEGY_PACKET));
  other.Write(Endless(1));
  EXPECT_EQ(ReadLast(other).header().status().code(), 0);
  v1::TraceTilesResponse response;
  EXPECT_FALSE(withheld.Read(&response));
  ExpectStalled(withheld.Finish(), "max_stream_stall = 3600 s");
  // Without a window there is no reply, but still the reason for it.
  EXPECT_THAT(unread.ReadUntil("max_stream_stall = 3600 s"),
              testing::HasSubstr("max_stream_stall = 3600 s"));
}

TEST_F(StalledStreamTest, AnyProgressBeginsTheTimeAnew) {
  Clock::time_point before = Clock::now();
  TileStream stream(harness_, CreditHeader());
  for (uint64_t id = 0; id < 4; ++id) stream.Write(Tile(id));
  for (uint64_t left = 3;; --left) {
    EXPECT_EQ(ReadLast(stream).header().status().code(), 0);
    WaitForQueuedRays(left * kTile * kTile);
    // Whatever it waits for now, it has done so for less than that by then.
    harness_.server->EndStalledStreams(before + std::chrono::seconds(kStallSeconds));
    if (left == 0) break;
    before = Clock::now();
    stream.Write(GrantOf(kTile * kTile));
  }
  EXPECT_TRUE(stream.ReadAll().empty());
  EXPECT_TRUE(stream.Finish().ok());
}

TEST_F(StalledStreamTest, AGrantThatIsNotEnoughIsNoProgress) {
  TileStream stream(harness_, CreditHeader());
  stream.Write(Tile(0));
  EXPECT_EQ(ReadLast(stream).header().status().code(), 0);
  // Refused as it comes: when the server has the item behind it, its reply waits for credit.
  v1::TraceTilesRequest refused = Tile(1);
  refused.mutable_item()->mutable_item()->set_priority(1000);
  stream.Write(refused);
  stream.Write(Tile(2));
  WaitForQueuedRays(kTile * kTile);
  const Clock::time_point before = Clock::now();
  stream.Write(GrantOf(1));
  stream.Write(Tile(3));
  WaitForQueuedRays(2 * kTile * kTile);
  harness_.server->EndStalledStreams(before + std::chrono::seconds(kStallSeconds));
  ASSERT_NO_FATAL_FAILURE(WaitForQueuedRays(0));
  v1::TraceTilesResponse response;
  EXPECT_FALSE(stream.Read(&response));
  ExpectStalled(stream.Finish(), "max_stream_stall = 3600 s");
}

TEST_F(StalledStreamTest, ADrainIsOverWhenTheyAre) {
  TileStream stream(harness_, CreditHeader());
  for (uint64_t id = 0; id < 2; ++id) stream.Write(Tile(id));
  WaitForQueuedRays(kTile * kTile);
  absl::Status drained;
  std::thread drain([&] { drained = harness_.server->Drain(absl::Minutes(2)); });
  EndStalledStreams();
  drain.join();
  EXPECT_TRUE(drained.ok()) << drained;
}

TEST_F(StalledStreamTest, AWatchThatIsNotReadEndsToo) {
  const RawConnection unread(harness_.server->port());
  v1::WatchSceneRequest request;
  request.set_name("scenes/slow");
  unread.Send(CallBytes("/sightline.v1.SceneService/WatchScene", {request.SerializeAsString()},
                        {.whole = true, .initial_window = 0}));
  ASSERT_TRUE(testing_support::Until("the watch has come",
                                     [&] { return harness_.server->active_calls() == 1; }));
  absl::Status drained;
  std::thread drain([&] { drained = harness_.server->Drain(absl::Minutes(2)); });
  EndStalledStreams();
  drain.join();
  EXPECT_TRUE(drained.ok()) << drained;
  EXPECT_THAT(unread.ReadUntil("max_stream_stall = 3600 s"),
              testing::HasSubstr("this watch of a scene has waited for max_stream_stall = 3600 s"));
}

class ImpatientTest : public StreamRulesTest {
 protected:
  static ServerOptions Impatient() {
    ServerOptions options = OneThread();
    options.limits.max_stream_stall_seconds = 1;
    return options;
  }
  ImpatientTest() : StreamRulesTest(Impatient()) {}
};

TEST_F(ImpatientTest, TheServerLooksForStalledStreamsByItself) {
  v1::TraceTilesRequest header = Header(v1::STRATEGY_PACKET);
  header.mutable_header()->mutable_stream()->set_result_credit_rays(1);
  TileStream stream(harness_, header);
  for (uint64_t id = 0; id < 2; ++id) stream.Write(TileRequest(id, 0, 0, 8, 8));
  EXPECT_EQ(ReadLast(stream).header().item_id(), 0u);
  v1::TraceTilesResponse response;
  EXPECT_FALSE(stream.Read(&response));
  ExpectStalled(stream.Finish(), "max_stream_stall = 1 s");
}

}  // namespace
}  // namespace sightline
