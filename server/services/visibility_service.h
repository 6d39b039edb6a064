// SPDX-License-Identifier: Apache-2.0
//
// VisibilityService: each call is a VisibilityStream of its method.
//
// Thread safety: gRPC calls the methods from many threads; the service holds no state of its own.
#ifndef SIGHTLINE_SERVER_SERVICES_VISIBILITY_SERVICE_H_
#define SIGHTLINE_SERVER_SERVICES_VISIBILITY_SERVICE_H_

#include "server/stream/query_environment.h"
#include "sightline/v1/visibility_service.grpc.pb.h"

namespace sightline {

class VisibilityService final : public v1::VisibilityService::CallbackService {
 public:
  explicit VisibilityService(const QueryEnvironment& env) : env_(env) {}

  grpc::ServerBidiReactor<v1::TraceTilesRequest, v1::TraceTilesResponse>* TraceTiles(
      grpc::CallbackServerContext* context) override;
  grpc::ServerBidiReactor<v1::ComputeShadowsRequest, v1::ComputeShadowsResponse>* ComputeShadows(
      grpc::CallbackServerContext* context) override;
  grpc::ServerBidiReactor<v1::TestSegmentsRequest, v1::TestSegmentsResponse>* TestSegments(
      grpc::CallbackServerContext* context) override;

 private:
  const QueryEnvironment env_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_VISIBILITY_SERVICE_H_
