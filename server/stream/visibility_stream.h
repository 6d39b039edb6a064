// SPDX-License-Identifier: Apache-2.0
//
// The one reactor behind TraceTiles, ComputeShadows and TestSegments. A Method (tile_method.h, ...)
// says what headers and items mean; everything else is here: order, credit both ways, cancelling,
// deadlines, draining. The rules it keeps are written in visibility_service.proto.
//
// Invariants
//  1. Reactions never compute: opening, decoding and answering are tasks of the scheduler, by which
//     clients and streams take turns.
//  2. At most one Write is outstanding; Finish is called exactly once, with no Write outstanding
//     and no task running. The reactor lives until OnDone and until its last task is gone.
//  3. Reading never stops while the stream is open, so that a client's writes always go through.
//     What is held is bounded by the credit: an item's credit comes back when its last reply is
//     handed to the transport.
//  4. Every accepted item gets exactly one last reply, unless the stream itself fails or is
//     cancelled.
//  5. A stream that failed reads on and throws away, since a client that is still writing must
//     reach the point where it reads the status; one that never does is cut off after
//     kMaxDiscarded messages.
//  6. A stream whose client neither takes a reply nor grants the credit for it ends after
//     max_stream_stall with DEADLINE_EXCEEDED, also one that has failed already: the rays that it
//     holds are everybody's. Any reply taken begins the time anew, and credit that is not enough
//     for one does not. Finish cannot follow a write that does not complete (2), so the call is cut
//     off, which completes the write.
//
// Thread safety: gRPC calls the reactions from its threads, tasks run on the pool's; one mutex
// guards all state, and gRPC's Start* and Finish are called with it held (completions run later).
#ifndef SIGHTLINE_SERVER_STREAM_VISIBILITY_STREAM_H_
#define SIGHTLINE_SERVER_STREAM_VISIBILITY_STREAM_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "core/base/cancel.h"
#include "core/base/check.h"
#include "core/base/hand_over.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "server/admission/call_deadline.h"
#include "server/admission/call_tracker.h"
#include "server/admission/client_name.h"
#include "server/admission/timeout_check.h"
#include "server/base/error.h"
#include "server/base/memory_guard.h"
#include "server/codec/query_codec.h"
#include "server/stream/item_report.h"
#include "server/stream/outbox.h"
#include "server/stream/query_environment.h"
#include "server/stream/stream_item.h"
#include "server/stream/stream_messages.h"
#include "server/stream/stream_method.h"

namespace sightline {

template <typename Method>
class VisibilityStream final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                               public DrainListener,
                               public std::enable_shared_from_this<VisibilityStream<Method>> {
 public:
  using Request = typename Method::Request;
  using Response = typename Method::Response;
  using Item = StreamItem<Method>;
  using ItemPtr = std::shared_ptr<Item>;
  using Clock = std::chrono::steady_clock;

  // The reactor for a new call. It deletes itself.
  static VisibilityStream* Start(grpc::CallbackServerContext* context,
                                 const QueryEnvironment& env) {
    auto stream = std::shared_ptr<VisibilityStream>(new VisibilityStream(context, env));
    stream->Begin(env.calls.Admit(stream));
    stream->begun_.Release();
    return stream.get();
  }

  void OnReadDone(bool ok) override {
    Request request;
    typename Method::Item item;
    absl::Status read;
    const size_t bytes = ok ? incoming_.Length() : 0;  // Reading empties it.
    if (ok) read = Method::Read(&incoming_, MostElements(env_.limits), &request, &item);
    MutexLock lock(mutex_);
    if (!ok) {
      half_closed_ = true;
      if (context_->IsCancelled()) Abandon();  // OnCancel comes later.
      if (!header_seen_) Fail(BadSequence("header", "the stream ended without one"));
      Advance();
      return;
    }
    if (finished_) return;
    if (!failure_.ok()) {
      if (++discarded_ > kMaxDiscarded) context_->TryCancel();
    } else if (read.ok()) {
      Receive(&request, std::move(item), bytes);
    } else {
      Fail(std::move(read));
    }
    // While the header is being opened, what comes after it waits in the transport.
    if (method_ != nullptr || !failure_.ok()) Read();
    Advance();
  }

  void OnWriteDone(bool ok) override {
    MutexLock lock(mutex_);
    writing_ = false;
    blocked_since_.reset();
    outgoing_ = {};
    if (!ok) Abandon();
    Advance();
  }

  void OnCancel() override {
    begun_.Acquire();
    MutexLock lock(mutex_);
    Abandon();
    Advance();
  }

  void OnDone() override {
    std::shared_ptr<VisibilityStream> self;  // Goes after the lock has.
    MutexLock lock(mutex_);
    self.swap(self_);
    call_.Release();
  }

  void OnDrain() override {
    MutexLock lock(mutex_);
    if (draining_ || finished_) return;
    draining_ = true;
    if (method_ != nullptr) SendDraining();
    Advance();
  }

  void EndIfStalled(Clock::time_point now) override {
    MutexLock lock(mutex_);
    const std::chrono::seconds most(env_.limits.max_stream_stall_seconds);
    if (finished_ || now - blocked_since_.value_or(now) < most) return;
    Fail(StreamStallError(env_.limits));
    if (writing_) CutOff(context_, failure_);
    Advance();
  }

 private:
  // More than any client has under way; see invariant 5.
  static constexpr uint64_t kMaxDiscarded = 1 << 16;
  static constexpr int32_t kMaxPriority = 100;
  static constexpr uint64_t kCountStride = 16;  // Every so manieth item counts what answered.

  VisibilityStream(grpc::CallbackServerContext* context, const QueryEnvironment& env)
      : context_(context),
        deadline_(*context),
        env_(env),
        timer_(env.metrics, Method::kOperation),
        credit_(static_cast<int64_t>(env.limits.stream_credit_rays)) {}

  void Begin(absl::StatusOr<ActiveCall> call) {
    MutexLock lock(mutex_);
    self_ = this->shared_from_this();
    const absl::Status admitted = call.ok() ? Enter(*std::move(call)) : call.status();
    if (admitted.ok()) return Read();
    Fail(admitted);
    Advance();
  }

  absl::Status Enter(ActiveCall call) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    call_ = std::move(call);
    const Client client = ClientOf(*context_, env_.access);
    SL_ASSIGN_OR_RETURN(share_, env_.streams.Take(client.name, client.limits.streams));
    account_ = env_.ray_queue.Open(client.name, client.limits.rays);
    flow_ = env_.scheduler.Open(client.name);
    return absl::OkStatus();
  }

