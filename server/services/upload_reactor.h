// SPDX-License-Identifier: Apache-2.0
//
// The reactor behind the three client-streamed creations. An Upload (scene_upload.h,
// point_upload.h) takes the messages; a Job says what to do before, when the header is known, and
// after, when everything has arrived (upload_job.h).
//
// Invariants
//  1. Reactions parse a message, and never compute: taking it in is a task of the call pool, and so
//     is freeing what has arrived; making something of it is one of the build pool. What has to
//     wait for its turn elsewhere holds no thread of either meanwhile.
//  2. One message is in memory beside what the upload holds, without the fields that this server
//     does not know, of which two bytes would become seventy (wire_request.h).
//  3. Finish is called exactly once, with no task running, nor anything elsewhere; the job's cancel
//     token fires when the client goes away.
//  4. What has arrived counts against its client's bytes, and against the memory budget (the
//     job's), until it is freed; that, and giving back the client's shares, comes before the client
//     hears of the call's end: one that sends upload after upload never has two at once.
//  5. An upload whose client keeps the server waiting for max_upload_idle ends with
//     DEADLINE_EXCEEDED; what a message brings makes up for some of the wait (idle_clock.h).
//
// Thread safety: as visibility_stream.h.
#ifndef SIGHTLINE_SERVER_SERVICES_UPLOAD_REACTOR_H_
#define SIGHTLINE_SERVER_SERVICES_UPLOAD_REACTOR_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>

#include "absl/functional/any_invocable.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/base/hand_over.h"
#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "core/base/status_macros.h"
#include "server/admission/call_deadline.h"
#include "server/admission/call_quota.h"
#include "server/admission/call_tracker.h"
#include "server/admission/client_name.h"
#include "server/admission/idle_clock.h"
#include "server/admission/upload_slots.h"
#include "server/base/error.h"
#include "server/base/memory_guard.h"
#include "server/codec/wire_request.h"
#include "server/metrics/metrics.h"
#include "server/stream/item_reply.h"
#include "server/stream/query_environment.h"

namespace sightline {

// DEADLINE_EXCEEDED: nothing has come of an upload for so many seconds.
absl::Status UploadIdleError(uint64_t max_upload_idle_seconds);

// Work that takes its turns elsewhere than on these pools: it begins when it is called, and calls
// `resume` once, from any thread, when it has ended. Null: there is none.
using WorkElsewhere = absl::AnyInvocable<void(absl::AnyInvocable<void()> resume)>;

// Job must have:
//   using Request, Response;
//   static constexpr Operation kOperation;
//   Job(const QueryEnvironment&, const Client&);
//   static uint64_t BytesOf(const Request&);    // What the job will hold of it; 0: nothing.
//   absl::Status Add(const Request&);           // One message, in order.
//   bool answered() const;                      // The response is known before the upload's end.
//   // Everything has arrived. What is returned runs before Finish is called; it ends soon once the
//   // token has fired.
//   absl::StatusOr<WorkElsewhere> Prepare(const CancelToken&);
//   absl::Status Finish(const CancelToken&, Response*);
template <typename Job>
class UploadReactor final : public grpc::ServerReadReactor<grpc::ByteBuffer>,
                            public WaitingUpload,
                            public std::enable_shared_from_this<UploadReactor<Job>> {
 public:
  using Request = typename Job::Request;
  using Response = typename Job::Response;

  static UploadReactor* Start(const grpc::CallbackServerContext& context,
                              grpc::ByteBuffer* response, const QueryEnvironment& env,
                              UploadSlots& slots) {
    const Client client = ClientOf(context, env.access);
    std::shared_ptr<UploadReactor> reactor(new UploadReactor(context, response, env, client));
    reactor->Begin(client, env, slots);
    reactor->begun_.Release();
    return reactor.get();
  }

  void OnReadDone(bool ok) override {
    const size_t bytes = ok ? incoming_.Length() : 0;  // Reading empties it.
    absl::Status read;
    if (ok) {
      read = GuardMemory([&] { return ReadRequest(&incoming_, {}, AnyNumber(), &request_, {}); });
    }
    MutexLock lock(mutex_);
    if (ended_) return;  // It was idle for too long, or cancelled.
    idle_.Arrived(IdleClock::Now(), ok && read.ok() ? Job::BytesOf(request_) : 0);
    // A call that is cancelled has no more messages: it is not one whose client has sent them all.
    if (!ok && context_.IsCancelled()) deadline_.Fire(&cancel_);
    if (cancel_.cancelled()) return End(cancel_.ToStatus());
    if (!read.ok()) return End(read);
    if (ok) {
      const absl::Status room = bytes_.Add(bytes, most_bytes_);
      if (!room.ok()) return End(room);
    }
    ++running_;
    if (ok) {
      call_pool_.Submit([self = this->shared_from_this()] { self->Receive(); });
    } else {
      build_pool_.Submit([self = this->shared_from_this()] { self->Complete(); });
    }
  }

  void OnCancel() override {
    begun_.Acquire();
    MutexLock lock(mutex_);
    deadline_.Fire(&cancel_);
    if (running_ == 0) End(cancel_.ToStatus());
  }

  void EndIfIdle(IdleClock::Time now) override {
    MutexLock lock(mutex_);
    if (idle_.Idle(now) >= std::chrono::seconds(most_idle_seconds_)) {
      End(UploadIdleError(most_idle_seconds_));
    }
  }

  void OnDone() override {
    std::shared_ptr<UploadReactor> self;  // Goes after the lock has.
    MutexLock lock(mutex_);
    self.swap(self_);
    call_.Release();  // The server may go now.
  }

 private:
  // The repeated fields of uploads are of numbers, which take no more than their bytes.
  static ElementLimit AnyNumber() { return {std::numeric_limits<uint64_t>::max()}; }

  UploadReactor(const grpc::CallbackServerContext& context, grpc::ByteBuffer* response,
                const QueryEnvironment& env, const Client& client)
      : told_response_(response),
        context_(context),
        deadline_(context),
        call_pool_(env.call_pool),
        build_pool_(env.build_pool),
        timer_(env.metrics, Job::kOperation),
        most_bytes_(client.limits.upload_bytes),
        most_idle_seconds_(env.limits.max_upload_idle_seconds),
        job_(std::make_unique<Job>(env, client)) {}

  void Begin(const Client& client, const QueryEnvironment& env, UploadSlots& slots) {
    MutexLock lock(mutex_);
    self_ = this->shared_from_this();
    const absl::Status admitted = Enter(client, env, slots);
    if (admitted.ok()) return Read();
    ended_ = true;
    job_.reset();  // It holds nothing yet.
    Tell(admitted);
  }
  absl::Status Enter(const Client& client, const QueryEnvironment& env, UploadSlots& slots)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    SL_ASSIGN_OR_RETURN(call_, env.calls.Admit());
    SL_ASSIGN_OR_RETURN(share_, env.uploads.Take(client.name, client.limits.uploads));
    SL_ASSIGN_OR_RETURN(bytes_, env.upload_bytes.Take(client.name, most_bytes_, /*amount=*/0));
    SL_ASSIGN_OR_RETURN(slot_, slots.Take(this->weak_from_this()));
    return absl::OkStatus();
  }

