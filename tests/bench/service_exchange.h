// SPDX-License-Identifier: Apache-2.0
//
// One bidirectional stream in full flow, as a bulk client drives it: a header, then items with at
// most so many unanswered, until all are answered. For any pair of messages, raw bytes among them,
// so that the service and plain gRPC are driven by the same code.
//
// Thread safety: Run blocks its caller; `make` and `take` are called from gRPC's threads, each by
// one at a time.
//
//   Exchange<v1::TraceTilesRequest, v1::TraceTilesResponse> exchange({...});
//   SL_RETURN_IF_ERROR(exchange.Run(channel));
#ifndef SIGHTLINE_TESTS_BENCH_SERVICE_EXCHANGE_H_
#define SIGHTLINE_TESTS_BENCH_SERVICE_EXCHANGE_H_

#include <grpcpp/channel.h>
#include <grpcpp/generic/async_generic_service.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/server.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/client_callback.h>

#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"

namespace sightline::bench {

template <typename Request, typename Response>
class Exchange final : public grpc::ClientBidiReactor<Request, Response> {
 public:
  struct Job {
    std::string method;  // "/package.Service/Method".
    std::optional<Request> header;
    size_t items = 0;
    size_t window = 1;
    std::function<Request(size_t item)> make;
    // Whether this was an item's last reply. An answer to the header is taken off before.
    std::function<bool(Response* response)> take;
  };

  explicit Exchange(Job job) : job_(std::move(job)) {}

  absl::Status Run(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::TemplatedGenericStub<Request, Response> stub(channel);
    stub.PrepareBidiStreamingCall(&context_, job_.method, {}, this);
    MutexLock lock(mutex_);
    if (job_.header.has_value()) {
      outgoing_ = std::move(*job_.header);
      writing_ = true;
      this->StartWrite(&outgoing_);
    } else {
      opened_ = true;
      Write();
    }
    this->StartRead(&incoming_);
    this->StartCall();
    while (!done_) finished_.Wait(mutex_);
    if (!status_.ok()) {
      return absl::Status(static_cast<absl::StatusCode>(status_.error_code()),
                          status_.error_message());
    }
    if (answered_ < job_.items) return absl::InternalError("the stream ended early");
    return absl::OkStatus();
  }

  void OnWriteDone(bool ok) override {
    MutexLock lock(mutex_);
    writing_ = false;
    if (ok) Write();
  }

  void OnReadDone(bool ok) override {
    if (!ok) return;
    const bool header = !opened_.exchange(true);
    const bool last = !header && job_.take(&incoming_);
    incoming_.Clear();
    MutexLock lock(mutex_);
    answered_ += last ? 1 : 0;
    Write();
    this->StartRead(&incoming_);
  }

  void OnDone(const grpc::Status& status) override {
    MutexLock lock(mutex_);
    status_ = status;
    done_ = true;
    finished_.SignalAll();
  }

 private:
  void Write() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_ || !opened_) return;
    if (sent_ < job_.items && sent_ - answered_ < job_.window) {
      outgoing_ = job_.make(sent_++);
      writing_ = true;
      this->StartWrite(&outgoing_);
    } else if (answered_ == job_.items && !half_closed_) {
      half_closed_ = true;
      this->StartWritesDone();
    }
  }

  const Job job_;
  grpc::ClientContext context_;
  Request outgoing_;
  Response incoming_;
  std::atomic<bool> opened_ = false;
  Mutex mutex_;
  CondVar finished_;
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool half_closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool done_ ABSL_GUARDED_BY(mutex_) = false;
  size_t sent_ ABSL_GUARDED_BY(mutex_) = 0;
  size_t answered_ ABSL_GUARDED_BY(mutex_) = 0;
  grpc::Status status_ ABSL_GUARDED_BY(mutex_);
};

// Plain gRPC for comparison: a server that answers every message with `reply_bytes` bytes that it
// has ready, and looks into none. What it moves is the most that this gRPC can.
class RawServer {
 public:
  // Listens where `address` says. UNAVAILABLE: it cannot.
  static absl::StatusOr<std::unique_ptr<RawServer>> Start(const std::string& address);
  ~RawServer();

  int port() const { return port_; }
  void SetReplyBytes(size_t bytes);

 private:
  class Service;
  RawServer();

  int port_ = 0;
  std::unique_ptr<Service> service_;
  std::unique_ptr<grpc::Server> server_;
};

// A message of so many bytes.
grpc::ByteBuffer RawMessage(size_t bytes);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_SERVICE_EXCHANGE_H_
