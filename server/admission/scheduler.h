// SPDX-License-Identifier: Apache-2.0
//
// Which task of which stream the query threads run next. Work comes in small tasks of so many rays;
// clients share the threads fairly by rays (FairOrder), the streams of one client share its part
// likewise, and within a stream the task with the least key goes first. So a client with one tile
// waits for the tasks that run just now, and not for another client's million points.
//
// It also knows how long work takes, by what tasks of each stream took per ray. By the time of
// their threads' CPUs come the sizes of parts, which should not shrink because the machine is busy;
// by the clock come the time until a new item would be answered (an item that cannot make its
// deadline is better refused than computed) and the delay after which a refused client may try
// again.
//
// Invariants
//  1. At most `threads` tasks run at once, and while fewer do, none of a stream that is not held
//     waits. Each runs once, or is dropped before it starts.
//  2. Between two clients (two streams of one client) that both have tasks waiting, rays started
//     differ by at most one task of each: nobody starves, whatever the others send.
//  3. No lock is held while a task runs or is destroyed.
//
// Thread safety: every method of both classes from any thread; tasks run on the pool's. A task
// keeps its Flow alive by what it captures (Clear breaks that circle); flows go before their
// Scheduler, whose destructor waits for the threads.
//
//   Scheduler scheduler(pool.threads(), [&](auto work) { pool.Submit(std::move(work)); });
//   std::unique_ptr<Scheduler::Flow> flow = scheduler.Open("10.1.2.3");
//   flow->Add({.sequence = 7}, rays, [=] { return Answer(part).ok(); });
#ifndef SIGHTLINE_SERVER_ADMISSION_SCHEDULER_H_
#define SIGHTLINE_SERVER_ADMISSION_SCHEDULER_H_

#include <chrono>
#include <compare>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "absl/functional/any_invocable.h"
#include "core/base/mutex.h"
#include "server/admission/fair_order.h"

namespace sightline {

// Higher priority first, then order of arrival, then parts in order.
struct TaskKey {
  int32_t negative_priority = 0;
  uint64_t sequence = 0;
  uint64_t part = 0;  // 0: decode and prepare; k + 1: part k.

  // clang-tidy 14 takes a 0 within the defaulted comparison for a pointer.
  // NOLINTNEXTLINE(modernize-use-nullptr)
  friend auto operator<=>(const TaskKey&, const TaskKey&) = default;
};

class Scheduler {
 private:
  struct Client;

 public:
  using Clock = std::chrono::steady_clock;
  // Returns whether it did its work, so that the time it took says something of such work.
  using Task = absl::AnyInvocable<bool()>;
  // Runs what it is given later, on a thread of its choice; never within the call.
  using Executor = std::function<void(absl::AnyInvocable<void()>)>;
  using Now = std::function<Clock::time_point()>;
  // CPU time of the calling thread.
  using CpuTime = std::function<std::chrono::nanoseconds()>;

  // How much CPU time a part should take: what the smallest of items may have to wait for each busy
  // thread, and long beside what a task costs by itself (about 10 us).
  static constexpr std::chrono::nanoseconds kPartTime = std::chrono::milliseconds(4);
  // Parts of at most this many rays: some 1,800 points of the 145 patches of a sky, whose
  // neighbours share their walks. A quarter of it traced them at less than half the rate
  // (sightline-bench service, sky-sums).
  static constexpr uint64_t kMostPartRays = 256 << 10;
  // Parts of at least this many: below it the sharing is lost.
  static constexpr uint64_t kLeastPartRays = 8 << 10;
  // Parts while nothing is known: at 20 M/s of one thread, 3 ms.
  static constexpr uint64_t kFirstPartRays = 64 << 10;

  // A moving mean of what a ray takes: the last few tasks, each by its rays.
  class Pace {
   public:
    void Add(uint64_t rays, std::chrono::nanoseconds time);
    bool known() const { return rays_ > 0; }
    double nanos_per_ray() const { return nanos_ / rays_; }

   private:
    double nanos_ = 0, rays_ = 0;
  };

  // How long an item announced now would take until it is done, at the pace of late; 0 before the
  // first task of all.
  struct Forecast {
    // With the server to itself.
    std::chrono::nanoseconds alone{0};
    // Behind what its flow has already, and as much again of each other flow and client, unless
    // that has less: what fair turns come to if everybody keeps coming.
    std::chrono::nanoseconds shared{0};
  };