  void Read() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    idle_.Wait(IdleClock::Now());
    this->StartRead(&incoming_);
  }

  void Receive() {
    absl::Status status = GuardMemory([&] { return job_->Add(request_); });
    const bool answered = status.ok() && job_->answered();
    if (answered) status = FinishJob();
    if (cancel_.cancelled()) status = cancel_.ToStatus();
    if (!status.ok() || answered) return EndTask(status);
    MutexLock lock(mutex_);
    --running_;
    if (cancel_.cancelled()) return End(cancel_.ToStatus());
    Read();
  }
  void Complete() {
    absl::StatusOr<WorkElsewhere> work = GuardMemory([&] { return job_->Prepare(cancel_); });
    if (!work.ok()) return EndTask(work.status());
    if (*work == nullptr) return EndTask(FinishJob());
    (*work)([self = this->shared_from_this()] {
      self->build_pool_.Submit([self] { self->EndTask(self->FinishJob()); });
    });
  }
  absl::Status FinishJob() {
    return GuardMemory([&] { return job_->Finish(cancel_, &response_); });
  }
  // What a task says at the end of the upload; no read is under way.
  void EndTask(const absl::Status& status) {
    job_.reset();
    request_ = Request();
    MutexLock lock(mutex_);
    --running_;
    ended_ = true;
    Tell(status);
  }
  // The same in a reaction, with no task running; a read may be under way.
  void End(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (std::exchange(ended_, true)) return;
    call_pool_.Submit([self = this->shared_from_this(), status] {
      self->job_.reset();
      MutexLock lock(self->mutex_);
      self->Tell(status);
    });
  }
  void Tell(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    slot_.Release();
    share_.Release();
    bytes_.Release();
    timer_.Record(status.code());
    if (status.ok()) *told_response_ = MessageBytes(response_);
    this->Finish(ToGrpcStatus(status));
  }

  grpc::ByteBuffer* const told_response_;  // gRPC's; set before Finish with OK.
  const grpc::CallbackServerContext& context_;
  const CallDeadline deadline_;
  ThreadPool& call_pool_;
  ThreadPool& build_pool_;
  const CallTimer timer_;
  const uint64_t most_bytes_;  // Of the client's uploads together; 0: any number.
  const uint64_t most_idle_seconds_;
  std::unique_ptr<Job> job_;   // Used by one task at a time; null once it is done with.
  grpc::ByteBuffer incoming_;  // Written by gRPC between StartRead and OnReadDone.
  Request request_;
  Response response_;
  CancelToken cancel_;

  HandOver begun_;  // gRPC knows the call before it says that it was cancelled.
  Mutex mutex_;
  std::shared_ptr<UploadReactor> self_ ABSL_GUARDED_BY(mutex_);
  ActiveCall call_ ABSL_GUARDED_BY(mutex_);
  UploadSlot slot_ ABSL_GUARDED_BY(mutex_);
  CallShare share_ ABSL_GUARDED_BY(mutex_);
  CallShare bytes_ ABSL_GUARDED_BY(mutex_);  // What has arrived.
  IdleClock idle_ ABSL_GUARDED_BY(mutex_);
  int running_ ABSL_GUARDED_BY(mutex_) = 0;     // Tasks, here or elsewhere.
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;  // The client has been told, or is about to be.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_UPLOAD_REACTOR_H_
