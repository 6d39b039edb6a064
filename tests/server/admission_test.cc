// SPDX-License-Identifier: Apache-2.0
#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "server/admission/call_deadline.h"
#include "server/admission/call_quota.h"
#include "server/admission/call_tracker.h"
#include "server/admission/client_name.h"
#include "server/admission/idle_clock.h"
#include "server/admission/memory_charge.h"
#include "server/admission/ray_queue.h"
#include "server/admission/upload_slots.h"
#include "server/base/error.h"

namespace sightline {
namespace {

using ::testing::HasSubstr;

TEST(RayQueueTest, RefusesWhatDoesNotFitAndTakesItOnceThereIsRoom) {
  RayQueue queue(100, 1000);
  const RayAccount account = queue.Open("a");
  absl::StatusOr<RayTicket> first = queue.Admit(account, 70);
  ASSERT_TRUE(first.ok());
  const absl::StatusOr<RayTicket> second = queue.Admit(account, 31);
  EXPECT_EQ(second.status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(second.status()), v1::ERROR_REASON_QUEUE_FULL);
  EXPECT_TRUE(queue.Admit(account, 30).ok());
  EXPECT_EQ(queue.queued_rays(), 70u);
  first->Release();
  first->Release();  // Once is enough.
  EXPECT_EQ(queue.queued_rays(), 0u);
}

TEST(RayQueueTest, AnItemLargerThanTheQueueIsTakenAlone) {
  RayQueue queue(100, 1000);
  const RayAccount account = queue.Open("a");
  absl::StatusOr<RayTicket> large = queue.Admit(account, 1000);
  ASSERT_TRUE(large.ok());
  EXPECT_FALSE(queue.Admit(account, 1).ok());
  *large = RayTicket();
  EXPECT_TRUE(queue.Admit(account, 1).ok());
}

TEST(RayQueueTest, SumsDoNotWrapAround) {
  RayQueue queue(100, 1000);
  const RayAccount account = queue.Open("a");
  const absl::StatusOr<RayTicket> first = queue.Admit(account, 1);
  ASSERT_TRUE(first.ok());
  EXPECT_FALSE(queue.Admit(account, ~uint64_t{0}).ok());
}

TEST(RayQueueTest, AClientMayHaveAQuotaOfItsOwn) {
  RayQueue queue(1000, 100);
  const RayAccount small = queue.Open("small", 20), usual = queue.Open("usual");
  const absl::StatusOr<RayTicket> first = queue.Admit(small, 15);
  EXPECT_TRUE(first.ok());
  const absl::Status refused = queue.Admit(small, 15).status();
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_QUOTA_EXCEEDED);
  EXPECT_THAT(std::string(refused.message()), HasSubstr("limit rays of the access file = 20"));
  const absl::StatusOr<RayTicket> second = queue.Admit(usual, 15);
  EXPECT_TRUE(second.ok());
  EXPECT_THAT(std::string(queue.Admit(usual, 86).status().message()),
              HasSubstr("max_queued_rays_per_client = 100"));
  EXPECT_TRUE(queue.Admit(usual, 85).ok());
}

TEST(RayQueueTest, EachClientHasItsQuota) {
  RayQueue queue(100, 60);
  const RayAccount a = queue.Open("a");
  absl::StatusOr<RayTicket> first = queue.Admit(a, 50);
  ASSERT_TRUE(first.ok());
  // Another stream of the same client has the same account.
  const absl::Status refused = queue.Admit(queue.Open("a"), 11).status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_QUOTA_EXCEEDED);
  // Others have theirs, as long as the queue has room.
  absl::StatusOr<RayTicket> other = queue.Admit(queue.Open("b"), 50);
  EXPECT_TRUE(other.ok());
  EXPECT_EQ(ReasonOf(queue.Admit(queue.Open("c"), 1).status()), v1::ERROR_REASON_QUEUE_FULL);
  other->Release();
  // One item beyond the quota is answered when it is the client's only one.
  EXPECT_TRUE(queue.Admit(queue.Open("b"), 50).ok());
  EXPECT_FALSE(queue.Admit(a, 61).ok());
  first->Release();
  EXPECT_TRUE(queue.Admit(a, 61).ok());
}

