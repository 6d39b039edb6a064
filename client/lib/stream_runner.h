// SPDX-License-Identifier: Apache-2.0
//
// Gets every item of a query answered over a few bidirectional streams, whatever happens to them.
//
// Each lane owns one stream at a time: one thread reads it, another writes. Items wait in one
// shared queue; a lane takes the next while its credit is above zero, and an item's last reply
// gives its cost back. A lane never waits for anything while it must read, so neither side can
// block the other for good (visibility_service.proto, "Flow control").
//
// Items go back into the queue when their stream ends without an answer (a draining server, a lost
// connection) or when the server's queue was full; the lane then opens a new stream after a
// back-off. The run fails with the first error that cannot heal, or once nothing has been answered
// for RetryOptions.give_up_after since the first failure. Replies of an item are handed out whole,
// when its last one is there: an answer that was cut off leaves nothing behind.
//
// Where memory runs out in `make_item` or `deliver` the run fails with RESOURCE_EXHAUSTED.
//
// Thread safety: RunStreams blocks its caller; `deliver` is called from lane threads, one call at a
// time, never after RunStreams has returned.
#ifndef SIGHTLINE_CLIENT_LIB_STREAM_RUNNER_H_
#define SIGHTLINE_CLIENT_LIB_STREAM_RUNNER_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "client/lib/backoff.h"
#include "client/lib/cancellation.h"
#include "client/lib/connection.h"
#include "client/lib/memory_guard.h"
#include "client/lib/mutex.h"
#include "client/lib/status.h"

namespace sightline::client {

template <typename Request, typename Response>
struct StreamJob {
  using Reply = std::remove_cvref_t<decltype(std::declval<Response>().reply())>;

  size_t item_count = 0;
  Request header;
  // A new stream of lane `lane`, not yet written to.
  std::function<std::unique_ptr<BidiStream<Request, Response>>(int lane, const CallOptions&)> open;
  std::function<Request(size_t item)> make_item;  // With the item's number as its id.
  std::function<int64_t(size_t item)> cost;       // In rays, before the minimum.
  // An item's replies in order of offset, all OK. An error ends the run.
  std::function<absl::Status(size_t item, std::vector<Reply> replies)> deliver;
};

struct RunOptions {
  int lanes = 1;
  int64_t min_item_cost = 0;  // Limits.min_item_cost_rays.
  absl::Time deadline = absl::InfiniteFuture();
  Cancellation* cancellation = nullptr;
  RetryOptions retry;
};

struct RunTotals {
  uint64_t bytes_received = 0;
  uint64_t bytes_sent = 0;
  uint64_t resent_items = 0;
};

template <typename Request, typename Response>
class StreamRun {
 public:
  using Job = StreamJob<Request, Response>;
  using Stream = BidiStream<Request, Response>;
  using Reply = typename Job::Reply;

  StreamRun(const Job& job, const RunOptions& options) : job_(job), options_(options) {
    for (size_t i = 0; i < job.item_count; ++i) queue_.push_back({i, absl::InfinitePast()});
  }

  absl::Status Run(RunTotals* totals) {
    {
      Cancellation::Registration registration(options_.cancellation, [this] {
        MutexLock lock(&mutex_);
        Fail(absl::CancelledError("cancelled by the caller"));
      });
      std::vector<std::thread> lanes;
      for (int i = 1; i < options_.lanes; ++i) {
        lanes.emplace_back([this, i] { RunLane(i); });
      }
      RunLane(0);
      for (std::thread& lane : lanes) lane.join();
    }
    MutexLock lock(&mutex_);
    *totals = totals_;
    return error_;
  }

 private:
  struct Waiting {
    size_t item;
    absl::Time not_before;
  };
  // What one stream of a lane is doing.
  struct Session {
    Cancellation call;         // Of the stream's call, also while that is being opened.
    Stream* stream = nullptr;  // Null until then.
    bool opened = false;
    bool closed = false;  // No more writes: it ended, or is about to.
    int64_t credit = 0;
    uint64_t answered = 0;
    std::map<uint64_t, std::vector<Reply>> in_flight;  // Replies so far, by item.
  };

  // Opens streams until everything is answered or the run has failed.
  void RunLane(int lane) {
    Backoff backoff(options_.retry);
    while (WaitForWork()) {
      Session session;
      const absl::Status status = RunSession(lane, &session);
      MutexLock lock(&mutex_);
      for (auto it = session.in_flight.rbegin(); it != session.in_flight.rend(); ++it) {
        queue_.push_front({static_cast<size_t>(it->first), absl::InfinitePast()});
        ++totals_.resent_items;
      }
      if (Finished()) return;
      if (session.answered > 0) backoff.Reset();
      if (status.ok()) {
        Fail(absl::InternalError("the server ended a stream before it had answered every item"));
        return;
      }
      if (!IsRetryable(status)) {
        Fail(status);
        return;
      }
      const absl::Duration left = TimeLeft();
      const absl::Duration wait = backoff.Next(status, left);
      if (!MayRetry(status, wait, left)) return;
      WaitUntil(absl::Now() + wait);
    }
  }

