// SPDX-License-Identifier: Apache-2.0
#include "server/services/unary.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "server/admission/call_deadline.h"
#include "server/base/resource_name.h"

namespace sightline {
namespace {

constexpr int32_t kDefaultPageSize = 100;
constexpr int32_t kMaxPageSize = 1000;
constexpr char kTokenPrefix = '~';  // In no id, so that an id is no token.

// A call whose answer is known. It deletes itself.
class AnsweredCall final : public grpc::ServerUnaryReactor {
 public:
  AnsweredCall(ActiveCall call, const absl::Status& status) : call_(std::move(call)) {
    this->Finish(ToGrpcStatus(status));
  }
  void OnDone() override { delete this; }

 private:
  const ActiveCall call_;
};

// A call whose handler runs on a pool. It deletes itself.
class LaterCall final : public grpc::ServerUnaryReactor,
                        public std::enable_shared_from_this<LaterCall> {
 public:
  static LaterCall* Start(const grpc::CallbackServerContext& context, const QueryEnvironment& env,
                          ThreadPool& pool, Operation operation, LaterHandler handler) {
    std::shared_ptr<LaterCall> call(new LaterCall(context, env, operation, std::move(handler)));
    call->Begin(env, pool);
    return call.get();
  }

  void OnCancel() override { deadline_.Fire(&cancel_); }
  void OnDone() override {
    std::shared_ptr<LaterCall> self;  // Goes after the lock has.
    MutexLock lock(mutex_);
    self.swap(self_);
    call_.Release();
  }

 private:
  LaterCall(const grpc::CallbackServerContext& context, const QueryEnvironment& env,
            Operation operation, LaterHandler handler)
      : deadline_(context), timer_(env.metrics, operation), handler_(std::move(handler)) {}

  void Begin(const QueryEnvironment& env, ThreadPool& pool) {
    MutexLock lock(mutex_);
    self_ = shared_from_this();
    absl::StatusOr<ActiveCall> call = env.calls.Admit();
    if (!call.ok()) return End(call.status());
    call_ = *std::move(call);
    pool.Submit([self = self_] { self->Run(); });
  }
  void Run() {
    absl::Status status = cancel_.ToStatus();
    if (status.ok()) status = GuardMemory([this] { return handler_(cancel_); });
    MutexLock lock(mutex_);
    End(status);
  }
  void End(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    timer_.Record(status.code());
    this->Finish(ToGrpcStatus(status));
  }

  const CallDeadline deadline_;
  const CallTimer timer_;
  LaterHandler handler_;
  CancelToken cancel_;
  Mutex mutex_;
  std::shared_ptr<LaterCall> self_ ABSL_GUARDED_BY(mutex_);
  ActiveCall call_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

grpc::ServerUnaryReactor* FinishedCall(ActiveCall call, const absl::Status& status) {
  return new AnsweredCall(std::move(call), status);
}

grpc::ServerUnaryReactor* AnswerLater(const grpc::CallbackServerContext& context,
                                      const QueryEnvironment& env, ThreadPool& pool,
                                      Operation operation, LaterHandler handler) {
  return LaterCall::Start(context, env, pool, operation, std::move(handler));
}

absl::StatusOr<Page> ParsePage(int32_t page_size, const std::string& page_token) {
  if (page_size < 0) return InvalidField("page_size", page_size, "must not be negative");
  Page page;
  page.size = page_size == 0 ? kDefaultPageSize : std::min(page_size, kMaxPageSize);
  if (page_token.empty()) return page;
  page.after = page_token.substr(1);
  if (page_token[0] != kTokenPrefix || !CheckId("page_token", page.after).ok()) {
    return InvalidField("page_token", absl::StrCat(page_token.size(), " bytes"),
                        "is not a token of an earlier page");
  }
  return page;
}

std::string PageToken(const std::string& last_id) { return absl::StrCat("~", last_id); }

}  // namespace sightline
