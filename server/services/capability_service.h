// SPDX-License-Identifier: Apache-2.0
//
// CapabilityService: what this server is, fixed when it starts.
//
// Thread safety: constant after construction.
#ifndef SIGHTLINE_SERVER_SERVICES_CAPABILITY_SERVICE_H_
#define SIGHTLINE_SERVER_SERVICES_CAPABILITY_SERVICE_H_

#include "server/base/limits.h"
#include "server/stream/query_environment.h"
#include "sightline/v1/capability_service.grpc.pb.h"

namespace sightline {

v1::Capabilities DescribeServer(const Limits& limits, int threads);

class CapabilityService final : public v1::CapabilityService::CallbackService {
 public:
  CapabilityService(const QueryEnvironment& env, v1::Capabilities capabilities)
      : env_(env), capabilities_(std::move(capabilities)) {}

  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* request,
                                            v1::Capabilities* response) override;

 private:
  const QueryEnvironment env_;
  const v1::Capabilities capabilities_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_CAPABILITY_SERVICE_H_
