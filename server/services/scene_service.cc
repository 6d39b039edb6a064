// SPDX-License-Identifier: Apache-2.0
#include "server/services/scene_service.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/log.h"
#include "server/base/request_log.h"
#include "server/base/resource_name.h"
#include "server/codec/scene_codec.h"
#include "server/scenes/scene_upload.h"
#include "server/services/scene_watch.h"
#include "server/services/unary.h"
#include "server/services/upload_job.h"

namespace sightline {
namespace {

void LogScene(absl::string_view event, const SceneView& view) {
  if (view.status.latest == nullptr) return;
  const Scene& scene = *view.status.latest;
  Log(LogLevel::kInfo, event,
      {{"scene", view.status.name},
       {"revision", absl::StrCat(scene.revision)},
       {"triangles", absl::StrCat(scene.geometry.triangles.size())},
       {"compile_s", absl::StrCat(scene.report.compile_seconds)},
       {"structure_s", absl::StrCat(scene.report.bvh_seconds + scene.report.kd_tree_seconds +
                                    scene.report.binary_bvh_seconds)},
       {"refitted", scene.report.bvh_refitted ? "true" : "false"},
       {"bytes", absl::StrCat(scene.report.memory_bytes)}});
}

absl::Status FindScene(const QueryEnvironment& env, const std::string& name, v1::Scene* response) {
  SL_ASSIGN_OR_RETURN(const std::string scene_id, ParseSceneName("name", name));
  SL_ASSIGN_OR_RETURN(const SceneView view, env.scenes.Get(scene_id));
  EncodeScene(view, response);
  return absl::OkStatus();
}

// What both of SceneService's uploads do alike; see upload_job.h.
class SceneSteps {
 public:
  using Response = v1::Scene;

  SceneSteps(const QueryEnvironment& env, const Client& client) : env_(env), client_(client) {}

  RequestLog& requests() const { return env_.scenes.requests(); }
  static MemoryBudget& BudgetOf(const QueryEnvironment& env) { return env.scenes; }
  // Builds are the build pool's own.
  static absl::StatusOr<WorkElsewhere> Prepare(const auto& /*upload*/, const CancelToken&) {
    return WorkElsewhere();
  }
  absl::Status Find(const std::string& resource, v1::Scene* response) const {
    return FindScene(env_, resource, response);
  }

 protected:
  const QueryEnvironment env_;
  const Client client_;
};

class CreateSceneSteps : public SceneSteps {
 public:
  using Request = v1::CreateSceneRequest;
  static constexpr Operation kOperation = Operation::kCreateScene;
  using Upload = SceneUpload;
  using Header = SceneHeader;
  using SceneSteps::SceneSteps;

  absl::Status CheckHeader(const Header& header) {
    SL_ASSIGN_OR_RETURN(share_, env_.scenes_made.Take(client_.name, client_.limits.scenes));
    // A file says what it needs when it is loaded, and one of the same name is no other scene.
    if (!header.file_id.empty() && header.create.scene_id == header.file_id) {
      return absl::OkStatus();
    }
    return env_.scenes.CheckRoom(
        header.create.scene_id, header.triangle_count, header.vertex_count,
        header.vertex_count * sizeof(Vec3d) + header.triangle_count * 3 * sizeof(uint32_t));
  }

  // The header has announced everything.
  static absl::Status CheckAnnounced(const Upload&) { return absl::OkStatus(); }

  absl::StatusOr<std::string> Make(Upload& upload, const CancelToken& cancel, Response* response) {
    SceneCatalog::CreateOptions options;
    if (upload.header().has_value()) options = upload.header()->create;
    options.anonymous = options.scene_id.empty();
    options.share = std::make_shared<CallShare>(std::move(share_));
    if (options.anonymous) options.scene_id = MakeId("scene");
    if (upload.header().has_value() && !upload.header()->file_id.empty()) {
      SL_ASSIGN_OR_RETURN(const SceneView view,
                          env_.scenes.CreateFromFile(options, upload.header()->file_id, &cancel));
      return Made("scene_loaded", view, response);
    }
    if (upload.header().has_value() && !upload.header()->builtin.empty()) {
      options.builtin = upload.header()->builtin;
      SL_ASSIGN_OR_RETURN(const SceneView view, env_.scenes.CreateBuiltin(options, &cancel));
      return Made("scene_created", view, response);
    }
    SL_ASSIGN_OR_RETURN(const std::vector<ObjectInput> objects, upload.Finish());
    SL_ASSIGN_OR_RETURN(const SceneView view, env_.scenes.Create(options, objects, &cancel));
    return Made("scene_created", view, response);
  }