  // True when there is an item to send; false when the run is over.
  bool WaitForWork() {
    MutexLock lock(&mutex_);
    const auto ready = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return Finished() || !queue_.empty();
    };
    if (!mutex_.AwaitWithDeadline(absl::Condition(&ready), options_.deadline)) Expire();
    return !Finished();
  }

  absl::Status RunSession(int lane, Session* session) {
    {
      MutexLock lock(&mutex_);
      sessions_.push_back(session);
      if (Finished()) session->call.Cancel();
    }
    // May take as long as a connection to come about.
    std::unique_ptr<Stream> stream =
        job_.open(lane, {.deadline = options_.deadline, .cancellation = &session->call});
    {
      MutexLock lock(&mutex_);
      session->stream = stream.get();
      if (Finished()) stream->Cancel();
    }
    std::thread writer([this, session, &stream] { WriteItems(session, stream.get()); });
    Response response;
    absl::Status broken;
    while (stream->Read(&response)) {
      if (!broken.ok()) continue;  // Cancelled; only draining what is left.
      broken = Handle(session, &response);
      if (!broken.ok()) stream->Cancel();
    }
    {
      MutexLock lock(&mutex_);
      session->closed = true;
    }
    writer.join();
    {
      MutexLock lock(&mutex_);
      std::erase(sessions_, session);
    }
    const absl::Status status = stream->Finish();
    return broken.ok() ? status : broken;
  }

  // The writer's thread: the header, then items as credit and queue allow.
  void WriteItems(Session* session, Stream* stream) {
    if (!stream->Write(job_.header)) return;
    while (true) {
      size_t item = 0;
      {
        MutexLock lock(&mutex_);
        if (!TakeItem(session, &item)) break;
      }
      const absl::StatusOr<Request> request =
          GuardMemory([&]() -> absl::StatusOr<Request> { return job_.make_item(item); });
      if (!request.ok()) {
        MutexLock lock(&mutex_);
        Fail(request.status());
        return;
      }
      if (!stream->Write(*request)) return;
      MutexLock lock(&mutex_);
      totals_.bytes_sent += request->ByteSizeLong();
    }
    stream->WritesDone();
  }

