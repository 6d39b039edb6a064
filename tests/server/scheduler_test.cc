// SPDX-License-Identifier: Apache-2.0
//
// The scheduler by hand: tasks run when the test says so, on a clock that stands still otherwise,
// so that every order below is the only one possible.
#include "server/admission/scheduler.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "core/base/parallel.h"
#include "gtest/gtest.h"
#include "server/admission/timeout_check.h"
#include "server/base/error.h"
#include "tests/support/random.h"

namespace sightline {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using Flow = Scheduler::Flow;

class ByHand {
 public:
  explicit ByHand(int threads = 1)
      : scheduler(
            threads,
            [this](absl::AnyInvocable<void()> work) { workers.push_back(std::move(work)); },
            [this] { return Scheduler::Clock::time_point(now); }, [this] { return cpu; }) {}
  ~ByHand() { RunAll(); }

  // A task that takes `time`, `busy` times as long as its thread works, and appends `name` to
  // `order`.
  void Add(Flow& flow, const std::string& name, uint64_t rays, TaskKey key,
           nanoseconds time = nanoseconds(0), bool done = true, int busy = 1) {
    flow.Announce(rays);
    flow.Add(key, rays, [this, name, time, done, busy] {
      order.push_back(name);
      now += time;
      cpu += time / busy;
      return done;
    });
  }
  void Add(Flow& flow, const std::string& name, uint64_t rays = 1) {
    Add(flow, name, rays, {.sequence = sequence++});
  }
  bool RunWorker() {
    if (workers.empty()) return false;
    absl::AnyInvocable<void()> work = std::move(workers.front());
    workers.pop_front();
    work();
    return true;
  }
  std::vector<std::string> RunAll() {
    while (RunWorker()) {
    }
    return std::exchange(order, {});
  }