  class Flow : private FairNode {
   public:
    ~Flow();

    // Appends a task of `rays` > 0 rays, all of which were announced.
    void Add(const TaskKey& key, uint64_t rays, Task task);
    // Drops the tasks of one item that have not started; returns how many there were.
    size_t Drop(int32_t negative_priority, uint64_t sequence);
    // Drops all that have not started.
    void Clear();
    // While held, no task of the flow starts, and none counts as ahead of others.
    void Hold(bool held);

    // Tasks of `rays` in all will come; what has run or was dropped is taken off.
    void Announce(uint64_t rays);
    // They will not come after all.
    void Withdraw(uint64_t rays);
    Forecast Foresee(uint64_t rays) const;
    // How many rays a part should have.
    uint64_t PartRays() const;

   private:
    friend class Scheduler;
    struct Waiting {
      uint64_t rays;
      Task task;
    };
    Flow(Scheduler* scheduler, Client* client) : scheduler_(scheduler), client_(client) {}

    Scheduler* const scheduler_;
    Client* const client_;
    // All guarded by the scheduler's lock.
    std::map<TaskKey, Waiting> waiting_;
    bool held_ = false;
    uint64_t announced_ = 0;  // Rays not yet run.
    Pace pace_, cpu_pace_;
  };

  static std::chrono::nanoseconds ThreadCpuTime();

  Scheduler(int threads, Executor executor, Now now = &Clock::now,
            CpuTime cpu_time = &ThreadCpuTime);
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  // A stream of `client`. Flows of one name share one part.
  std::unique_ptr<Flow> Open(const std::string& client);

  // At most so many tasks run at once.
  int threads() const { return threads_; }
  // How long all threads together take for so many rays, at the pace of late.
  std::chrono::nanoseconds TimeFor(uint64_t rays) const;

  struct Load {
    size_t clients = 0, flows = 0;  // Open.
    size_t waiting_tasks = 0;       // Not started.
    int running_tasks = 0;
    uint64_t announced_rays = 0;  // Not yet run.
    double rays_per_second = 0;   // Of all threads, at the pace of late; 0 before the first task.
  };
  Load load() const;

 private:
  struct Client : FairNode {
    std::string name;
    FairOrder ready;         // Flows with tasks that may start.
    std::set<Flow*> flows;   // All.
    uint64_t announced = 0;  // Of the flows that are not held.
  };
  // A task that was taken to be run.
  struct Taken {
    Flow* flow = nullptr;
    uint64_t rays = 0;
    Task task;
  };

  void Close(Flow* flow);
  // The flow's tasks have changed: it enters or leaves the orders.
  void Update(Flow* flow) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Expect(Flow* flow, int64_t rays) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool Take(Taken* taken) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  double NanosPerRay(const Flow& flow) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  uint64_t PartRays(const Flow& flow) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // How many more threads there is work for; they are then to be asked for without the lock.
  int Claim() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Spawn(int workers);
  void Work();

  const int threads_;
  const Executor executor_;
  const Now now_;
  const CpuTime cpu_time_;
  mutable Mutex mutex_;
  CondVar idle_;
  std::map<std::string, std::unique_ptr<Client>> clients_ ABSL_GUARDED_BY(mutex_);
  FairOrder ready_ ABSL_GUARDED_BY(mutex_);  // Clients with tasks that may start.
  size_t flows_ ABSL_GUARDED_BY(mutex_) = 0;
  size_t waiting_ ABSL_GUARDED_BY(mutex_) = 0;    // Tasks in all flows...
  size_t startable_ ABSL_GUARDED_BY(mutex_) = 0;  // ... and in those not held.
  int workers_ ABSL_GUARDED_BY(mutex_) = 0;       // Given to the executor and not yet back.
  int starting_ ABSL_GUARDED_BY(mutex_) = 0;      // Of them, those yet to take a task.
  int running_ ABSL_GUARDED_BY(mutex_) = 0;       // Tasks.
  uint64_t announced_ ABSL_GUARDED_BY(mutex_) = 0;
  Pace pace_ ABSL_GUARDED_BY(mutex_), cpu_pace_ ABSL_GUARDED_BY(mutex_);  // Of all flows.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_ADMISSION_SCHEDULER_H_