 private:
  std::string Made(absl::string_view event, const SceneView& view, Response* response) {
    LogScene(event, view);
    EncodeScene(view, response);
    return SceneName(view.status.name);
  }

  CallShare share_;  // Of the client's scenes.
};

class UpdateSteps : public SceneSteps {
 public:
  using Request = v1::UpdateSceneRequest;
  static constexpr Operation kOperation = Operation::kUpdateScene;
  using Upload = SceneEditUpload;
  using Header = EditHeader;
  using SceneSteps::SceneSteps;

  absl::Status CheckHeader(const Header& header) {
    // Told before the upload, where it can be: the edit checks again.
    uint64_t tag = 0;
    SL_RETURN_IF_ERROR(env_.scenes.CheckEdit(header.edit, &tag));
    // Another scene of the name may have the same number when the upload has ended.
    if (header.edit.base_revision != 0) base_tag_ = tag;
    return absl::OkStatus();
  }

  absl::Status CheckAnnounced(const Upload& upload) const {
    return env_.scenes.CheckEditRoom(upload.header()->edit.scene_id, upload.added_triangles(),
                                     upload.added_vertices());
  }

  absl::StatusOr<std::string> Make(Upload& upload, const CancelToken& cancel,
                                   Response* response) const {
    SL_ASSIGN_OR_RETURN(const std::vector<SceneEdit> edits, upload.Finish());
    SceneCatalog::EditOptions options = upload.header()->edit;
    options.base_tag = base_tag_;
    SL_ASSIGN_OR_RETURN(const SceneView view, env_.scenes.Edit(options, edits, &cancel));
    LogScene("scene_updated", view);
    EncodeScene(view, response);
    return SceneName(view.status.name);
  }