  // --- Receiving ---------------------------------------------------------------------------------

  void Read() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!finished_ && !half_closed_) this->StartRead(&incoming_);
  }

  // `bytes`: of the whole message.
  void Receive(Request* request, typename Method::Item item, size_t bytes)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    switch (request->part_case()) {
      case Request::kHeader:
        if (header_seen_) return Fail(BadSequence("header", "comes once"));
        header_seen_ = true;
        return Open(std::move(*request->mutable_header()));
      case Request::kItem:
        if (method_ == nullptr) break;
        return Accept(std::move(item), bytes);
      case Request::kCancel:
        if (method_ == nullptr) break;
        return Cancel(request->cancel());
      case Request::kGrantResultCredit:
        if (method_ == nullptr) break;
        return Grant(request->grant_result_credit().rays());
      case Request::PART_NOT_SET:
        return Fail(BadSequence("part", "is required"));
    }
    Fail(BadSequence("header", "must be the first message"));
  }

  void Open(typename Method::Header header) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const int64_t result_credit = header.stream().result_credit_rays();
    if (result_credit < 0) {
      return Fail(
          InvalidField("header.stream.result_credit_rays", result_credit, "must not be negative"));
    }
    limit_results_ = result_credit > 0;
    result_credit_ = result_credit;
    flow_->Announce(1);
    flow_->Add({.negative_priority = -kMaxPriority}, 1,
               [self = this->shared_from_this(), header = std::move(header)] {
                 self->RunOpen(header);
                 return false;
               });
  }

  void RunOpen(const typename Method::Header& header) {
    {
      MutexLock lock(mutex_);
      if (!failure_.ok()) return;
      ++running_;
    }
    absl::StatusOr<std::unique_ptr<Method>> method =
        GuardMemory([&] { return Method::Open(header, env_); });
    MutexLock lock(mutex_);
    --running_;
    if (!method.ok()) {
      Fail(method.status());
    } else {
      method_ = *std::move(method);
      Send(OpenedMessage<Response>(method_->opened_revision(), credit_, method_->sample_count()),
           nullptr);
      if (draining_) SendDraining();
    }
    Read();
    Advance();
  }

  void Accept(typename Method::Item request, size_t bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const uint64_t id = request.message.item().item_id();
    if (items_.contains(id)) {
      return Fail(BadSequence("item.item_id", absl::StrCat(id, " has not been answered yet")));
    }
    if (credit_ <= 0) {
      return Fail(CreditError(id, credit_, items_.size(), env_.limits));
    }
    auto item = std::make_shared<Item>(&token_);
    item->id = id;
    item->arrival = Clock::now();
    item->sequence = next_sequence_++;
    item->cost = env_.limits.min_item_cost_rays;
    absl::Status status = Admit(request, bytes, item.get());
    credit_ -= static_cast<int64_t>(item->cost);
    items_.emplace(id, item);
    if (!status.ok()) {
      item->tasks_left = 0;
      item->status = std::move(status);
      return Close(item);
    }
    ++accepted_;
    last_accepted_ = id;
    item->request = std::move(request);
    flow_->Announce(item->cost);
    item->to_come = item->cost;
    AddTask(item, 0, std::min(item->cost, flow_->PartRays()));
  }

  // Whether the item may wait for its turn; sets its cost, priority and deadline.
  absl::Status Admit(const typename Method::Item& request, size_t bytes, Item* item)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (draining_) return DrainingError();
    const v1::ItemHeader& header = request.message.item();
    if (header.priority() < -kMaxPriority || header.priority() > kMaxPriority) {
      return InvalidField("item.priority", header.priority(), "must be -100 .. 100");
    }
    item->priority = header.priority();
    SL_ASSIGN_OR_RETURN(const absl::Duration timeout,
                        DecodeDuration("item.timeout", header.has_timeout(), header.timeout(),
                                       absl::InfiniteDuration(), absl::InfiniteDuration()));
    const uint64_t rays = method_->Rays(request);
    SL_RETURN_IF_ERROR(CheckItemRays(rays, env_.limits));
    item->cost = ItemCost(rays, bytes, env_.limits);
    if (timeout < kLongestTimeout) {
      SL_RETURN_IF_ERROR(CheckTimeout(timeout, flow_->Foresee(item->cost)));
    }
    absl::StatusOr<RayTicket> ticket = env_.ray_queue.Admit(account_, item->cost);
    if (!ticket.ok()) {
      // By then the server will have answered about as much as this item asks for.
      return WithRetryDelay(ticket.status(), absl::FromChrono(env_.scheduler.TimeFor(item->cost)));
    }
    item->ticket = *std::move(ticket);
    if (timeout < kLongestTimeout) SetDeadline(item, timeout);
    return absl::OkStatus();
  }

  void SetDeadline(Item* item, absl::Duration timeout) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    item->SetDeadline(timeout, [weak = this->weak_from_this(), id = item->id,
                                sequence = item->sequence](bool fired) {
      if (!fired) return;
      if (auto self = weak.lock()) self->Expire(id, sequence);
    });
  }

  void Expire(uint64_t id, uint64_t sequence) {
    MutexLock lock(mutex_);
    const auto found = items_.find(id);
    if (found == items_.end() || found->second->sequence != sequence) return;
    const ItemPtr item = found->second;
    Stop(item, ItemExpiredError(id));
    Advance();
  }

  void Cancel(const v1::CancelItems& cancel) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto ids = static_cast<uint64_t>(cancel.item_ids_size());
    const absl::Status few = CheckCancelled(ids, env_.limits);
    if (!few.ok()) return Fail(few);
    std::vector<ItemPtr> named;
    if (cancel.item_ids().empty()) {
      for (const auto& [id, item] : items_) named.push_back(item);
    }
    for (const uint64_t id : cancel.item_ids()) {
      if (const auto found = items_.find(id); found != items_.end()) named.push_back(found->second);
    }
    for (const ItemPtr& item : named) Stop(item, ItemCancelledError(item->id));
  }

  void Grant(int64_t rays) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    constexpr int64_t kMost = int64_t{1} << 60;
    if (rays <= 0) {
      return Fail(InvalidField("grant_result_credit.rays", rays, "must be positive"));
    }
    result_credit_ = std::min(kMost, result_credit_) + std::min(kMost, rays);
  }

  // Ends an item early, once: what waits is dropped, what runs sees the token.
  void Stop(const ItemPtr& item, const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (item->closed || !item->status.ok()) return;
    item->token.Cancel();
    item->status = status;
    DropWaiting(item);
    if (item->tasks_left == 0) Close(item);
  }

  void DropWaiting(const ItemPtr& item) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    item->tasks_left -= flow_->Drop(-item->priority, item->sequence);
  }

  // --- Computing ---------------------------------------------------------------------------------

  // Part 0 is the preparation, together with the first part; k + 1 is part k.
  void AddTask(const ItemPtr& item, uint64_t part, uint64_t rays)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    item->to_come -= rays;
    flow_->Add(item->Key(part), rays,
               [self = this->shared_from_this(), item, part] { return self->RunTask(item, part); });
  }

  // Whether the work was done.
  bool RunTask(const ItemPtr& item, uint64_t part) {
    {
      MutexLock lock(mutex_);
      if (!failure_.ok() || finished_) return false;
      ++running_;
      item->Begin();
    }
    const bool done = part == 0 ? Prepare(item) : Compute(item, part - 1);
    MutexLock lock(mutex_);
    --running_;
    Advance();
    return done;
  }

  bool Prepare(const ItemPtr& item) {
    absl::Status status = item->token.ToStatus();
    std::unique_ptr<ItemWork> work;
    if (status.ok()) {
      auto prepared = GuardMemory([&] {
        return method_->Prepare(std::move(item->request), item->token, flow_->PartRays());
      });
      status = prepared.status();
      if (status.ok()) work = *std::move(prepared);
    }
    item->request = {};
    {
      MutexLock lock(mutex_);
      if (!failure_.ok()) return false;
      if (!status.ok() || !item->status.ok()) return FinishTask(item, status);
      item->work = std::move(work);
      if (method_->statistics() || item->sequence % kCountStride == 0) item->work->CountAnswers();
      AddParts(item);
    }
    return Compute(item, 0);
  }

  // The first part follows at once on the thread that prepared; the others wait for their turns.
  void AddParts(const ItemPtr& item) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const std::vector<PartRange>& parts = item->work->parts();
    item->tasks_left = parts.size();
    item->replies_left = item->work->replies();
    const uint64_t elements = parts.back().offset + parts.back().count;
    const auto rays = [&](size_t part) {
      return std::max<uint64_t>(1, item->cost / elements * parts[part].count);
    };
    uint64_t planned = 0;
    for (size_t part = 1; part < parts.size(); ++part) planned += rays(part);
    flow_->Withdraw(std::exchange(item->to_come, planned));
    flow_->Announce(planned);
    for (size_t part = 1; part < parts.size(); ++part) AddTask(item, part + 1, rays(part));
  }

  bool Compute(const ItemPtr& item, size_t part) {
    ItemReply reply;
    QueryStats stats;
    absl::StatusOr<PartRange> answered = PartRange();
    if (const absl::Status status = item->token.ToStatus(); !status.ok()) {
      answered = status;
    } else {
      answered =
          GuardMemory([&] { return item->work->RunPart(part, item->token, &reply, &stats); });
    }
    MutexLock lock(mutex_);
    if (!answered.ok() || !item->status.ok()) return FinishTask(item, answered.status());
    item->stats.Add(stats);
    if (answered->count > 0) {
      if (--item->replies_left == 0) {
        item->last = std::move(reply);
        item->last_range = *answered;
      } else {
        Send({ReplyBytes(HeaderOf(*item, *answered), std::move(reply)), true}, nullptr);
      }
    }
    if (--item->tasks_left > 0) return true;
    SIGHTLINE_CHECK(item->last.has_value()) << "the parts are done, and not all replies are filled";
    item->work->Complete(&*item->last);
    Close(item);
    return true;
  }

  bool FinishTask(const ItemPtr& item, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const bool done = status.ok() && item->status.ok();
    --item->tasks_left;
    if (!status.ok() && item->status.ok()) {
      item->status = status;
      item->token.Cancel();  // The other parts are void.
      DropWaiting(item);
    }
    if (item->tasks_left == 0 && !item->status.ok()) Close(item);
    return done;
  }

  // --- Answering ---------------------------------------------------------------------------------

  // Puts the item's last reply into the outbox, or its status if that is an error.
  void Close(const ItemPtr& item) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (item->closed) return;
    item->closed = true;
    flow_->Withdraw(std::exchange(item->to_come, 0));
    if (!item->status.ok()) {
      item->last = ItemReply();
      item->last_range = {};
    }
    const v1::ReplyHeader header = LastHeaderOf(*item, method_->statistics());
    ReportItem(env_, *context_, *method_, *item);
    item->work.reset();
    item->deadline_alarm.reset();
    Send({ReplyBytes(header, *std::exchange(item->last, std::nullopt)), true}, item);
  }

  void SendDraining() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    Send(DrainingMessage<Response>(accepted_, last_accepted_), nullptr);
  }

  void Send(OutgoingMessage message, ItemPtr last_of) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!failure_.ok()) return;
    outbox_.Push(std::move(message), std::move(last_of));
    HoldBack();
  }

  // The answers of a client that does not read stay uncomputed.
  void HoldBack() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const bool hold = outbox_.full();
    if (hold != std::exchange(held_, hold)) flow_->Hold(hold);
  }

  void Abandon() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    cancelled_ = true;
    Fail(deadline_.Ends() ? CallExpiredError() : CallCancelledError());
  }

  void Fail(absl::Status status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!failure_.ok() || finished_) return;
    failure_ = std::move(status);
    token_.Cancel();
    for (const auto& [id, item] : items_) flow_->Withdraw(std::exchange(item->to_come, 0));
    if (flow_ != nullptr) flow_->Clear();
    outbox_.Clear();
    if (!cancelled_ && !absl::IsCancelled(failure_)) LogFailure(context_->peer(), failure_);
  }

  // Does whatever can be done next. Called at the end of every reaction and task.
  void Advance() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (finished_) return;
    if (failure_.ok()) Write();
    if (writing_ || running_ > 0) return;
    if (!failure_.ok() || cancelled_) return End(failure_);
    if (!items_.empty() || !outbox_.empty()) return;
    if (half_closed_) return End(absl::OkStatus());
    if (draining_ && (method_ != nullptr || !header_seen_)) return End(DrainingError());
  }

  void Write() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_ || outbox_.empty() || cancelled_) return;
    if (outbox_.first().is_reply && limit_results_ && result_credit_ <= 0) {
      if (!blocked_since_.has_value()) blocked_since_ = Clock::now();
      return;
    }
    ItemPtr item;
    std::tie(outgoing_, item) = outbox_.Pop();
    writing_ = true;
    blocked_since_ = Clock::now();
    if (item != nullptr) {
      // Before the write: the client may answer the reply before we hear that it went out.
      credit_ += static_cast<int64_t>(item->cost);
      if (limit_results_) result_credit_ -= static_cast<int64_t>(item->cost);
      item->ticket.Release();
      items_.erase(item->id);
    }
    HoldBack();
    this->StartWrite(&outgoing_.bytes);
  }

  void End(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    finished_ = true;
    if (method_ != nullptr) ReportLost(env_, *context_, *method_, items_, failure_);
    // One that was not opened counts itself, since no item ever will.
    if (method_ == nullptr && !status.ok()) timer_.Record(status.code());
    // All before the client hears of it, who may open the next at once; a last task may have items.
    for (const auto& [id, item] : items_) item->ticket.Release();
    items_.clear();
    share_.Release();
    this->Finish(ToGrpcStatus(status));
  }

  grpc::CallbackServerContext* const context_;
  const CallDeadline deadline_;
  const QueryEnvironment env_;
  const CallTimer timer_;
  grpc::ByteBuffer incoming_;  // Written by gRPC between StartRead and OnReadDone.
  CancelToken token_;          // Parent of every item's.

  HandOver begun_;  // gRPC knows the stream before it says that it was cancelled.
  Mutex mutex_;
  std::shared_ptr<VisibilityStream> self_ ABSL_GUARDED_BY(mutex_);
  ActiveCall call_ ABSL_GUARDED_BY(mutex_);
  CallShare share_ ABSL_GUARDED_BY(mutex_);
  // Set once, before the first message is read; null for a call that was refused.
  RayAccount account_;
  std::unique_ptr<Scheduler::Flow> flow_;
  std::unique_ptr<Method> method_;  // Set once, before items; their tasks read it without the lock.
  bool header_seen_ ABSL_GUARDED_BY(mutex_) = false;
  bool half_closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status failure_ ABSL_GUARDED_BY(mutex_);
  uint64_t discarded_ ABSL_GUARDED_BY(mutex_) = 0;
  std::unordered_map<uint64_t, ItemPtr> items_ ABSL_GUARDED_BY(mutex_);  // Unanswered, by id.
  int running_ ABSL_GUARDED_BY(mutex_) = 0;                              // Tasks.
  Outbox<ItemPtr> outbox_ ABSL_GUARDED_BY(mutex_);  // Due: the item whose last it is.
  bool held_ ABSL_GUARDED_BY(mutex_) = false;       // Nothing is computed until something is read.
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  OutgoingMessage outgoing_ ABSL_GUARDED_BY(mutex_);  // While it is written.
  // While a write is outstanding, or the first reply waits for result credit.
  std::optional<Clock::time_point> blocked_since_ ABSL_GUARDED_BY(mutex_);
  int64_t credit_ ABSL_GUARDED_BY(mutex_);
  bool limit_results_ ABSL_GUARDED_BY(mutex_) = false;
  int64_t result_credit_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t next_sequence_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t accepted_ ABSL_GUARDED_BY(mutex_) = 0;
  uint64_t last_accepted_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_VISIBILITY_STREAM_H_
