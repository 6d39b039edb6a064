// SPDX-License-Identifier: Apache-2.0
#include "client/load/driver.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace sightline::load {
namespace {

// How late a Stop may be noticed.
constexpr absl::Duration kPoll = absl::Milliseconds(50);
// The same while a closed loop waits after refusals, and how late one that may go sooner is.
constexpr absl::Duration kRefusalPoll = absl::Milliseconds(5);

bool IsRefusal(const absl::Status& status) {
  return absl::IsResourceExhausted(status) || absl::IsUnavailable(status);
}

std::chrono::steady_clock::time_point PollTime() {
  return std::chrono::steady_clock::now() + absl::ToChronoMilliseconds(kPoll);
}

}  // namespace

Driver::Driver(const RunPlan& plan, Clock& clock, Target& target, Recorder& recorder, Pick pick)
    : plan_(plan), clock_(clock), target_(target), recorder_(recorder), pick_(std::move(pick)) {}

absl::Status Driver::Run() {
  start_ = clock_.Now();
  measure_ = start_ + plan_.warm_up;
  end_ = measure_ + plan_.duration;
  recorder_.Begin(measure_, end_);
  target_.SetOnDone([this](const Outcome& outcome) { OnDone(outcome); });
  if (plan_.mode == Mode::kOpen) {
    RunOpen();
  } else {
    RunClosed();
  }
  WaitForAnswers();
  absl::Status status = target_.status();
  if (!status.ok()) Stop();
  return status;
}

void Driver::Stop() {
  MutexLock lock(mutex_);
  stop_ = std::min(stop_, clock_.Now());
  answered_.SignalAll();
}

absl::Time Driver::end() const {
  MutexLock lock(mutex_);
  if (plan_.max_requests > 0 && measured_ >= plan_.max_requests) {
    return std::min(last_outcome_, end_);
  }
  return std::min(std::max(stop_, last_outcome_), end_);
}

absl::Time Driver::LastDue() const { return std::min(end_, stop_); }

// Whether the plan has a request then, sent or not.
bool Driver::IsDue(absl::Time planned) const {
  return planned < LastDue() && (plan_.max_requests == 0 || measured_ < plan_.max_requests);
}

bool Driver::Over(absl::Time time) const { return given_up_ || !IsDue(time); }

Request Driver::Plan(absl::Time planned) {
  const uint64_t number = planned_++;
  if (planned >= measure_) ++measured_;
  return {.number = number, .work = pick_(number), .planned = planned};
}

// Makes the next request, due at `planned`; false when the run is over.
bool Driver::Next(absl::Time planned, Request* request) {
  if (Over(planned)) return false;
  *request = Plan(planned);
  ++outstanding_;
  return true;
}

void Driver::RunOpen() {
  ArrivalSchedule arrivals(plan_.arrivals, plan_.rate, plan_.seed);
  while (true) {
    const absl::Time due = start_ + arrivals.Next();
    if (!WaitUntilDue(due)) return;
    bool sends = WaitForRoom(due);
    Request request;
    if (sends) {
      MutexLock lock(mutex_);
      sends = Next(due, &request);
    }
    if (!sends) return CountUnsent(due, &arrivals);
    target_.Send(request);
  }
}

// False if the run ends before: then what is unanswered has had all of the run's time.
bool Driver::WaitUntilDue(absl::Time due) {
  // In steps, so that Stop ends a slow schedule soon.
  for (absl::Time now = clock_.Now(); now < due; now = clock_.Now()) {
    absl::Time until = due;
    {
      MutexLock lock(mutex_);
      if (Over(due)) {
        const bool by_count = plan_.max_requests > 0 && measured_ >= plan_.max_requests;
        until = LastDue();
        if (by_count || outstanding_ == 0 || now >= until) return false;
      }
    }
    if (!target_.status().ok()) return false;
    clock_.WaitUntil(std::min(until, now + kPoll));
  }
  return true;
}

// False if the run ends meanwhile.
bool Driver::WaitForRoom(absl::Time due) {
  MutexLock lock(mutex_);
  while (!Over(due) && outstanding_ >= plan_.max_outstanding) {
    // Late is late: past the end and the time to drain nothing more is sent.
    if (clock_.Now() >= LastDue() + plan_.drain) return false;
    answered_.WaitUntil(mutex_, PollTime());
  }
  return !Over(due);
}

