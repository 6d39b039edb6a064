// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/service_exchange.h"

#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server_builder.h>

#include <chrono>

#include "absl/strings/str_cat.h"

namespace sightline::bench {

class RawServer::Service final : public grpc::CallbackGenericService {
 public:
  grpc::ServerGenericBidiReactor* CreateReactor(grpc::GenericCallbackServerContext*) override {
    return new Reactor(*this);
  }
  void SetReply(const grpc::ByteBuffer& reply) {
    MutexLock lock(mutex_);
    reply_ = reply;
  }
  grpc::ByteBuffer reply() {
    MutexLock lock(mutex_);
    return reply_;
  }

 private:
  // Answers each message before it reads the next; deletes itself.
  class Reactor final : public grpc::ServerGenericBidiReactor {
   public:
    explicit Reactor(Service& service) : service_(service) { StartRead(&request_); }
    void OnReadDone(bool ok) override {
      if (!ok) return Finish(grpc::Status::OK);
      reply_ = service_.reply();
      StartWrite(&reply_);
    }
    void OnWriteDone(bool ok) override {
      if (!ok) return Finish(grpc::Status::CANCELLED);
      StartRead(&request_);
    }
    void OnDone() override { delete this; }

   private:
    Service& service_;
    grpc::ByteBuffer request_, reply_;
  };

  Mutex mutex_;
  grpc::ByteBuffer reply_ ABSL_GUARDED_BY(mutex_);
};

RawServer::RawServer() : service_(std::make_unique<Service>()) {}

RawServer::~RawServer() {
  if (server_ != nullptr) server_->Shutdown(std::chrono::system_clock::now());
}

absl::StatusOr<std::unique_ptr<RawServer>> RawServer::Start(const std::string& address) {
  std::unique_ptr<RawServer> raw(new RawServer());
  grpc::ServerBuilder builder;
  builder.AddListeningPort(address, grpc::InsecureServerCredentials(), &raw->port_);
  builder.RegisterCallbackGenericService(raw->service_.get());
  raw->server_ = builder.BuildAndStart();
  if (raw->server_ == nullptr || raw->port_ == 0) {
    return absl::UnavailableError(absl::StrCat("cannot listen on ", address));
  }
  return raw;
}

void RawServer::SetReplyBytes(size_t bytes) { service_->SetReply(RawMessage(bytes)); }

grpc::ByteBuffer RawMessage(size_t bytes) {
  const grpc::Slice slice(std::string(bytes, '\1'));
  return grpc::ByteBuffer(&slice, 1);
}

}  // namespace sightline::bench
