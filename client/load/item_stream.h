// SPDX-License-Identifier: Apache-2.0
//
// One long-lived stream of a load test: items go out as soon as the flow control lets them
// (visibility_service.proto, "Flow control"), and wait here in order when it does not. A stream
// that ends for a reason that may pass is opened again, with back-off; what was unanswered on it
// has failed, as a load test does not repeat what it measures.
//
// One thread reads. Items are written by whoever finds that one may go: the sender, or the reader
// when an answer gives credit back. The server never stops reading, so neither waits for good.
//
// Thread safety: every method from any thread, but the destructor, which wants all others done.
//
//   ItemStream<v1::TestSegmentsRequest, v1::TestSegmentsResponse> stream(wiring, context);
//   SL_RETURN_IF_ERROR(stream.WaitUntilOpen());
//   stream.Send(request);
#ifndef SIGHTLINE_CLIENT_LOAD_ITEM_STREAM_H_
#define SIGHTLINE_CLIENT_LOAD_ITEM_STREAM_H_

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "client/lib/backoff.h"
#include "client/lib/cancellation.h"
#include "client/lib/connection.h"
#include "client/lib/convert.h"
#include "client/lib/status.h"
#include "client/load/answer.h"
#include "client/load/clock.h"
#include "client/load/request.h"
#include "core/base/mutex.h"

namespace sightline::load {

// How long a server that can be reached may take to open a stream.
inline constexpr absl::Duration kOpenTimeout = absl::Seconds(30);

// A stream of any kind, to a target.
class Lane {
 public:
  virtual ~Lane() = default;
  // OK once the first stream is open; why it cannot be, otherwise.
  virtual absl::Status WaitUntilOpen() = 0;
  // Ends everything for good, an opening and a wait for it too; before the lane goes.
  virtual void Close() = 0;
  virtual void Send(const Request& request) = 0;
  // Ends what is unanswered, as CANCELLED and given up; the lane goes on with a new stream.
  virtual void CancelAll() = 0;
  // Not OK once the lane has given up.
  virtual absl::Status status() const = 0;
};

// What the lanes of a target share.
struct LaneContext {
  Clock* clock = nullptr;
  std::function<uint64_t(const Work&)> rays;
  // Whether an answer is to be compared, and how it does: verdict and difference of the outcome.
  std::function<bool(const Work&)> is_checked;
  std::function<void(const Answer&, Outcome*)> judge;
  // What was asked, before the difference of a wrong answer.
  std::function<std::string(const Work&)> describe;
  std::function<void(const Outcome&)> on_done;
  std::function<void()> on_gone;  // The lane has given up; its status says why from then on.
  absl::Duration item_timeout = absl::ZeroDuration();  // 0: none.
  int64_t min_item_cost = 0;                           // Limits.min_item_cost_rays.
  client::RetryOptions retry;
};

template <typename Message, typename Response>
class ItemStream final : public Lane {
 public:
  using Stream = client::BidiStream<Message, Response>;
  using Reply = std::remove_cvref_t<decltype(std::declval<Response>().reply())>;

  // What the kind of stream has of its own.
  struct Wiring {
    std::function<std::unique_ptr<Stream>(const client::CallOptions&)> open;
    Message header;
    // The item, all but its id and timeout.
    std::function<Message(const Work&)> make_item;
    // An item's replies as its answer; an error is the server's mistake.
    std::function<absl::StatusOr<Answer>(const Work&, std::vector<Reply>)> decode;
  };

  ItemStream(Wiring wiring, LaneContext context)
      : wiring_(std::move(wiring)), context_(std::move(context)), reader_([this] { Run(); }) {}

  ~ItemStream() override {
    Close();
    reader_.join();
  }

  void Close() override {
    {
      MutexLock lock(mutex_);
      closed_ = true;
      if (stream_ != nullptr) stream_->Cancel();
      changed_.SignalAll();
    }
    // One that is being opened is known to its call alone.
    call_.Cancel();
  }

  absl::Status WaitUntilOpen() override {
    const absl::Duration most =
        std::min(context_.retry.give_up_after + kOpenTimeout, absl::Hours(24));
    const auto until = std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(most);
    MutexLock lock(mutex_);
    while (!opened_ && gone_.ok() && !closed_) {
      if (!changed_.WaitUntil(mutex_, until)) {
        return absl::DeadlineExceededError("the server does not open the streams of the test");
      }
    }
    if (closed_) return absl::CancelledError("the streams of the test are given up");
    return gone_;
  }