  // Waits for an item that may be sent now. False when this stream will send no more.
  bool TakeItem(Session* session, size_t* item) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    while (true) {
      const auto may_act = [this, session]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
        return Finished() || session->closed ||
               (session->opened && session->credit > 0 && !queue_.empty());
      };
      mutex_.Await(absl::Condition(&may_act));
      if (Finished() || session->closed) return false;
      // Items that came back with a wait of their own stand behind those that may go at once.
      const absl::Time now = absl::Now();
      const auto ready = std::find_if(queue_.begin(), queue_.end(),
                                      [now](const Waiting& w) { return w.not_before <= now; });
      if (ready == queue_.end()) {
        absl::Time next = absl::InfiniteFuture();
        for (const Waiting& w : queue_) next = std::min(next, w.not_before);
        const auto changed = [this, session, size = queue_.size()]()
                                 ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                                   return Finished() || session->closed || queue_.size() != size;
                                 };
        mutex_.AwaitWithDeadline(absl::Condition(&changed), next);
        continue;
      }
      *item = ready->item;
      queue_.erase(ready);
      session->credit -= Cost(*item);
      session->in_flight.emplace(*item, std::vector<Reply>());
      return true;
    }
  }

  // A server counts an item's bytes as well, 64 to a ray: what this library sends has fewer.
  int64_t Cost(size_t item) const { return std::max(job_.cost(item), options_.min_item_cost); }

  // One message from the server. An error makes the stream useless.
  absl::Status Handle(Session* session, Response* response) {
    if (response->has_opened()) {
      MutexLock lock(&mutex_);
      session->opened = true;
      session->credit += response->opened().credit_rays();
      return absl::OkStatus();
    }
    if (response->has_draining()) {
      // What was sent and not accepted gets its own UNAVAILABLE; nothing more is sent here.
      MutexLock lock(&mutex_);
      session->closed = true;
      return absl::OkStatus();
    }
    if (!response->has_reply()) return absl::OkStatus();  // A kind of message from a later version.
    const uint64_t id = response->reply().header().item_id();
    const bool last = response->reply().header().last();
    absl::Status item_status = FromItem(response->reply().header().status());
    std::vector<Reply> replies;
    {
      MutexLock lock(&mutex_);
      totals_.bytes_received += response->ByteSizeLong();
      const auto found = session->in_flight.find(id);
      if (found == session->in_flight.end()) {
        return absl::InternalError(
            absl::StrCat("the server answered item ", id, ", which it was not asked"));
      }
      found->second.push_back(std::move(*response->mutable_reply()));
      if (!last && item_status.ok()) return absl::OkStatus();
      replies = std::move(found->second);
      session->in_flight.erase(found);
      session->credit += Cost(static_cast<size_t>(id));
      if (!item_status.ok()) {
        Requeue(static_cast<size_t>(id), item_status);
        return absl::OkStatus();
      }
    }
    absl::Status delivered;
    {
      MutexLock lock(&deliver_mutex_);
      // Another lane may wait here with its item while one finds that the caller has had enough.
      if (delivery_.ok()) {
        delivery_ =
            GuardMemory([&] { return job_.deliver(static_cast<size_t>(id), std::move(replies)); });
      }
      delivered = delivery_;
    }
    MutexLock lock(&mutex_);
    if (!delivered.ok()) {
      Fail(delivered);
      return absl::OkStatus();
    }
    ++session->answered;
    ++finished_;
    if (Finished()) {
      // Streams end by themselves; those that are not there yet are needed no more.
      for (Session* other : sessions_) {
        if (other->stream == nullptr) other->call.Cancel();
      }
    }
    first_failure_ = absl::InfiniteFuture();
    item_backoff_.Reset();
    refused_until_ = absl::InfinitePast();
    return absl::OkStatus();
  }

  void Requeue(size_t item, const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!IsRetryable(status)) {
      Fail(status);
      return;
    }
    // A full queue refuses many items at once: together they are one failure.
    const absl::Time now = absl::Now();
    const bool known = now < refused_until_;
    const absl::Duration left = TimeLeft();
    const absl::Duration wait =
        known ? item_backoff_.Again(status, left) : item_backoff_.Next(status, left);
    if (!MayRetry(status, wait, left)) return;
    if (!known) refused_until_ = now + wait;
    queue_.push_back({item, now + wait});
    ++totals_.resent_items;
  }

  // From a failure that comes now until the run is given up, if nothing is answered before.
  absl::Duration TimeLeft() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const absl::Time now = absl::Now();
    first_failure_ = std::min(first_failure_, now);
    return first_failure_ + options_.retry.give_up_after - now;
  }

  // Whether the run goes on after a failure that may heal, when it has waited so long of the time
  // that is left; fails it otherwise.
  bool MayRetry(const absl::Status& status, absl::Duration wait, absl::Duration left)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (left > absl::ZeroDuration() && wait <= left && absl::Now() + wait < options_.deadline) {
      return true;
    }
    Fail(status);
    return false;
  }

  void WaitUntil(absl::Time time) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto over = [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return Finished(); };
    mutex_.AwaitWithDeadline(absl::Condition(&over), time);
  }

  bool Finished() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    return !error_.ok() || finished_ == job_.item_count;
  }
  void Expire() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Fail(absl::DeadlineExceededError("the query's deadline passed"));
  }
  // Ends the run; the first error is the one that is told.
  void Fail(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!error_.ok()) return;
    error_ = status;
    for (Session* session : sessions_) {
      session->call.Cancel();
      if (session->stream != nullptr) session->stream->Cancel();
    }
  }

  const Job& job_;
  const RunOptions options_;
  Mutex deliver_mutex_;
  absl::Status delivery_ ABSL_GUARDED_BY(deliver_mutex_);  // After an error nothing is delivered.
  Mutex mutex_ ABSL_ACQUIRED_AFTER(deliver_mutex_);
  std::deque<Waiting> queue_ ABSL_GUARDED_BY(mutex_);
  std::vector<Session*> sessions_ ABSL_GUARDED_BY(mutex_);
  size_t finished_ ABSL_GUARDED_BY(mutex_) = 0;
  absl::Status error_ ABSL_GUARDED_BY(mutex_);
  absl::Time first_failure_ ABSL_GUARDED_BY(mutex_) = absl::InfiniteFuture();
  Backoff item_backoff_ ABSL_GUARDED_BY(mutex_){options_.retry};
  // When the first of the items that were refused together goes again.
  absl::Time refused_until_ ABSL_GUARDED_BY(mutex_) = absl::InfinitePast();
  RunTotals totals_ ABSL_GUARDED_BY(mutex_);
};

template <typename Request, typename Response>
absl::Status RunStreams(const StreamJob<Request, Response>& job, const RunOptions& options,
                        RunTotals* totals) {
  if (job.item_count == 0) {
    *totals = {};
    return absl::OkStatus();
  }
  return StreamRun<Request, Response>(job, options).Run(totals);
}

}  // namespace sightline::client

#endif  // SIGHTLINE_CLIENT_LIB_STREAM_RUNNER_H_
