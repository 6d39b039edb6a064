// SPDX-License-Identifier: Apache-2.0
//
// More work than the server can do. All bars are ratios of one run: goodput is counted per second
// of the server's own CPU clock, arrivals are paced by the answers themselves (three items come for
// each that is closed), and a deadline is so many items at the pace of the turn before. Neighbours
// make a CPU second worth less, since they share caches and cores, and they come and go: so turns
// at capacity and under overload alternate, and each of the latter is held against those around it.
// A neighbour that comes in the middle of a turn makes late what was in time by all that could be
// foreseen: so the client's clock must be kept in most turns, and in all of them together what is
// left of it when a thread of the server that had no core to run on is not held against it.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "tests/integration/server_harness.h"
#include "tests/integration/serving_process.h"

namespace sightline {
namespace {

using testing::ElementsAre;
using testing::Pair;

// Rays against each of 20,000 triangles.
constexpr char kOverloadedSpec[] = "sphere:20000";
constexpr char kSceneFlag[] = "--scene=heavy=builtin:sphere:20000";
constexpr uint32_t kImage = 512;
// What an item takes one thread, or more, so that refusing others beside it is a small part.
constexpr double kLeastItem = 0.005;

// What one stream of items came to.
struct Turn {
  uint64_t sent = 0, refused = 0;
  std::map<std::string, uint64_t> refused_by;  // The limit that each refusal names.
  uint64_t in_time = 0;  // Answered within the deadline, by the client's clock.
  // Of all that was accepted: from its write to its answer, by the client's clock; in deadlines, if
  // there is one, else in seconds.
  std::vector<double> latencies;
  // The same less the longest that one of the server's threads waited for a core meanwhile.
  std::vector<double> own_latencies;
  uint64_t expired = 0;          // Of these, answered with DEADLINE_EXCEEDED.
  double cpu = 0;                // Seconds, of the server.
  double wall = 0;               // From the first item's write to the end of the stream.
  std::vector<double> computes;  // Seconds, of each answered item.

  uint64_t accepted() const { return latencies.size(); }
  double goodput() const { return static_cast<double>(in_time) / cpu; }
  void Add(const Turn& other) {
    sent += other.sent;
    refused += other.refused;
    for (const auto& [limit, count] : other.refused_by) refused_by[limit] += count;
    in_time += other.in_time;
    expired += other.expired;
    latencies.insert(latencies.end(), other.latencies.begin(), other.latencies.end());
    own_latencies.insert(own_latencies.end(), other.own_latencies.begin(),
                         other.own_latencies.end());
    cpu += other.cpu;
    wall += other.wall;
    computes.insert(computes.end(), other.computes.begin(), other.computes.end());
  }
};

// The value that a share of the values is not above; 0 if there is none.
double Quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto rank = static_cast<size_t>(std::ceil(share * static_cast<double>(values.size())));
  const auto at = values.begin() + static_cast<ptrdiff_t>(std::max<size_t>(rank, 1) - 1);
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The longest that one thread waited between the two; threads that are new in `after` from zero.
double LongestWait(const std::map<std::string, double>& before,
                   const std::map<std::string, double>& after) {
  double longest = 0;
  for (const auto& [thread, waited] : after) {
    const auto found = before.find(thread);
    longest = std::max(longest, waited - (found == before.end() ? 0 : found->second));
  }
  return longest;
}

class OverloadTest : public testing::Test {
 protected:
  struct Load {
    uint32_t side = 0;      // Of an item's tile.
    uint64_t first = 0;     // Items to begin with.
    uint64_t arrivals = 0;  // New ones for each that is answered or too late, ...
    uint64_t closed = 0;    // ... until so many are.
    double deadline = 0;    // Seconds; 0: none.
    bool told = true;       // Whether the server hears of it.
  };

  static v1::TraceTilesRequest Header() {
    v1::TraceTilesRequest request;
    request.mutable_header()->mutable_stream()->set_scene("scenes/heavy");
    v1::QueryOptions* const options = request.mutable_header()->mutable_stream()->mutable_options();
    options->set_strategy(v1::STRATEGY_BRUTE_FORCE);
    options->set_statistics(true);
    EncodeTestCamera(ViewCamera(FirstView(kOverloadedSpec), kImage, kImage),
                     request.mutable_header()->mutable_camera());
    return request;
  }

