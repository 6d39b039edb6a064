// SPDX-License-Identifier: Apache-2.0
//
// SceneService over a SceneCatalog: decode, call, encode. Uploads take bytes, so that what this
// server does not know of a message is dropped before it is read (upload_reactor.h).
//
// Thread safety: gRPC calls the methods from many threads; the service holds no state of its own.
#ifndef SIGHTLINE_SERVER_SERVICES_SCENE_SERVICE_H_
#define SIGHTLINE_SERVER_SERVICES_SCENE_SERVICE_H_

#include "server/admission/upload_slots.h"
#include "server/stream/query_environment.h"
#include "sightline/v1/scene_service.grpc.pb.h"

namespace sightline {

class SceneService final
    : public v1::SceneService::WithRawCallbackMethod_CreateScene<
          v1::SceneService::WithRawCallbackMethod_UpdateScene<v1::SceneService::CallbackService>> {
 public:
  SceneService(const QueryEnvironment& env, UploadSlots& slots) : env_(env), slots_(slots) {}

  grpc::ServerReadReactor<grpc::ByteBuffer>* CreateScene(grpc::CallbackServerContext* context,
                                                         grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* GetScene(grpc::CallbackServerContext* context,
                                     const v1::GetSceneRequest* request,
                                     v1::Scene* response) override;
  grpc::ServerUnaryReactor* ListScenes(grpc::CallbackServerContext* context,
                                       const v1::ListScenesRequest* request,
                                       v1::ListScenesResponse* response) override;
  grpc::ServerUnaryReactor* ListSceneObjects(grpc::CallbackServerContext* context,
                                             const v1::ListSceneObjectsRequest* request,
                                             v1::ListSceneObjectsResponse* response) override;
  grpc::ServerReadReactor<grpc::ByteBuffer>* UpdateScene(grpc::CallbackServerContext* context,
                                                         grpc::ByteBuffer* response) override;
  grpc::ServerUnaryReactor* DeleteScene(grpc::CallbackServerContext* context,
                                        const v1::DeleteSceneRequest* request,
                                        google::protobuf::Empty* response) override;
  grpc::ServerUnaryReactor* LoadScene(grpc::CallbackServerContext* context,
                                      const v1::LoadSceneRequest* request,
                                      v1::Scene* response) override;
  grpc::ServerUnaryReactor* ReloadScene(grpc::CallbackServerContext* context,
                                        const v1::ReloadSceneRequest* request,
                                        v1::Scene* response) override;
  grpc::ServerUnaryReactor* UnloadScene(grpc::CallbackServerContext* context,
                                        const v1::UnloadSceneRequest* request,
                                        google::protobuf::Empty* response) override;
  grpc::ServerUnaryReactor* ListStoredScenes(grpc::CallbackServerContext* context,
                                             const v1::ListStoredScenesRequest* request,
                                             v1::ListStoredScenesResponse* response) override;
  grpc::ServerWriteReactor<v1::WatchSceneResponse>* WatchScene(
      grpc::CallbackServerContext* context, const v1::WatchSceneRequest* request) override;

 private:
  const QueryEnvironment env_;
  UploadSlots& slots_;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SERVICES_SCENE_SERVICE_H_
