// SPDX-License-Identifier: Apache-2.0
//
// The reactor behind the three client-streamed creations. An Upload (scene_upload.h,
// point_upload.h) takes the messages; a Job says what to do before, when the header is known, and
// after, when everything has arrived (upload_job.h).
//
// Invariants: reactions never compute, decoding and building are tasks of the build pool; one
// message is in memory beside what the upload holds; Finish is called exactly once, with no task
// running; the job's cancel token fires when the client goes away.
//
// Thread safety: as visibility_stream.h.
#ifndef SIGHTLINE_SERVER_SERVICES_UPLOAD_REACTOR_H_
#define SIGHTLINE_SERVER_SERVICES_UPLOAD_REACTOR_H_

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <memory>
#include <utility>

#include "absl/status/status.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "server/admission/call_tracker.h"
#include "server/admission/upload_slots.h"
#include "server/base/error.h"
#include "server/base/memory_guard.h"
#include "server/metrics/metrics.h"

namespace sightline {

// Job must have:
//   using Request, Response;
//   static constexpr Operation kOperation;
//   absl::Status Add(const Request&);           // One message, in order.
//   bool answered() const;                      // The response is known before the upload's end.
//   absl::Status Finish(const CancelToken&, Response*);
template <typename Job>
class UploadReactor final : public grpc::ServerReadReactor<typename Job::Request>,
                            public std::enable_shared_from_this<UploadReactor<Job>> {
 public:
  using Request = typename Job::Request;
  using Response = typename Job::Response;

  // `metrics` may be null.
  static UploadReactor* Start(Response* response, CallTracker& calls, UploadSlots& slots,
                              ThreadPool& pool, Metrics* metrics, std::unique_ptr<Job> job) {
    auto reactor =
        std::shared_ptr<UploadReactor>(new UploadReactor(response, pool, metrics, std::move(job)));
    reactor->Begin(calls, slots);
    return reactor.get();
  }

  void OnReadDone(bool ok) override {
    MutexLock lock(mutex_);
    if (cancel_.cancelled()) return End(cancel_.ToStatus());
    ++running_;
    if (ok) {
      pool_.Submit([self = this->shared_from_this()] { self->Receive(); });
    } else {
      pool_.Submit([self = this->shared_from_this()] { self->Complete(); });
    }
  }

  void OnCancel() override {
    MutexLock lock(mutex_);
    cancel_.Cancel();
    if (running_ == 0) End(cancel_.ToStatus());
  }

  void OnDone() override {
    std::shared_ptr<UploadReactor> self;  // Goes after the lock has.
    MutexLock lock(mutex_);
    self.swap(self_);
    call_.Release();
    slot_.Release();
  }

 private:
  UploadReactor(Response* response, ThreadPool& pool, Metrics* metrics, std::unique_ptr<Job> job)
      : response_(response), pool_(pool), metrics_(metrics), job_(std::move(job)) {}

  void Begin(CallTracker& calls, UploadSlots& slots) {
    MutexLock lock(mutex_);
    self_ = this->shared_from_this();
    absl::StatusOr<ActiveCall> call = calls.Admit();
    if (!call.ok()) return End(call.status());
    call_ = *std::move(call);
    absl::StatusOr<UploadSlot> slot = slots.Take();
    if (!slot.ok()) return End(slot.status());
    slot_ = *std::move(slot);
    this->StartRead(&request_);
  }

  void Receive() {
    absl::Status status = GuardMemory([&] { return job_->Add(request_); });
    const bool answered = status.ok() && job_->answered();
    if (answered) status = FinishJob();
    MutexLock lock(mutex_);
    --running_;
    if (cancel_.cancelled()) return End(cancel_.ToStatus());
    if (!status.ok() || answered) return End(status);
    this->StartRead(&request_);
  }

  void Complete() {
    const absl::Status status = FinishJob();
    MutexLock lock(mutex_);
    --running_;
    End(status);
  }
  absl::Status FinishJob() {
    return GuardMemory([&] { return job_->Finish(cancel_, response_); });
  }

  void End(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (std::exchange(finished_, true)) return;
    if (metrics_ != nullptr) {
      metrics_->RecordUpload(Job::kOperation, status.code(),
                             std::chrono::steady_clock::now() - arrival_);
    }
    this->Finish(ToGrpcStatus(status));
  }

  Response* const response_;
  ThreadPool& pool_;
  Metrics* const metrics_;
  const std::chrono::steady_clock::time_point arrival_ = std::chrono::steady_clock::now();
  const std::unique_ptr<Job> job_;  // Used by one task at a time.
  Request request_;
  CancelToken cancel_;

  Mutex mutex_;
  std::shared_ptr<UploadReactor> self_ ABSL_GUARDED_BY(mutex_);
  ActiveCall call_ ABSL_GUARDED_BY(mutex_);
  UploadSlot slot_ ABSL_GUARDED_BY(mutex_);
  int running_ ABSL_GUARDED_BY(mutex_) = 0;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_UPLOAD_REACTOR_H_