  std::deque<absl::AnyInvocable<void()>> workers;
  std::vector<std::string> order;
  nanoseconds now{0}, cpu{0};
  uint64_t sequence = 0;
  Scheduler scheduler;
};

using Names = std::vector<std::string>;

TEST(SchedulerTest, WithinAFlowPriorityThenArrivalThenParts) {
  ByHand hand;
  const auto flow = hand.scheduler.Open("a");
  hand.Add(*flow, "second", 1, {0, 2, 0});
  hand.Add(*flow, "first part", 1, {0, 1, 1});
  hand.Add(*flow, "first", 1, {0, 1, 0});
  hand.Add(*flow, "urgent", 1, {-7, 3, 0});
  EXPECT_EQ(hand.RunAll(), Names({"urgent", "first", "first part", "second"}));
}

TEST(SchedulerTest, OneTileDoesNotWaitForAMillionPoints) {
  ByHand hand;
  const auto bulk = hand.scheduler.Open("bulk");
  const auto tile = hand.scheduler.Open("tile");
  for (int i = 0; i < 100; ++i) hand.Add(*bulk, "bulk", Scheduler::kMostPartRays);
  // One task of the bulk runs when the tile comes.
  ASSERT_TRUE(hand.RunWorker());
  EXPECT_EQ(hand.order.size(), 1u);
  hand.Add(*tile, "tile", 256);
  ASSERT_TRUE(hand.RunWorker());
  EXPECT_EQ(hand.order[1], "tile");
}

// Whatever the sizes of their tasks: while both have some, two clients are served the same rays but
// for one task of each; and so are two streams of one client.
TEST(SchedulerTest, SharesByRaysBetweenClientsAndBetweenTheirStreams) {
  for (uint64_t round = 0; round < 20; ++round) {
    testing_support::TestRng random(round);
    ByHand hand;
    // Client "a" has one stream, client "b" three: it gets no more for that.
    std::map<std::string, std::unique_ptr<Flow>> flows;
    flows["a"] = hand.scheduler.Open("a");
    for (const char* name : {"b1", "b2", "b3"}) flows[name] = hand.scheduler.Open("b");
    std::map<std::string, uint64_t> most, left;
    std::map<std::string, uint64_t> served;
    uint64_t sequence = 0;
    for (auto& [name, flow] : flows) {
      most[name] = 1 + random.Below(1000);
      const int tasks = 100 + static_cast<int>(random.Below(200));
      for (int i = 0; i < tasks; ++i) {
        const uint64_t rays = 1 + random.Below(most[name]);
        left[name] += rays;
        flow->Announce(rays);
        flow->Add({.sequence = sequence++}, rays, [&, name = name, rays] {
          served[name] += rays;
          left[name] -= rays;
          const auto near = [&](uint64_t x, uint64_t y, uint64_t bound) {
            EXPECT_LE(std::max(x, y) - std::min(x, y), bound) << name;
          };
          const uint64_t most_b = std::max({most["b1"], most["b2"], most["b3"]});
          const uint64_t b = served["b1"] + served["b2"] + served["b3"];
          if (left["a"] > 0 && left["b1"] + left["b2"] + left["b3"] > 0) {
            near(served["a"], b, most["a"] + most_b);
          }
          if (left["b1"] > 0 && left["b2"] > 0) {
            near(served["b1"], served["b2"], most["b1"] + most["b2"]);
          }
          return true;
        });
      }
    }
    hand.RunAll();
    for (const auto& [name, rays] : left) EXPECT_EQ(rays, 0u) << name;
  }
}

// However much comes from one client, the other goes on getting its half.
TEST(SchedulerTest, NobodyStarves) {
  ByHand hand;
  const auto steady = hand.scheduler.Open("steady");
  const auto coming = hand.scheduler.Open("coming");
  for (int i = 0; i < 64; ++i) hand.Add(*steady, "steady", Scheduler::kMostPartRays);
  int steady_runs = 0, coming_runs = 0;
  for (int i = 0; i < 64; ++i) {
    hand.Add(*coming, "coming", 2 * Scheduler::kMostPartRays);
    hand.RunWorker();
    for (const std::string& name : std::exchange(hand.order, {})) {
      ++(name == "steady" ? steady_runs : coming_runs);
    }
  }
  // Twice the rays, half as often.
  EXPECT_NEAR(steady_runs, 2 * coming_runs, 2);
  hand.RunAll();
}

TEST(SchedulerTest, NeverMoreWorkersThanThreadsOrTasks) {
  ByHand hand(3);
  const auto flow = hand.scheduler.Open("a");
  EXPECT_EQ(hand.workers.size(), 0u);
  hand.Add(*flow, "1");
  hand.Add(*flow, "2");
  EXPECT_EQ(hand.workers.size(), 2u);
  for (int i = 0; i < 10; ++i) hand.Add(*flow, "more");
  EXPECT_EQ(hand.workers.size(), 3u);
  EXPECT_EQ(hand.scheduler.load().waiting_tasks, 12u);
  hand.RunAll();
  EXPECT_EQ(hand.scheduler.load().waiting_tasks, 0u);
  EXPECT_EQ(hand.scheduler.load().announced_rays, 0u);
}

// A worker gives its thread back after about one part's rays, so that other users of the pool get
// their turns.
TEST(SchedulerTest, AWorkerQueuesUpAgain) {
  ByHand hand;
  const auto flow = hand.scheduler.Open("a");
  for (int i = 0; i < 10; ++i) hand.Add(*flow, "half", Scheduler::kMostPartRays / 2);
  ASSERT_TRUE(hand.RunWorker());
  EXPECT_EQ(hand.order.size(), 2u);
  EXPECT_EQ(hand.workers.size(), 1u);
  EXPECT_EQ(hand.RunAll().size(), 10u);
}

TEST(SchedulerTest, WhatIsDroppedNeverRuns) {
  ByHand hand;
  const auto flow = hand.scheduler.Open("a");
  hand.Add(*flow, "kept", 5, {0, 1, 0});
  for (uint64_t part = 0; part < 4; ++part) hand.Add(*flow, "dropped", 5, {0, 2, part});
  hand.Add(*flow, "other priority", 5, {1, 2, 0});
  EXPECT_EQ(hand.scheduler.load().announced_rays, 30u);
  EXPECT_EQ(flow->Drop(0, 2), 4u);
  EXPECT_EQ(flow->Drop(0, 2), 0u);
  EXPECT_EQ(hand.scheduler.load().announced_rays, 10u);
  EXPECT_EQ(hand.RunAll(), Names({"kept", "other priority"}));
  hand.Add(*flow, "gone");
  flow->Clear();
  EXPECT_EQ(hand.RunAll(), Names());
  EXPECT_EQ(hand.scheduler.load().announced_rays, 0u);
}

TEST(SchedulerTest, AHeldFlowWaitsAndIsInNobodysWay) {
  ByHand hand;
  const auto held = hand.scheduler.Open("a");
  const auto other = hand.scheduler.Open("a");
  hand.Add(*held, "held");
  held->Hold(true);
  hand.Add(*held, "held too");
  hand.Add(*other, "other");
  EXPECT_EQ(hand.RunAll(), Names({"other"}));
  held->Hold(false);
  EXPECT_EQ(hand.RunAll(), Names({"held", "held too"}));
}

// A task is all that keeps its stream alive when the client has gone: with it goes the flow.
TEST(SchedulerTest, AFlowMayGoWithItsLastTask) {
  ByHand hand;
  struct Stream {
    std::unique_ptr<Flow> flow;
  };
  auto stream = std::make_shared<Stream>();
  stream->flow = hand.scheduler.Open("a");
  stream->flow->Announce(1);
  stream->flow->Add({}, 1, [stream] { return true; });
  const std::weak_ptr<Stream> watch = stream;
  stream.reset();
  EXPECT_FALSE(watch.expired());
  hand.RunAll();
  EXPECT_TRUE(watch.expired());
  EXPECT_EQ(hand.scheduler.load().clients, 0u);
}

TEST(SchedulerTest, PartsTakeAboutTheSameTime) {
  ByHand hand;
  const auto flow = hand.scheduler.Open("a");
  EXPECT_EQ(flow->PartRays(), Scheduler::kFirstPartRays);
  // 0.2 us per ray: 4 ms are 20,000 rays.
  hand.Add(*flow, "", 5000, {}, milliseconds(1));
  hand.RunAll();
  EXPECT_EQ(flow->PartRays(), 20'000u);
  // What was cut short says nothing.
  hand.Add(*flow, "", 5000, {}, nanoseconds(1), /*done=*/false);
  hand.RunAll();
  EXPECT_EQ(flow->PartRays(), 20'000u);
  // Another stream's first parts are sized by what is known of others.
  EXPECT_EQ(hand.scheduler.Open("b")->PartRays(), 20'000u);
  // A pace that changes is followed.
  for (int i = 0; i < 200; ++i) {
    hand.Add(*flow, "", 1000, {}, nanoseconds(1));
    hand.RunAll();
  }
  EXPECT_EQ(flow->PartRays(), Scheduler::kMostPartRays);
  for (int i = 0; i < 200; ++i) {
    hand.Add(*flow, "", 1000, {}, milliseconds(1000));
    hand.RunAll();
  }
  EXPECT_EQ(flow->PartRays(), Scheduler::kLeastPartRays);
}

// A thread that is kept off its CPU makes no smaller parts, but later answers.
TEST(SchedulerTest, ABusyMachineMakesPartsNoSmaller) {
  ByHand hand;
  const auto flow = hand.scheduler.Open("a");
  hand.Add(*flow, "", 5000, {}, milliseconds(8), /*done=*/true, /*busy=*/8);
  hand.RunAll();
  EXPECT_EQ(flow->PartRays(), 20'000u);
  EXPECT_EQ(flow->Foresee(5000).shared, milliseconds(8));
}

TEST(SchedulerTest, AWorkerThatHasTakenAPartsTimeQueuesUpAgain) {
  ByHand hand;
  const auto flow = hand.scheduler.Open("a");
  for (int i = 0; i < 5; ++i) {
    hand.Add(*flow, "half", 100, {.sequence = hand.sequence++}, Scheduler::kPartTime / 2);
  }
  ASSERT_TRUE(hand.RunWorker());
  EXPECT_EQ(hand.order.size(), 2u);
}

TEST(SchedulerTest, ForeseesWhatFairTurnsComeTo) {
  ByHand hand;
  const auto mine = hand.scheduler.Open("a");
  const auto sibling = hand.scheduler.Open("a");
  const auto other = hand.scheduler.Open("b");
  EXPECT_EQ(mine->Foresee(1000).shared, nanoseconds(0));
  for (Flow* flow : {mine.get(), sibling.get(), other.get()}) {
    hand.Add(*flow, "", 1000, {}, milliseconds(1));
    hand.RunAll();
  }
  EXPECT_EQ(hand.scheduler.TimeFor(5000), milliseconds(5));
  EXPECT_EQ(hand.scheduler.load().rays_per_second, 1e6);
  EXPECT_EQ(mine->Foresee(1000).shared, milliseconds(1));
  // A million points elsewhere cost a small item no more than its own size again, each.
  sibling->Announce(1'000'000);
  EXPECT_EQ(mine->Foresee(1000).shared, milliseconds(2));
  other->Announce(1'000'000);
  EXPECT_EQ(mine->Foresee(1000).shared, milliseconds(4));
  EXPECT_EQ(mine->Foresee(1000).alone, milliseconds(1));
  // Short queues are no longer than they are; one's own are waited for whole.
  other->Withdraw(999'900);
  EXPECT_EQ(mine->Foresee(1000).shared, std::chrono::microseconds(2100));
  mine->Announce(3000);
  EXPECT_EQ(mine->Foresee(1000).shared, std::chrono::microseconds(8100));
  // Who reads nothing is in nobody's way.
  sibling->Hold(true);
  EXPECT_EQ(mine->Foresee(1000).shared, std::chrono::microseconds(4100));
}

TEST(SchedulerTest, ThreadsShareAllButTheLastPart) {
  ByHand hand(4);
  const auto flow = hand.scheduler.Open("a");
  hand.Add(*flow, "", 1000, {}, milliseconds(1));
  hand.RunAll();
  // One part is one thread's alone...
  EXPECT_EQ(flow->Foresee(1000).shared, milliseconds(1));
  // ... many are everybody's.
  const nanoseconds large = flow->Foresee(4'000'000).shared;
  const nanoseconds part = std::chrono::microseconds(flow->PartRays());  // At 1 us per ray.
  EXPECT_EQ(large, milliseconds(1000) + part * 3 / 4);
  EXPECT_LT(part, milliseconds(10));
}

// Tasks that come from and run on many threads: each runs once, and the destructor waits.
TEST(SchedulerTest, RunsEverythingOnceOnRealThreads) {
  constexpr int kFlows = 8, kTasks = 500;
  std::atomic<int> runs = 0;
  {
    ThreadPool pool(4);
    Scheduler scheduler(4, [&](absl::AnyInvocable<void()> work) { pool.Submit(std::move(work)); });
    std::vector<std::unique_ptr<Flow>> flows;
    for (int f = 0; f < kFlows; ++f) flows.push_back(scheduler.Open(f % 2 == 0 ? "a" : "b"));
    std::vector<std::thread> feeders;
    for (int f = 0; f < kFlows; ++f) {
      feeders.emplace_back([&, f] {
        for (uint64_t i = 0; i < kTasks; ++i) {
          flows[f]->Announce(100);
          flows[f]->Add({.sequence = i}, 100, [&] {
            ++runs;
            return true;
          });
          if (i % 64 == 0) flows[f]->Hold(i % 128 == 0);
        }
        flows[f]->Hold(false);
      });
    }
    for (std::thread& feeder : feeders) feeder.join();
    while (scheduler.load().announced_rays > 0) std::this_thread::yield();
    flows.clear();
  }
  EXPECT_EQ(runs, kFlows * kTasks);
}

TEST(TimeoutCheckTest, RefusesWhatTheQueueAloneMakesTooLate) {
  const Scheduler::Forecast forecast{.alone = milliseconds(10), .shared = milliseconds(100)};
  EXPECT_TRUE(CheckTimeout(absl::Milliseconds(151), forecast).ok());
  const absl::Status refused = CheckTimeout(absl::Milliseconds(50), forecast);
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_QUEUE_FULL);
  v1::ItemStatus item;
  ToItemStatus(refused, &item);
  EXPECT_EQ(item.retry_delay().nanos(), 100'000'000);
  // Alone it would be too late as well: no later time is better.
  EXPECT_TRUE(CheckTimeout(absl::Milliseconds(12), forecast).ok());
}

}  // namespace
}  // namespace sightline