// What was due from `due` until now and will not be sent, or an open loop that its bound held up
// would show the latencies of those alone that it let go.
void Driver::CountUnsent(absl::Time due, ArrivalSchedule* arrivals) {
  const absl::Time now = clock_.Now();
  for (; due <= now; due = start_ + arrivals->Next()) {
    Outcome outcome{.received = now,
                    .status = absl::CancelledError("the run ended before it was sent"),
                    .given_up = true};
    {
      MutexLock lock(mutex_);
      if (!IsDue(due)) return;
      outcome.request = Plan(due);
    }
    recorder_.Add(outcome);
  }
}

// Returns once nothing more is sent. Answers call the next requests by themselves.
void Driver::RunClosed() {
  for (uint64_t i = 0; i < plan_.concurrency; ++i) {
    Request request;
    {
      MutexLock lock(mutex_);
      if (!Next(clock_.Now(), &request)) break;
    }
    request.slot = i;
    target_.Send(request);
  }
  MutexLock lock(mutex_);
  while (!Over(clock_.Now()) && target_.status().ok() && (outstanding_ > 0 || !waiting_.empty())) {
    if (waiting_.empty()) {
      answered_.WaitUntil(mutex_, PollTime());
    } else {
      SendWaiting();
    }
  }
  const absl::Time now = clock_.Now();
  for (const auto& [until, waiting] : waiting_) recorder_.AddRefusalWait(waiting.since, now);
  waiting_.clear();
}

// The first of those that wait, if it may go; a step of the time until then, if not.
void Driver::SendWaiting() {
  const absl::Time now = clock_.Now(), until = waiting_.begin()->first;
  const Waiting first = waiting_.begin()->second;
  Request request;
  const bool sends = until <= now && Next(now, &request);
  if (sends) {
    waiting_.erase(waiting_.begin());
    recorder_.AddRefusalWait(first.since, now);
    request.slot = first.slot;
  }
  mutex_.Unlock();
  if (sends) {
    target_.Send(request);
  } else {
    clock_.WaitUntil(std::min(until, now + kRefusalPoll));
  }
  mutex_.Lock();
}

void Driver::WaitForAnswers() {
  MutexLock lock(mutex_);
  // Everything has been planned by now.
  const absl::Time give_up = std::min(clock_.Now(), LastDue()) + plan_.drain;
  while (outstanding_ > 0 && clock_.Now() < give_up) answered_.WaitUntil(mutex_, PollTime());
  if (outstanding_ == 0) return;
  given_up_ = true;
  while (outstanding_ > 0) {
    // Again and again: a request on its way out may have been overlooked.
    mutex_.Unlock();
    target_.CancelAll();
    mutex_.Lock();
    if (outstanding_ > 0) answered_.WaitUntil(mutex_, PollTime());
  }
}

// Run sends the slot's next request, when its time has come.
void Driver::WaitAfterRefusal(const Outcome& outcome, absl::Time now) {
  const uint64_t slot = outcome.request.slot;
  client::Backoff& backoff = backoffs_.try_emplace(slot, client::RetryOptions()).first->second;
  waiting_.emplace(now + backoff.Next(outcome.status), Waiting{.slot = slot, .since = now});
}

void Driver::OnDone(const Outcome& outcome) {
  recorder_.Add(outcome);
  Request request;
  {
    MutexLock lock(mutex_);
    last_outcome_ = std::max(last_outcome_, outcome.received);
    --outstanding_;
    const absl::Time now = clock_.Now();
    if (plan_.mode == Mode::kOpen || !target_.status().ok() || Over(now)) {
      // Under the lock: once Run sees the last one, the driver may go.
      answered_.SignalAll();
      return;
    }
    if (IsRefusal(outcome.status)) {
      WaitAfterRefusal(outcome, now);
      answered_.SignalAll();
      return;
    }
    backoffs_.erase(outcome.request.slot);
    Next(now, &request);
    request.slot = outcome.request.slot;
  }
  target_.Send(request);
}

}  // namespace sightline::load