TEST(ClientNameTest, AnAddressIsAClientWhateverThePort) {
  EXPECT_EQ(ClientOfPeer("ipv4:10.1.2.3:40211"), "ipv4:10.1.2.3");
  EXPECT_EQ(ClientOfPeer("ipv6:%5B::1%5D:443"), "ipv6:%5B::1%5D");
  EXPECT_EQ(ClientOfPeer("unix:"), "unix");
  EXPECT_EQ(ClientOfPeer("unix:run/sightline.sock"), "unix");
  EXPECT_EQ(ClientOfPeer("inproc"), "inproc");
}

class Listener : public DrainListener {
 public:
  void OnDrain() override { ++drains; }
  void EndIfStalled(std::chrono::steady_clock::time_point now) override { asked = now; }
  int drains = 0;
  std::chrono::steady_clock::time_point asked;
};

TEST(CallTrackerTest, DrainTellsListenersOnceAndRefusesNewCalls) {
  CallTracker tracker;
  const auto listener = std::make_shared<Listener>();
  absl::StatusOr<ActiveCall> call = tracker.Admit(listener);
  ASSERT_TRUE(call.ok());
  tracker.StartDrain();
  tracker.StartDrain();
  EXPECT_EQ(listener->drains, 1);
  const absl::Status refused = tracker.Admit().status();
  EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
  EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_DRAINING);
}

TEST(CallTrackerTest, SweepsAskTheListenersOfCallsUnderWay) {
  CallTracker tracker;
  const auto listener = std::make_shared<Listener>(), over = std::make_shared<Listener>();
  const auto plain = tracker.Admit(), call = tracker.Admit(listener);
  ASSERT_TRUE(tracker.Admit(over).ok());
  const auto now = std::chrono::steady_clock::now();
  tracker.Sweep(now);
  EXPECT_EQ(listener->asked, now);
  EXPECT_NE(over->asked, now);
  // A drain has them to wait for.
  tracker.StartDrain();
  tracker.Sweep(now + std::chrono::seconds(1));
  EXPECT_EQ(listener->asked, now + std::chrono::seconds(1));
}

TEST(CallTrackerTest, WhoWaitsForADrainHearsOfItOrOfItsDeadline) {
  CallTracker tracker;
  EXPECT_FALSE(tracker.WaitUntilDraining(std::chrono::steady_clock::now()));
  std::thread drainer([&] { tracker.StartDrain(); });
  EXPECT_TRUE(tracker.WaitUntilDraining(std::chrono::steady_clock::time_point::max()));
  drainer.join();
  EXPECT_TRUE(tracker.WaitUntilDraining(std::chrono::steady_clock::now()));
}

TEST(CallTrackerTest, WaitsForTheLastCall) {
  CallTracker tracker;
  absl::StatusOr<ActiveCall> call = tracker.Admit();
  ASSERT_TRUE(call.ok());
  EXPECT_FALSE(tracker.WaitUntilIdle(std::chrono::steady_clock::now()));
  std::thread ender([&] { call->Release(); });
  EXPECT_TRUE(tracker.WaitUntilIdle(std::chrono::steady_clock::time_point::max()));
  ender.join();
  EXPECT_EQ(tracker.active_calls(), 0u);
}

TEST(CallQuotaTest, EachClientHasItsOwnAndGivesItBack) {
  CallQuota quota("streams");
  absl::StatusOr<CallShare> first = quota.Take("a", 2), second = quota.Take("a", 2);
  EXPECT_TRUE(first.ok() && second.ok());
  const absl::Status third = quota.Take("a", 2).status();
  EXPECT_EQ(third.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(third), v1::ERROR_REASON_QUOTA_EXCEEDED);
  EXPECT_TRUE(quota.Take("b", 2).ok());
  // A limit that was raised, or taken away, counts at once.
  EXPECT_TRUE(quota.Take("a", 3).ok());
  EXPECT_TRUE(quota.Take("a", 0).ok());
  first->Release();
  EXPECT_TRUE(quota.Take("a", 2).ok());
}

// Amounts that grow: what does not fit beside others' may fit later, what is too much alone never.
TEST(CallQuotaTest, SharesGrowAndAreGivenBackWhole) {
  CallQuota quota("upload-bytes");
  absl::StatusOr<CallShare> first = quota.Take("a", 100, 0), second = quota.Take("a", 100, 0);
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_TRUE(first->Add(60, 100).ok());
  EXPECT_TRUE(second->Add(40, 100).ok());
  const absl::Status beside = second->Add(1, 100);
  EXPECT_EQ(ReasonOf(beside), v1::ERROR_REASON_QUOTA_EXCEEDED) << beside;
  const absl::Status alone = first->Add(41, 100);
  EXPECT_EQ(ReasonOf(alone), v1::ERROR_REASON_LIMIT_EXCEEDED) << alone;
  EXPECT_EQ(ReasonOf(first->Add(~uint64_t{0}, 100)), v1::ERROR_REASON_LIMIT_EXCEEDED);
  EXPECT_TRUE(quota.Take("b", 100, 0)->Add(100, 100).ok());
  CallShare moved = *std::move(first);
  moved.Release();
  EXPECT_TRUE(second->Add(60, 100).ok());
  EXPECT_FALSE(second->Add(1, 100).ok());
  EXPECT_TRUE(second->Add(1000, 0).ok());  // No limit any more.
}

