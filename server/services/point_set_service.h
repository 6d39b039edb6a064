// SPDX-License-Identifier: Apache-2.0
//
// PointSetService over a PointSetStore: decode, call, encode. Uploads take bytes, as scenes' do.
//
// Thread safety: gRPC calls the methods from many threads; the service holds no state of its own.
#ifndef SIGHTLINE_SERVER_SERVICES_POINT_SET_SERVICE_H_
#define SIGHTLINE_SERVER_SERVICES_POINT_SET_SERVICE_H_

#include "server/admission/upload_slots.h"
#include "server/stream/query_environment.h"
#include "sightline/v1/point_set_service.grpc.pb.h"

namespace sightline {

class PointSetService final : public v1::PointSetService::WithRawCallbackMethod_CreatePointSet<
                                  v1::PointSetService::CallbackService> {
 public:
  PointSetService(const QueryEnvironment& env, UploadSlots& slots) : env_(env), slots_(slots) {}

  grpc::ServerReadReactor<grpc::ByteBuffer>* CreatePointSet(grpc::CallbackServerContext* context,
                                                            grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* GetPointSet(grpc::CallbackServerContext* context,
                                        const v1::GetPointSetRequest* request,
                                        v1::PointSet* response) override;
  grpc::ServerUnaryReactor* ListPointSets(grpc::CallbackServerContext* context,
                                          const v1::ListPointSetsRequest* request,
                                          v1::ListPointSetsResponse* response) override;
  grpc::ServerUnaryReactor* DeletePointSet(grpc::CallbackServerContext* context,
                                           const v1::DeletePointSetRequest* request,
                                           google::protobuf::Empty* response) override;
  grpc::ServerUnaryReactor* RenewLease(grpc::CallbackServerContext* context,
                                       const v1::RenewLeaseRequest* request,
                                       v1::PointSet* response) override;

 private:
  const QueryEnvironment env_;
  UploadSlots& slots_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_POINT_SET_SERVICE_H_