  // One stream of such items, to the last answer of what was sent.
  static Turn Run(const ServingProcess& server, const Load& load) {
    using Clock = std::chrono::steady_clock;
    const auto stub = v1::VisibilityService::NewStub(server.Channel());
    grpc::ClientContext context;
    const auto stream = stub->TraceTiles(&context);
    v1::TraceTilesResponse response;
    EXPECT_TRUE(stream->Write(Header()));
    EXPECT_TRUE(stream->Read(&response)) << stream->Finish().error_message();
    const double cpu = server.CpuSeconds();
    const Clock::time_point begin = Clock::now();
    struct Sent {
      Clock::time_point time;
      std::shared_ptr<const std::map<std::string, double>> waited;  // Of the server by then.
    };
    std::map<uint64_t, Sent> unanswered;
    Turn turn;
    const auto send = [&](uint64_t count) {
      // The middle of the picture, where all tiles are about as heavy.
      constexpr uint32_t kCorner = kImage / 4, kMiddle = kImage / 2;
      const uint32_t across = kMiddle / load.side;
      const auto waited =
          std::make_shared<const std::map<std::string, double>>(server.WaitedForCoreSeconds());
      for (uint64_t i = 0; i < count; ++i) {
        const uint64_t id = turn.sent++;
        const auto tile = static_cast<uint32_t>(id * 7 % (across * across));
        v1::TraceTilesRequest request =
            TileRequest(id, kCorner + tile % across * load.side,
                        kCorner + tile / across * load.side, load.side, load.side);
        if (load.told && load.deadline > 0) {
          auto* const limit = request.mutable_item()->mutable_item()->mutable_timeout();
          limit->set_seconds(static_cast<int64_t>(load.deadline));
          limit->set_nanos(static_cast<int32_t>((load.deadline - std::floor(load.deadline)) * 1e9));
        }
        unanswered[id] = {Clock::now(), waited};
        EXPECT_TRUE(stream->Write(request));
      }
    };
    send(load.first);
    while (stream->Read(&response)) {
      if (!response.has_reply() || !response.reply().header().last()) continue;
      const v1::ReplyHeader& header = response.reply().header();
      const Sent sent = unanswered.at(header.item_id());
      unanswered.erase(header.item_id());
      const double took = std::chrono::duration<double>(Clock::now() - sent.time).count();
      const int code = header.status().code();
      if (code == grpc::StatusCode::RESOURCE_EXHAUSTED) {
        ++turn.refused;
        const auto limit = header.status().metadata().find("limit");
        ++turn.refused_by[limit == header.status().metadata().end() ? "none" : limit->second];
        EXPECT_GT(header.status().retry_delay().seconds() + header.status().retry_delay().nanos(),
                  0);
        continue;
      }
      EXPECT_TRUE(code == grpc::StatusCode::OK || code == grpc::StatusCode::DEADLINE_EXCEEDED)
          << header.status().message();
      const double own = took - LongestWait(*sent.waited, server.WaitedForCoreSeconds());
      const double unit = load.deadline > 0 ? load.deadline : 1;
      turn.latencies.push_back(took / unit);
      turn.own_latencies.push_back(own / unit);
      if (code == grpc::StatusCode::OK) {
        if (load.deadline <= 0 || took <= load.deadline) ++turn.in_time;
        turn.computes.push_back(1e-9 * static_cast<double>(header.statistics().compute_nanos()));
      } else {
        ++turn.expired;
        EXPECT_GE(took, load.deadline);
      }
      if (turn.accepted() < load.closed) send(load.arrivals);
      if (turn.accepted() == load.closed) stream->WritesDone();
    }
    const grpc::Status status = stream->Finish();
    EXPECT_TRUE(status.ok()) << status.error_message();
    EXPECT_TRUE(unanswered.empty());
    turn.cpu = server.CpuSeconds() - cpu;
    turn.wall = std::chrono::duration<double>(Clock::now() - begin).count();
    return turn;
  }

  // The side of a tile that takes well over kLeastItem, wherever it is.
  static uint32_t HeavySide(const ServingProcess& server) {
    constexpr uint32_t kFirst = 32;
    // Trials see all tiles, and a core at its fastest may be half as fast again as in any of them.
    constexpr double kMargin = 1.5;
    constexpr uint64_t kTiles = uint64_t{kImage / 2 / kFirst} * (kImage / 2 / kFirst);
    const Turn tried = Run(server, {.side = kFirst, .first = 4, .arrivals = 1, .closed = kTiles});
    const double grow = std::sqrt(kMargin * kLeastItem / Quantile(tried.computes, 0));
    const auto side = static_cast<uint32_t>(std::ceil(kFirst * std::max(1.0, grow)));
    return std::min(side, kImage / 2);
  }