TEST(CallQuotaTest, WaitingDoesNotHelpWhereSharesLast) {
  CallQuota scenes("scenes", CallQuota::Shares::kLast);
  absl::StatusOr<CallShare> share = scenes.Take("a", 1);
  ASSERT_TRUE(share.ok());
  const absl::Status second = scenes.Take("a", 1).status();
  EXPECT_EQ(second.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(ReasonOf(second), v1::ERROR_REASON_LIMIT_EXCEEDED);
  EXPECT_TRUE(scenes.Take("b", 1).ok());
  share->Release();
  EXPECT_TRUE(scenes.Take("a", 1).ok());
}

TEST(CallQuotaTest, WhoseRoleSaysNothingHasTheUsual) {
  CallQuota quota("uploads", CallQuota::Shares::kPass, {"max_concurrent_uploads_per_client", 2});
  const absl::StatusOr<CallShare> first = quota.Take("a", 0), second = quota.Take("a", 0);
  EXPECT_TRUE(first.ok() && second.ok());
  const absl::Status third = quota.Take("a", 0).status();
  EXPECT_EQ(ReasonOf(third), v1::ERROR_REASON_QUOTA_EXCEEDED);
  EXPECT_THAT(std::string(third.message()), HasSubstr("max_concurrent_uploads_per_client = 2: "));
  EXPECT_TRUE(quota.Take("b", 0).ok());
  // A role's limit takes its place, whether it is more or less.
  EXPECT_TRUE(quota.Take("a", 3).ok());
  EXPECT_THAT(std::string(quota.Take("a", 1).status().message()),
              HasSubstr("limit uploads of the access file = 1: "));
}

TEST(IdleClockTest, WaitingCountsUntilSomethingComes) {
  using std::chrono::seconds;
  const IdleClock::Time start = IdleClock::Now();
  IdleClock idle;
  EXPECT_EQ(idle.Idle(start + seconds(100)), seconds(0));  // Nobody waits yet.
  idle.Wait(start);
  EXPECT_EQ(idle.Idle(start + seconds(7)), seconds(7));
  idle.Arrived(start + seconds(7), /*bytes=*/1 << 20);
  EXPECT_EQ(idle.Idle(start + seconds(100)), seconds(0));  // The server is at work.
  idle.Wait(start + seconds(100));
  EXPECT_EQ(idle.Idle(start + seconds(102)), seconds(2));
  // Messages that bring nothing do not begin anew; what the server does with them is not counted.
  idle.Arrived(start + seconds(103), /*bytes=*/0);
  idle.Wait(start + seconds(110));
  EXPECT_EQ(idle.Idle(start + seconds(112)), seconds(5));
  idle.Arrived(start + seconds(112), /*bytes=*/0);
  idle.Wait(start + seconds(112));
  EXPECT_EQ(idle.Idle(start + seconds(120)), seconds(13));
  // Others make up for as much as they bring, and for no more.
  idle.Arrived(start + seconds(120), /*bytes=*/3 * IdleClock::kBytesPerSecond);
  idle.Wait(start + seconds(120));
  EXPECT_EQ(idle.Idle(start + seconds(121)), seconds(11));
  idle.Arrived(start + seconds(121), /*bytes=*/~uint64_t{0});
  idle.Wait(start + seconds(121));
  EXPECT_EQ(idle.Idle(start + seconds(122)), seconds(1));
}

// A vertex a minute is no upload.
TEST(IdleClockTest, ATrickleRunsOut) {
  using std::chrono::seconds;
  const IdleClock::Time start = IdleClock::Now();
  const auto after_a_minute_each = [start](int messages, uint64_t bytes) {
    IdleClock idle;
    for (int i = 0; i < messages; ++i) {
      idle.Wait(start + seconds(60 * i));
      idle.Arrived(start + seconds(60 * (i + 1)), bytes);
    }
    idle.Wait(start + seconds(60 * messages));
    return idle.Idle(start + seconds(60 * messages));
  };
  EXPECT_GT(after_a_minute_each(2, 24), seconds(119));
  EXPECT_EQ(after_a_minute_each(2, 60 * IdleClock::kBytesPerSecond), seconds(0));
}

class SmallBudget : public MemoryBudget {
 public:
  absl::Status SetAside(uint64_t bytes) override {
    if (taken + bytes > 100) return absl::ResourceExhaustedError("no room");
    taken += bytes;
    return absl::OkStatus();
  }
  void GiveBack(uint64_t bytes) override { taken -= bytes; }
  uint64_t taken = 0;
};

TEST(MemoryChargeTest, IsGivenBackWholeAndOnce) {
  SmallBudget budget;
  {
    MemoryCharge charge(budget);
    EXPECT_TRUE(charge.Add(0).ok());
    EXPECT_TRUE(charge.Add(60).ok());
    EXPECT_FALSE(charge.Add(41).ok());
    EXPECT_EQ(budget.taken, 60u);  // What was refused was not taken.
    EXPECT_TRUE(charge.Add(40).ok());
    charge.Release();
    EXPECT_EQ(budget.taken, 0u);
    charge.Release();
    EXPECT_TRUE(charge.Add(7).ok());
  }
  EXPECT_EQ(budget.taken, 0u);
}

class Asked : public WaitingUpload {
 public:
  void EndIfIdle(IdleClock::Time now) override { last = now; }
  IdleClock::Time last;
};

TEST(UploadSlotsTest, SweepsAskThoseThatHaveASlot) {
  UploadSlots slots(3);
  const auto asked = std::make_shared<Asked>(), gone = std::make_shared<Asked>();
  const absl::StatusOr<UploadSlot> slot = slots.Take(asked), none = slots.Take();
  absl::StatusOr<UploadSlot> ended = slots.Take(gone);
  EXPECT_TRUE(slot.ok() && none.ok() && ended.ok());
  ended->Release();
  const IdleClock::Time now = IdleClock::Now();
  slots.Sweep(now);
  EXPECT_EQ(asked->last, now);
  EXPECT_EQ(gone->last, IdleClock::Time());
  EXPECT_EQ(slots.taken(), 2u);
}

TEST(UploadSlotsTest, AreGivenBack) {
  UploadSlots slots(1);
  {
    const absl::StatusOr<UploadSlot> slot = slots.Take();
    ASSERT_TRUE(slot.ok());
    const absl::Status refused = slots.Take().status();
    EXPECT_EQ(refused.code(), absl::StatusCode::kResourceExhausted);
    EXPECT_EQ(ReasonOf(refused), v1::ERROR_REASON_LIMIT_EXCEEDED);
    // It passes, and says so.
    EXPECT_TRUE(refused.GetPayload(kRetryInfoUrl).has_value());
  }
  EXPECT_TRUE(slots.Take().ok());
}

// A client whose own clock runs out first has sent the time that it had rounded up by gRPC.
TEST(CallDeadlineTest, EndsACallShortlyBeforeItAndNoEarlier) {
  using std::chrono::milliseconds, std::chrono::seconds;
  const CallDeadline::Clock::time_point begin = CallDeadline::Clock::now();
  const CallDeadline soon(begin, begin + seconds(100));
  EXPECT_FALSE(soon.Ends(begin));
  EXPECT_FALSE(soon.Ends(begin + seconds(98)));
  EXPECT_TRUE(soon.Ends(begin + seconds(99)));
  EXPECT_TRUE(soon.Ends(begin + seconds(200)));
  const CallDeadline short_one(begin, begin + milliseconds(50));
  EXPECT_FALSE(short_one.Ends(begin + milliseconds(40)));
  EXPECT_TRUE(short_one.Ends(begin + milliseconds(49)));
  const CallDeadline never(begin, CallDeadline::Clock::time_point::max());
  EXPECT_FALSE(never.Ends(begin + std::chrono::hours(24 * 365)));
  CancelToken expired, cancelled;
  CallDeadline(begin, begin).Fire(&expired);
  never.Fire(&cancelled);
  EXPECT_TRUE(absl::IsDeadlineExceeded(expired.ToStatus()));
  EXPECT_TRUE(absl::IsCancelled(cancelled.ToStatus()));
}

}  // namespace
}  // namespace sightline