  void Send(const Request& request) override {
    absl::Status gone;
    {
      MutexLock lock(mutex_);
      gone = gone_;
      if (gone.ok()) {
        queue_.push_back(request);
        Pump();
      }
    }
    if (!gone.ok()) Finish({.request = request}, gone);
  }

  void CancelAll() override {
    std::deque<Request> waiting;
    {
      MutexLock lock(mutex_);
      waiting.swap(queue_);
      if (!in_flight_.empty() && stream_ != nullptr) {
        cancelling_ = true;
        stream_->Cancel();
      }
    }
    for (const Request& request : waiting) {
      Finish({.request = request, .given_up = true},
             absl::CancelledError("the run ended before it was sent"));
    }
  }

  absl::Status status() const override {
    MutexLock lock(mutex_);
    return gone_;
  }

 private:
  struct Flight {
    Request request;
    absl::Time sent;
    int64_t cost = 0;
    uint64_t bytes_sent = 0, bytes_received = 0;
    std::vector<Reply> replies;
  };

  // Writes what may go. One writer at a time: another comes to see its item in the queue.
  void Pump() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_) return;
    writing_ = true;
    while (opened_ && credit_ > 0 && !queue_.empty()) {
      const Request request = queue_.front();
      queue_.pop_front();
      const uint64_t id = next_id_++;
      const int64_t cost = Cost(request.work);
      credit_ -= cost;
      Stream* const stream = stream_;
      mutex_.Unlock();
      Message message = wiring_.make_item(request.work);
      message.mutable_item()->mutable_item()->set_item_id(id);
      if (context_.item_timeout > absl::ZeroDuration()) {
        client::ToProto(context_.item_timeout,
                        message.mutable_item()->mutable_item()->mutable_timeout());
      }
      const uint64_t bytes = message.ByteSizeLong();
      mutex_.Lock();
      // Before the write: the answer may be there before it returns.
      in_flight_[id] = {
          .request = request, .sent = context_.clock->Now(), .cost = cost, .bytes_sent = bytes};
      mutex_.Unlock();
      const bool written = stream->Write(message);
      mutex_.Lock();
      // The reader hears why.
      if (!written) opened_ = false;
    }
    writing_ = false;
    changed_.SignalAll();
  }

  // As client/lib/stream_runner.h counts: the bytes of these items cost less than their rays do.
  int64_t Cost(const Work& work) const {
    return std::max(static_cast<int64_t>(context_.rays(work)), context_.min_item_cost);
  }

  // The reader's thread: stream after stream, until the lane is closed or gives up.
  void Run() {
    client::Backoff backoff(context_.retry);
    absl::Time first_failure = absl::InfiniteFuture();
    while (true) {
      bool cancelled = false, was_open = false;
      const absl::Status status = RunStream(&cancelled, &was_open);
      MutexLock lock(mutex_);
      if (closed_) return;
      if (was_open) {
        backoff.Reset();
        first_failure = absl::InfiniteFuture();
      }
      if (cancelled) continue;
      const absl::Time now = context_.clock->Now();
      first_failure = std::min(first_failure, now);
      const absl::Duration wait = backoff.Next(status);
      if (!client::IsRetryable(status) ||
          now + wait > first_failure + context_.retry.give_up_after) {
        GiveUp(status);
        return;
      }
      const auto until = std::chrono::steady_clock::now() + absl::ToChronoNanoseconds(wait);
      while (!closed_ && changed_.WaitUntil(mutex_, until)) {
      }
      if (closed_) return;
    }
  }

  // One stream from its opening to its end.
  absl::Status RunStream(bool* cancelled, bool* was_open) {
    std::unique_ptr<Stream> stream = wiring_.open({.cancellation = &call_});
    {
      MutexLock lock(mutex_);
      stream_ = stream.get();
      credit_ = 0;
      if (closed_) stream->Cancel();
    }
    stream->Write(wiring_.header);
    Response response;
    while (stream->Read(&response)) Handle(&response);
    std::map<uint64_t, Flight> lost;
    {
      MutexLock lock(mutex_);
      *was_open = std::exchange(was_open_, false);
      opened_ = false;
      while (writing_) changed_.Wait(mutex_);
      stream_ = nullptr;
      *cancelled = std::exchange(cancelling_, false);
      lost.swap(in_flight_);
    }
    absl::Status status = stream->Finish();
    if (status.ok()) {
      status = absl::InternalError("the server ended a stream that was not half-closed");
    }
    for (const auto& [id, flight] : lost) {
      Outcome outcome = OutcomeOf(flight);
      outcome.given_up = *cancelled;
      Finish(std::move(outcome),
             *cancelled ? absl::CancelledError("no answer came in time") : status);
    }
    return status;
  }

  void GiveUp(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    gone_ = status;
    changed_.SignalAll();
    std::deque<Request> waiting;
    waiting.swap(queue_);
    mutex_.Unlock();
    context_.on_gone();
    for (const Request& request : waiting) Finish({.request = request}, status);
    mutex_.Lock();
  }

  void Handle(Response* response) {
    const absl::Time now = context_.clock->Now();
    if (response->has_opened()) {
      MutexLock lock(mutex_);
      opened_ = was_open_ = true;
      credit_ += response->opened().credit_rays();
      changed_.SignalAll();
      Pump();
      return;
    }
    if (response->has_draining()) {
      MutexLock lock(mutex_);
      opened_ = false;  // Later items go to the next stream.
      return;
    }
    if (!response->has_reply()) return;  // A kind of message from a later version.
    const uint64_t bytes = response->ByteSizeLong();
    Reply& reply = *response->mutable_reply();
    const bool last = reply.header().last();
    const absl::Status status = client::FromItem(reply.header().status());
    Flight flight;
    {
      MutexLock lock(mutex_);
      const auto found = in_flight_.find(reply.header().item_id());
      if (found == in_flight_.end()) return;  // Not ours: the item is told as unanswered.
      found->second.bytes_received += bytes;
      found->second.replies.push_back(std::move(reply));
      if (!last) return;
      flight = std::move(found->second);
      in_flight_.erase(found);
      credit_ += flight.cost;
      Pump();
    }
    Outcome outcome = OutcomeOf(flight);
    outcome.received = now;
    outcome.status = status;
    if (status.ok()) {
      const auto& header = flight.replies.back().header();
      outcome.rays = context_.rays(flight.request.work);
      outcome.revision = header.revision();
      outcome.server_queue =
          absl::Nanoseconds(static_cast<int64_t>(header.statistics().queue_nanos()));
      outcome.server_compute =
          absl::Nanoseconds(static_cast<int64_t>(header.statistics().compute_nanos()));
      Check(std::move(flight.replies), &outcome);
    }
    context_.on_done(outcome);
  }

  // What is not checked is not even decoded: a load test that looked at everything would measure
  // itself. What is checked and cannot be decoded is an answer all the same, and a wrong one.
  void Check(std::vector<Reply> replies, Outcome* outcome) {
    const Work& work = outcome->request.work;
    if (!context_.is_checked(work)) return;
    const absl::StatusOr<Answer> answer = wiring_.decode(work, std::move(replies));
    if (answer.ok()) {
      context_.judge(*answer, outcome);
    } else {
      outcome->verdict = Verdict::kWrong;
      outcome->difference = std::string(answer.status().message());
    }
    if (outcome->verdict != Verdict::kWrong) return;
    outcome->difference = absl::StrCat("request ", outcome->request.number, ", ",
                                       context_.describe(work), ": ", outcome->difference);
  }

  static Outcome OutcomeOf(const Flight& flight) {
    return {.request = flight.request,
            .sent = flight.sent,
            .bytes_sent = flight.bytes_sent,
            .bytes_received = flight.bytes_received};
  }

  void Finish(Outcome outcome, const absl::Status& status) {
    outcome.received = context_.clock->Now();
    outcome.status = status;
    context_.on_done(outcome);
  }

  const Wiring wiring_;
  const LaneContext context_;
  client::Cancellation call_;  // Of every stream, at the end.
  mutable Mutex mutex_;
  CondVar changed_;
  Stream* stream_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool opened_ ABSL_GUARDED_BY(mutex_) = false;    // Items may go out.
  bool was_open_ ABSL_GUARDED_BY(mutex_) = false;  // The stream got as far as that.
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelling_ ABSL_GUARDED_BY(mutex_) = false;
  int64_t credit_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t next_id_ ABSL_GUARDED_BY(mutex_) = 0;
  std::deque<Request> queue_ ABSL_GUARDED_BY(mutex_);
  std::map<uint64_t, Flight> in_flight_ ABSL_GUARDED_BY(mutex_);
  absl::Status gone_ ABSL_GUARDED_BY(mutex_);
  std::thread reader_;  // Last: it uses the others.
};

}  // namespace sightline::load

#endif  // SIGHTLINE_CLIENT_LOAD_ITEM_STREAM_H_