 private:
  uint64_t base_tag_ = 0;
};

// Objects have numbers for ids.
absl::StatusOr<size_t> ParseObjectToken(const std::string& token, size_t objects) {
  size_t first = 0;
  if (token.empty()) return first;
  if (token[0] == 'i' && absl::SimpleAtoi(token.substr(1), &first) && first <= objects)
    return first;
  return InvalidField("page_token", absl::StrCat(token.size(), " bytes"),
                      "is not a token of an earlier page");
}

}  // namespace

grpc::ServerReadReactor<grpc::ByteBuffer>* SceneService::CreateScene(
    grpc::CallbackServerContext* context, grpc::ByteBuffer* response) {
  return StartUpload<CreateSceneSteps>(*context, response, env_, slots_);
}

grpc::ServerReadReactor<grpc::ByteBuffer>* SceneService::UpdateScene(
    grpc::CallbackServerContext* context, grpc::ByteBuffer* response) {
  return StartUpload<UpdateSteps>(*context, response, env_, slots_);
}

grpc::ServerUnaryReactor* SceneService::GetScene(grpc::CallbackServerContext*,
                                                 const v1::GetSceneRequest* request,
                                                 v1::Scene* response) {
  return Answer(env_, Operation::kGetScene,
                [&] { return FindScene(env_, request->name(), response); });
}

grpc::ServerUnaryReactor* SceneService::ListScenes(grpc::CallbackServerContext*,
                                                   const v1::ListScenesRequest* request,
                                                   v1::ListScenesResponse* response) {
  return Answer(env_, Operation::kListScenes, [&]() -> absl::Status {
    SL_ASSIGN_OR_RETURN(const Page page, ParsePage(request->page_size(), request->page_token()));
    std::vector<SceneView> views = env_.scenes.List(page.after, page.size + 1);
    if (CutToPage(page, &views)) {
      response->set_next_page_token(PageToken(views.back().status.name));
    }
    for (const SceneView& view : views) EncodeScene(view, response->add_scenes());
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* SceneService::ListSceneObjects(grpc::CallbackServerContext*,
                                                         const v1::ListSceneObjectsRequest* request,
                                                         v1::ListSceneObjectsResponse* response) {
  return Answer(env_, Operation::kListSceneObjects, [&]() -> absl::Status {
    SL_ASSIGN_OR_RETURN(const std::string scene_id, ParseSceneName("parent", request->parent()));
    SL_ASSIGN_OR_RETURN(const Page page, ParsePage(request->page_size(), ""));
    SL_ASSIGN_OR_RETURN(const std::shared_ptr<const Scene> scene, env_.scenes.Pin(scene_id, 0));
    const size_t objects = scene->geometry.objects.size();
    SL_ASSIGN_OR_RETURN(const size_t first, ParseObjectToken(request->page_token(), objects));
    const size_t last = std::min(objects, first + page.size);
    for (size_t i = first; i < last; ++i) {
      EncodeObject(*scene, static_cast<uint32_t>(i), response->add_scene_objects());
    }
    if (last < objects) response->set_next_page_token(absl::StrCat("i", last));
    response->set_revision(static_cast<int64_t>(scene->revision));
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* SceneService::DeleteScene(grpc::CallbackServerContext* context,
                                                    const v1::DeleteSceneRequest* request,
                                                    google::protobuf::Empty*) {
  return AnswerLater(*context, env_, env_.call_pool, Operation::kDeleteScene,
                     [this, request](const CancelToken&) -> absl::Status {
                       SL_ASSIGN_OR_RETURN(const std::string scene_id,
                                           ParseSceneName("name", request->name()));
                       SL_RETURN_IF_ERROR(env_.scenes.Delete(scene_id));
                       Log(LogLevel::kInfo, "scene_deleted", {{"scene", scene_id}});
                       return absl::OkStatus();
                     });
}

grpc::ServerUnaryReactor* SceneService::LoadScene(grpc::CallbackServerContext* context,
                                                  const v1::LoadSceneRequest* request,
                                                  v1::Scene* response) {
  return AnswerLater(
      *context, env_, env_.build_pool, Operation::kLoadScene,
      [=, this](const CancelToken& cancel) -> absl::Status {
        SL_ASSIGN_OR_RETURN(const std::string scene_id, ParseSceneName("name", request->name()));
        SL_ASSIGN_OR_RETURN(const SceneView view, env_.scenes.Load(scene_id, &cancel));
        LogScene("scene_loaded", view);
        EncodeScene(view, response);
        return absl::OkStatus();
      });
}

grpc::ServerUnaryReactor* SceneService::ReloadScene(grpc::CallbackServerContext* context,
                                                    const v1::ReloadSceneRequest* request,
                                                    v1::Scene* response) {
  return AnswerLater(
      *context, env_, env_.build_pool, Operation::kReloadScene,
      [=, this](const CancelToken& cancel) -> absl::Status {
        SL_ASSIGN_OR_RETURN(const std::string scene_id, ParseSceneName("name", request->name()));
        SL_ASSIGN_OR_RETURN(const SceneView view, env_.scenes.Reload(scene_id, &cancel));
        LogScene("scene_reloaded", view);
        EncodeScene(view, response);
        return absl::OkStatus();
      });
}

grpc::ServerUnaryReactor* SceneService::UnloadScene(grpc::CallbackServerContext* context,
                                                    const v1::UnloadSceneRequest* request,
                                                    google::protobuf::Empty*) {
  return AnswerLater(*context, env_, env_.call_pool, Operation::kUnloadScene,
                     [this, request](const CancelToken&) -> absl::Status {
                       SL_ASSIGN_OR_RETURN(const std::string scene_id,
                                           ParseSceneName("name", request->name()));
                       SL_RETURN_IF_ERROR(env_.scenes.Unload(scene_id));
                       Log(LogLevel::kInfo, "scene_unloaded", {{"scene", scene_id}});
                       return absl::OkStatus();
                     });
}

grpc::ServerUnaryReactor* SceneService::ListStoredScenes(grpc::CallbackServerContext* context,
                                                         const v1::ListStoredScenesRequest* request,
                                                         v1::ListStoredScenesResponse* response) {
  return AnswerLater(*context, env_, env_.call_pool, Operation::kListStoredScenes,
                     [=, this](const CancelToken&) -> absl::Status {
                       SL_ASSIGN_OR_RETURN(const Page page,
                                           ParsePage(request->page_size(), request->page_token()));
                       SL_ASSIGN_OR_RETURN(std::vector<StoredScene> scenes,
                                           env_.scenes.ListStored(page.after, page.size + 1));
                       if (CutToPage(page, &scenes)) {
                         response->set_next_page_token(PageToken(scenes.back().file.scene_id));
                       }
                       for (const StoredScene& scene : scenes) {
                         EncodeStoredScene(scene, response->add_stored_scenes());
                       }
                       return absl::OkStatus();
                     });
}

grpc::ServerWriteReactor<v1::WatchSceneResponse>* SceneService::WatchScene(
    grpc::CallbackServerContext* context, const v1::WatchSceneRequest* request) {
  return SceneWatch::Start(context, *request, env_);
}

}  // namespace sightline