  // Turns at capacity, and between each two of them one at three times that, whose deadline is
  // `deadline_items` at the pace of the turn before; the latter together. `told`: whether the
  // server hears of deadlines.
  static Turn TakeTurns(const ServingProcess& server, uint32_t side, double deadline_items,
                        bool told) {
    constexpr int kTurns = 7;
    constexpr uint64_t kClosed = 40;
    const Load at_capacity = {.side = side, .first = 4, .arrivals = 1, .closed = kClosed};
    // What still waits when no more come is at most a deadline's worth; for that, too, three times
    // as many have come, and more where the pace of the turn before was that of a slower core.
    Load pressed = {.side = side,
                    .first = static_cast<uint64_t>(4 * deadline_items),
                    .arrivals = 3,
                    .closed = kClosed,
                    .told = told};
    Turn capacity = Run(server, at_capacity), before = capacity, overload;
    std::vector<double> ratios, turns_p99;
    for (int i = 0; i < kTurns; ++i) {
      pressed.deadline = deadline_items * before.wall / static_cast<double>(before.accepted());
      const Turn turn = Run(server, pressed);
      const Turn after = Run(server, at_capacity);
      ratios.push_back(turn.goodput() / ((before.goodput() + after.goodput()) / 2));
      turns_p99.push_back(Quantile(turn.latencies, 0.99));
      capacity.Add(after);
      overload.Add(turn);
      before = after;
    }
    const double compute =
        std::min(Quantile(capacity.computes, 0.5), Quantile(overload.computes, 0.5));
    const double goodput = Quantile(ratios, 0.5), p99 = Quantile(turns_p99, 0.5);
    const double own_p99 = Quantile(overload.own_latencies, 0.99);
    std::printf(
        "%u x %u rays an item, %.1f ms of CPU time, %.1f of computing; goodput "
        "%.3f (%.3f to %.3f) of that at capacity; %llu of %llu accepted, %llu expired, p99 %.2f of "
        "the deadline (%.2f to %.2f; %.2f of all turns, %.2f with a core)\n",
        side, side, 1e3 / capacity.goodput(), 1e3 * compute, goodput, Quantile(ratios, 0),
        Quantile(ratios, 1), static_cast<unsigned long long>(overload.accepted()),
        static_cast<unsigned long long>(overload.sent),
        static_cast<unsigned long long>(overload.expired), p99, Quantile(turns_p99, 0),
        Quantile(turns_p99, 1), Quantile(overload.latencies, 0.99), own_p99);
    RecordProperty("goodput_percent", static_cast<int>(100 * goodput));
    RecordProperty("p99_percent_of_deadline", static_cast<int>(100 * p99));
    RecordProperty("own_p99_percent_of_deadline", static_cast<int>(100 * own_p99));
    EXPECT_GE(overload.sent, 3 * overload.accepted());
    EXPECT_EQ(capacity.refused, 0u);
    EXPECT_EQ(capacity.in_time, capacity.accepted());
    // At the median: a core may for a moment be far faster than it was when the size was chosen,
    // and items that take less only make the bar harder to reach.
    EXPECT_GE(compute, kLeastItem);
    EXPECT_GE(goodput, 0.9);
    EXPECT_LE(p99, 1);
    EXPECT_LE(own_p99, 1);
    return overload;
  }
};

// The queue's bound alone, for the server hears of no deadline: what is taken waits for no more
// than the queue holds.
TEST_F(OverloadTest, GoodputHoldsAtThreeTimesTheCapacityByTheBoundOfTheQueue) {
  constexpr uint64_t kQueue = 16;
  const uint32_t side = HeavySide(ServingProcess({kSceneFlag, "--threads=1"}));
  const uint64_t rays = kQueue * side * side;
  // One client may fill it: this one is alone.
  const ServingProcess server({kSceneFlag, "--threads=1", absl::StrCat("--max-queued-rays=", rays),
                               absl::StrCat("--max-queued-rays-per-client=", 2 * rays)});
  // The queue holds 16 items, and the deadline is that of 80, for neighbours take their share:
  // without the bound over two hundred would wait in the end.
  const Turn overload = TakeTurns(server, side, 5.0 * kQueue, /*told=*/false);
  EXPECT_GT(overload.refused, overload.accepted());
  EXPECT_THAT(overload.refused_by, ElementsAre(Pair("max_queued_rays", overload.refused)));
}

// No bound but the items' own timeouts: the server takes what it can answer in time.
TEST_F(OverloadTest, GoodputHoldsAtThreeTimesTheCapacityByTheForecast) {
  const ServingProcess server({kSceneFlag, "--threads=1"});
  // A neighbour that holds the server up for a third of a deadline makes what was accepted late,
  // whatever the forecast: so a deadline is a second and more.
  const Turn overload = TakeTurns(server, HeavySide(server), 100, /*told=*/true);
  EXPECT_GT(overload.refused, overload.accepted());
  EXPECT_THAT(overload.refused_by, ElementsAre(Pair("item.timeout", overload.refused)));
}

// A small tile of one stream is answered while another has minutes of work before it; by the
// scheduler's turns, not by a thread that happens to be free.
TEST_F(OverloadTest, OneTileDoesNotWaitForAnotherStreamsMillions) {
  ServerOptions options;
  options.threads = 1;
  ServerHarness harness(options);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateBuiltin("heavy", "builtin:sphere:2000", &scene).ok());
  TileStream bulk(harness, Header());
  uint64_t id = 0;
  for (int i = 0; i < 8; ++i) bulk.Write(TileRequest(id++, 0, 0, kImage, kImage));
  v1::TraceTilesResponse response;
  ASSERT_TRUE(bulk.Read(&response));  // Opened...
  ASSERT_TRUE(bulk.Read(&response));  // ... and at work.
  v1::TraceTilesRequest header = Header();
  header.mutable_header()->mutable_stream()->mutable_options()->set_strategy(v1::STRATEGY_AUTO);
  TileStream small(harness, header);
  for (uint64_t tile = 0; tile < 3; ++tile) {
    small.Write(TileRequest(tile, 0, 0, 16, 16));
    do {
      ASSERT_TRUE(small.Read(&response));
    } while (!response.has_reply());
    EXPECT_EQ(response.reply().header().status().code(), 0);
  }
  // The bulk is far from done.
  EXPECT_GT(harness.server->queued_rays(), uint64_t{kImage} * kImage);
}

// One client's quota is its own affair.
TEST_F(OverloadTest, AQuotaIsPerClientAndSaysWhenToComeBack) {
  ServerOptions options;
  options.threads = 1;
  options.limits.max_queued_rays_per_client = kImage * kImage;
  ServerHarness harness(options);
  v1::Scene scene;
  ASSERT_TRUE(harness.CreateBuiltin("heavy", "builtin:sphere:2000", &scene).ok());
  TileStream stream(harness, Header());
  stream.Write(TileRequest(1, 0, 0, kImage, kImage));
  stream.Write(TileRequest(2, 0, 0, 16, 16));
  v1::TraceTilesResponse response;
  while (stream.Read(&response)) {
    if (response.has_reply() && response.reply().header().last()) break;
  }
  EXPECT_EQ(response.reply().header().item_id(), 2u);
  const v1::ItemStatus& status = response.reply().header().status();
  EXPECT_EQ(status.reason(), v1::ERROR_REASON_QUOTA_EXCEEDED);
  EXPECT_EQ(status.metadata().at("limit"), "max_queued_rays_per_client");
  EXPECT_TRUE(status.has_retry_delay());
  // The same machine by another way is another client.
  grpc::ClientContext context;
  const auto stub =
      v1::VisibilityService::NewStub(harness.server->InProcessChannel(grpc::ChannelArguments()));
  const auto other = stub->TraceTiles(&context);
  v1::TraceTilesRequest header = Header();
  header.mutable_header()->mutable_stream()->mutable_options()->set_strategy(v1::STRATEGY_AUTO);
  other->Write(header);
  other->Write(TileRequest(3, 0, 0, 16, 16));
  ASSERT_TRUE(other->Read(&response));
  ASSERT_TRUE(other->Read(&response));
  EXPECT_EQ(response.reply().header().status().code(), 0);
  context.TryCancel();
  other->Finish();
}

}  // namespace
}  // namespace sightline
