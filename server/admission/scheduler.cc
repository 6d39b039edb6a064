// SPDX-License-Identifier: Apache-2.0
#include "server/admission/scheduler.h"

#include <time.h>  // NOLINT(modernize-deprecated-headers): clock_gettime is POSIX.

#include <algorithm>
#include <utility>
#include <vector>

#include "core/base/check.h"

namespace sightline {
namespace {

// What the past weighs in a pace, per task: about the last sixteen count.
constexpr double kPast = 15.0 / 16;

std::chrono::nanoseconds Nanos(double nanos) {
  // Far beyond any timeout, and far within what a clock can hold.
  constexpr double kMost = 1e17;
  return std::chrono::nanoseconds(static_cast<int64_t>(std::clamp(nanos, 0.0, kMost)));
}

}  // namespace

void Scheduler::Pace::Add(uint64_t rays, std::chrono::nanoseconds time) {
  nanos_ = nanos_ * kPast + static_cast<double>(time.count());
  rays_ = rays_ * kPast + static_cast<double>(rays);
}

std::chrono::nanoseconds Scheduler::ThreadCpuTime() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

Scheduler::Scheduler(int threads, Executor executor, Now now, CpuTime cpu_time)
    : threads_(threads),
      executor_(std::move(executor)),
      now_(std::move(now)),
      cpu_time_(std::move(cpu_time)) {
  SIGHTLINE_CHECK_GT(threads, 0);
}

Scheduler::~Scheduler() {
  MutexLock lock(mutex_);
  while (workers_ > 0) idle_.Wait(mutex_);
  SIGHTLINE_CHECK_EQ(flows_, 0u);
}

std::unique_ptr<Scheduler::Flow> Scheduler::Open(const std::string& name) {
  MutexLock lock(mutex_);
  std::unique_ptr<Client>& client = clients_[name];
  if (client == nullptr) {
    client = std::make_unique<Client>();
    client->name = name;
  }
  std::unique_ptr<Flow> flow(new Flow(this, client.get()));
  client->flows.insert(flow.get());
  ++flows_;
  return flow;
}

void Scheduler::Close(Flow* flow) {
  flow->Clear();
  MutexLock lock(mutex_);
  Expect(flow, -static_cast<int64_t>(flow->announced_));
  Client* const client = flow->client_;
  client->flows.erase(flow);
  --flows_;
  if (!client->flows.empty()) return;
  ready_.Leave(client);
  clients_.erase(std::string(client->name));
}

std::chrono::nanoseconds Scheduler::TimeFor(uint64_t rays) const {
  MutexLock lock(mutex_);
  if (!pace_.known()) return std::chrono::nanoseconds(0);
  return Nanos(static_cast<double>(rays) * pace_.nanos_per_ray() / threads_);
}

Scheduler::Load Scheduler::load() const {
  MutexLock lock(mutex_);
  return {.clients = clients_.size(),
          .flows = flows_,
          .waiting_tasks = waiting_,
          .running_tasks = running_,
          .announced_rays = announced_,
          .rays_per_second = pace_.known() ? threads_ * 1e9 / pace_.nanos_per_ray() : 0};
}

void Scheduler::Update(Flow* flow) {
  Client* const client = flow->client_;
  if (!flow->held_ && !flow->waiting_.empty()) {
    client->ready.Enter(flow);
    ready_.Enter(client);
    return;
  }
  client->ready.Leave(flow);
  if (client->ready.empty()) ready_.Leave(client);
}

void Scheduler::Expect(Flow* flow, int64_t rays) {
  // Unsigned sums wrap, so that adding a negative number takes away.
  flow->announced_ += static_cast<uint64_t>(rays);
  announced_ += static_cast<uint64_t>(rays);
  if (!flow->held_) flow->client_->announced += static_cast<uint64_t>(rays);
}

bool Scheduler::Take(Taken* taken) {
  auto* const client = static_cast<Client*>(ready_.First());
  if (client == nullptr) return false;
  auto* const flow = static_cast<Flow*>(client->ready.First());
  const auto first = flow->waiting_.begin();
  taken->flow = flow;
  taken->rays = first->second.rays;
  taken->task = std::move(first->second.task);
  flow->waiting_.erase(first);
  --waiting_;
  --startable_;
  client->ready.Serve(flow, taken->rays);
  ready_.Serve(client, taken->rays);
  Update(flow);
  return true;
}

double Scheduler::NanosPerRay(const Flow& flow) const {
  if (flow.pace_.known()) return flow.pace_.nanos_per_ray();
  return pace_.known() ? pace_.nanos_per_ray() : 0;
}

uint64_t Scheduler::PartRays(const Flow& flow) const {
  const Pace& pace = flow.cpu_pace_.known() ? flow.cpu_pace_ : cpu_pace_;
  if (!pace.known()) return kFirstPartRays;
  // What takes no measurable time fits any size.
  const double wanted =
      static_cast<double>(kPartTime.count()) / std::max(pace.nanos_per_ray(), 1e-6);
  return static_cast<uint64_t>(
      std::clamp(wanted, static_cast<double>(kLeastPartRays), static_cast<double>(kMostPartRays)));
}

int Scheduler::Claim() {
  const auto startable = static_cast<int64_t>(startable_);
  const auto wanted =
      std::clamp<int64_t>(startable - starting_, 0, static_cast<int64_t>(threads_ - workers_));
  workers_ += static_cast<int>(wanted);
  starting_ += static_cast<int>(wanted);
  return static_cast<int>(wanted);
}

void Scheduler::Spawn(int workers) {
  for (int i = 0; i < workers; ++i) executor_([this] { Work(); });
}

// Runs tasks until it has done about as much as one large part, and then queues up again: what
// others gave to the same threads gets its turn.
void Scheduler::Work() {
  uint64_t spent = 0;
  std::chrono::nanoseconds spent_time{0};
  int more = 0;
  bool first = true;
  while (true) {
    Taken taken;
    {
      MutexLock lock(mutex_);
      if (std::exchange(first, false)) --starting_;
      if (spent >= kMostPartRays || spent_time >= kPartTime || !Take(&taken)) {
        --workers_;
        more = Claim();
        if (workers_ == 0) idle_.SignalAll();
        break;
      }
      ++running_;
    }
    const Clock::time_point start = now_();
    const std::chrono::nanoseconds cpu_start = cpu_time_();
    const bool done = taken.task();
    const std::chrono::nanoseconds time = now_() - start, cpu_time = cpu_time_() - cpu_start;
    spent += taken.rays;
    spent_time += cpu_time;
    {
      MutexLock lock(mutex_);
      --running_;
      if (done) {
        taken.flow->pace_.Add(taken.rays, time);
        taken.flow->cpu_pace_.Add(taken.rays, cpu_time);
        pace_.Add(taken.rays, time);
        cpu_pace_.Add(taken.rays, cpu_time);
      }
      Expect(taken.flow, -static_cast<int64_t>(taken.rays));
    }
    // The task goes last, without the lock: with it may go its flow.
  }
  if (more > 0) Spawn(more);
}

Scheduler::Flow::~Flow() { scheduler_->Close(this); }

void Scheduler::Flow::Add(const TaskKey& key, uint64_t rays, Task task) {
  int more = 0;
  {
    MutexLock lock(scheduler_->mutex_);
    const bool added = waiting_.emplace(key, Waiting{rays, std::move(task)}).second;
    SIGHTLINE_CHECK(added) << "two tasks have one key";
    ++scheduler_->waiting_;
    if (!held_) ++scheduler_->startable_;
    scheduler_->Update(this);
    more = scheduler_->Claim();
  }
  scheduler_->Spawn(more);
}

size_t Scheduler::Flow::Drop(int32_t negative_priority, uint64_t sequence) {
  std::vector<Task> dropped;
  {
    MutexLock lock(scheduler_->mutex_);
    auto next = waiting_.lower_bound({negative_priority, sequence, 0});
    while (next != waiting_.end() && next->first.negative_priority == negative_priority &&
           next->first.sequence == sequence) {
      scheduler_->Expect(this, -static_cast<int64_t>(next->second.rays));
      dropped.push_back(std::move(next->second.task));
      next = waiting_.erase(next);
    }
    scheduler_->waiting_ -= dropped.size();
    if (!held_) scheduler_->startable_ -= dropped.size();
    scheduler_->Update(this);
  }
  return dropped.size();
}

void Scheduler::Flow::Clear() {
  std::map<TaskKey, Waiting> dropped;
  MutexLock lock(scheduler_->mutex_);
  dropped.swap(waiting_);
  for (const auto& [key, task] : dropped) {
    scheduler_->Expect(this, -static_cast<int64_t>(task.rays));
  }
  scheduler_->waiting_ -= dropped.size();
  if (!held_) scheduler_->startable_ -= dropped.size();
  scheduler_->Update(this);
}

void Scheduler::Flow::Hold(bool held) {
  int more = 0;
  {
    MutexLock lock(scheduler_->mutex_);
    if (held_ == held) return;
    held_ = held;
    if (held) {
      scheduler_->startable_ -= waiting_.size();
      client_->announced -= announced_;
    } else {
      scheduler_->startable_ += waiting_.size();
      client_->announced += announced_;
    }
    scheduler_->Update(this);
    more = scheduler_->Claim();
  }
  scheduler_->Spawn(more);
}

void Scheduler::Flow::Announce(uint64_t rays) {
  MutexLock lock(scheduler_->mutex_);
  scheduler_->Expect(this, static_cast<int64_t>(rays));
}

void Scheduler::Flow::Withdraw(uint64_t rays) {
  MutexLock lock(scheduler_->mutex_);
  SIGHTLINE_CHECK_GE(announced_, rays);
  scheduler_->Expect(this, -static_cast<int64_t>(rays));
}

Scheduler::Forecast Scheduler::Flow::Foresee(uint64_t rays) const {
  MutexLock lock(scheduler_->mutex_);
  const double own_pace = scheduler_->NanosPerRay(*this);
  const double pace = scheduler_->pace_.known() ? scheduler_->pace_.nanos_per_ray() : 0;
  const double item = static_cast<double>(rays) * own_pace;
  const uint64_t own = announced_ + rays;
  uint64_t of_client = own;
  double all = static_cast<double>(own) * own_pace;
  for (const Flow* other : client_->flows) {
    if (other == this || other->held_) continue;
    const uint64_t ahead = std::min(other->announced_, own);
    all += static_cast<double>(ahead) * scheduler_->NanosPerRay(*other);
    of_client += ahead;
  }
  for (const auto& [name, other] : scheduler_->clients_) {
    if (other.get() == client_) continue;
    all += static_cast<double>(std::min(other->announced, of_client)) * pace;
  }
  // The threads share the work, but for the last part, which is one thread's alone.
  const double threads = scheduler_->threads_;
  const double last = static_cast<double>(std::min(rays, scheduler_->PartRays(*this))) * own_pace;
  const double tail = last * (1 - 1 / threads);
  return {.alone = Nanos(item / threads + tail), .shared = Nanos(all / threads + tail)};
}

uint64_t Scheduler::Flow::PartRays() const {
  MutexLock lock(scheduler_->mutex_);
  return scheduler_->PartRays(*this);
}

}  // namespace sightline
