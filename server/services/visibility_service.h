// SPDX-License-Identifier: Apache-2.0
//
// VisibilityService: each call is a VisibilityStream of its method. The streams take and give
// bytes, so that large arrays are never copied between gRPC's buffers and messages.
//
// Thread safety: gRPC calls the methods from many threads; the service holds no state of its own.
#ifndef SIGHTLINE_SERVER_SERVICES_VISIBILITY_SERVICE_H_
#define SIGHTLINE_SERVER_SERVICES_VISIBILITY_SERVICE_H_

#include "server/stream/query_environment.h"
#include "sightline/v1/visibility_service.grpc.pb.h"

namespace sightline {

class VisibilityService final : public v1::VisibilityService::WithRawCallbackMethod_TraceTiles<
                                    v1::VisibilityService::WithRawCallbackMethod_ComputeShadows<
                                        v1::VisibilityService::WithRawCallbackMethod_TestSegments<
                                            v1::VisibilityService::Service>>> {
 public:
  explicit VisibilityService(const QueryEnvironment& env) : env_(env) {}

  using Reactor = grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>;
  Reactor* TraceTiles(grpc::CallbackServerContext* context) override;
  Reactor* ComputeShadows(grpc::CallbackServerContext* context) override;
  Reactor* TestSegments(grpc::CallbackServerContext* context) override;

 private:
  const QueryEnvironment env_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_VISIBILITY_SERVICE_H_
