// SPDX-License-Identifier: Apache-2.0
#include "client/lib/client.h"

#include <utility>

#include "absl/random/random.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/lib/client_state.h"
#include "client/lib/convert.h"
#include "client/lib/query_run.h"
#include "client/lib/upload.h"

namespace sightline::client {
namespace {

// 128 random bits: two clients never make the same.
std::string NewRequestId() {
  absl::BitGen random;
  return absl::StrFormat("%016x%016x", absl::Uniform<uint64_t>(random),
                         absl::Uniform<uint64_t>(random));
}

absl::Status CheckRows(size_t size, size_t row, absl::string_view what) {
  if (size % row == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(what, " has ", size, " numbers, which ", row, " does not divide"));
}

absl::Status CheckObject(const ObjectUpload& object) {
  if (absl::Status s = CheckRows(object.vertices.size(), 3,
                                 absl::StrCat("vertices of object '", object.name, "'"));
      !s.ok()) {
    return s;
  }
  return CheckRows(object.indices.size(), 3, absl::StrCat("indices of object '", object.name, "'"));
}

template <typename T>
absl::StatusOr<decltype(FromProto(std::declval<const T&>()))> Converted(absl::StatusOr<T> result) {
  if (!result.ok()) return std::move(result).status();
  return FromProto(*result);
}

constexpr int kPageSize = 1000;

}  // namespace

Client::Client(std::shared_ptr<Connection> connection)
    : shared_(std::make_shared<Shared>(std::move(connection))) {}

absl::StatusOr<Capabilities> Client::GetCapabilities(const CallOptions& options) const {
  {
    MutexLock lock(&shared_->mutex);
    if (shared_->capabilities) return *shared_->capabilities;
  }
  absl::StatusOr<Capabilities> capabilities =
      Converted(shared_->connection->GetCapabilities(options));
  if (capabilities.ok()) {
    MutexLock lock(&shared_->mutex);
    shared_->capabilities = *capabilities;
  }
  return capabilities;
}

absl::StatusOr<Health> Client::CheckHealth(const std::string& service,
                                           const CallOptions& options) const {
  return shared_->connection->CheckHealth(service, options);
}

absl::StatusOr<Scene> Client::CreateScene(const SceneSource& source,
                                          const CallOptions& options) const {
  if (int{!source.objects.empty()} + int{!source.builtin.empty()} + int{!source.file_id.empty()} !=
      1) {
    return absl::InvalidArgumentError(
        "a new scene needs one of objects, the name of a built-in scene and a stored file");
  }
  v1::CreateSceneRequest first;
  v1::CreateSceneHeader* header = first.mutable_header();
  header->set_scene_id(source.scene_id);
  header->set_request_id(NewRequestId());
  if (source.origin) ToProto(*source.origin, header->mutable_origin());
  header->set_temporary(source.temporary);
  if (source.file_id.empty()) header->set_build_preset(BuildPresetToProto(source.build_preset));
  if (source.kd_tree) ToProto(*source.kd_tree, header->mutable_kd_tree());
  if (source.binary_bvh) ToProto(*source.binary_bvh, header->mutable_binary_bvh());
  header->set_without_bvh(source.without_bvh);
  uint64_t chunk_bytes = kUploadChunkBytes;
  if (!source.file_id.empty()) {
    header->mutable_file()->set_file_id(source.file_id);
  } else if (source.objects.empty()) {
    header->mutable_builtin()->set_spec(source.builtin);
  } else {
    uint64_t triangles = 0, vertices = 0;
    for (const ObjectUpload& object : source.objects) {
      if (absl::Status s = CheckObject(object); !s.ok()) return s;
      triangles += object.indices.size() / 3;
      vertices += object.vertices.size() / 3;
    }
    header->mutable_upload()->set_object_count(static_cast<uint32_t>(source.objects.size()));
    header->mutable_upload()->set_triangle_count(triangles);
    header->mutable_upload()->set_vertex_count(vertices);
    absl::StatusOr<Capabilities> capabilities = GetCapabilities(options);
    if (!capabilities.ok()) return capabilities.status();
    chunk_bytes = ChunkBytes(capabilities->limits.max_message_bytes);
  }
  const Upload<v1::CreateSceneRequest> upload =
      [&](const std::function<bool(const v1::CreateSceneRequest&)>& write) {
        if (!write(first)) return;
        for (const ObjectUpload& object : source.objects) {
          v1::CreateSceneRequest request;
          ToProto(object, request.mutable_object());
          if (!write(request)) return;
          const bool sent =
              SendMesh(object.vertices, object.indices, chunk_bytes, [&](v1::MeshChunk chunk) {
                *request.mutable_chunk() = std::move(chunk);
                return write(request);
              });
          if (!sent) return;
        }
      };
  return Converted(shared_->Checked(shared_->connection->CreateScene(upload, options)));
}

absl::StatusOr<Scene> Client::UpdateScene(const std::string& name,
                                          const std::vector<SceneEdit>& edits,
                                          int64_t base_revision, const CallOptions& options) const {
  for (const SceneEdit& edit : edits) {
    if (absl::Status s = CheckObject(edit.object); !s.ok()) return s;
  }
  absl::StatusOr<Capabilities> capabilities = GetCapabilities(options);
  if (!capabilities.ok()) return capabilities.status();
  const uint64_t chunk_bytes = ChunkBytes(capabilities->limits.max_message_bytes);
  v1::UpdateSceneRequest first;
  first.mutable_header()->set_name(name);
  first.mutable_header()->set_request_id(NewRequestId());
  first.mutable_header()->set_base_revision(base_revision);
  const Upload<v1::UpdateSceneRequest> upload =
      [&](const std::function<bool(const v1::UpdateSceneRequest&)>& write) {
        if (!write(first)) return;
        for (const SceneEdit& edit : edits) {
          v1::UpdateSceneRequest request;
          const bool adds = edit.kind == SceneEdit::Kind::kAdd;
          switch (edit.kind) {
            case SceneEdit::Kind::kAdd:
              ToProto(edit.object, request.mutable_add_object());
              break;
            case SceneEdit::Kind::kRemove:
              request.mutable_remove_object()->set_object_name(edit.object.name);
              break;
            case SceneEdit::Kind::kSetTransform:
              request.mutable_set_transform()->set_object_name(edit.object.name);
              if (edit.object.transform) {
                for (double m : *edit.object.transform) {
                  request.mutable_set_transform()->add_transform(m);
                }
              }
              break;
            case SceneEdit::Kind::kReplaceVertices:
              request.mutable_replace_vertices()->set_object_name(edit.object.name);
              request.mutable_replace_vertices()->set_vertex_count(edit.object.vertices.size() / 3);
              break;
          }
          if (!write(request)) return;
          if (!adds && edit.kind != SceneEdit::Kind::kReplaceVertices) continue;
          const bool sent = SendMesh(edit.object.vertices,
                                     adds ? edit.object.indices : std::span<const uint32_t>(),
                                     chunk_bytes, [&](v1::MeshChunk chunk) {
                                       *request.mutable_chunk() = std::move(chunk);
                                       return write(request);
                                     });
          if (!sent) return;
        }
      };
  return Converted(shared_->Checked(shared_->connection->UpdateScene(upload, options)));
}

absl::StatusOr<Scene> Client::GetScene(const std::string& name, const CallOptions& options) const {
  v1::GetSceneRequest request;
  request.set_name(name);
  return Converted(shared_->connection->GetScene(request, options));
}

absl::StatusOr<std::vector<Scene>> Client::ListScenes(const CallOptions& options) const {
  std::vector<Scene> scenes;
  v1::ListScenesRequest request;
  request.set_page_size(kPageSize);
  do {
    absl::StatusOr<v1::ListScenesResponse> page = shared_->connection->ListScenes(request, options);
    if (!page.ok()) return page.status();
    for (const v1::Scene& scene : page->scenes()) scenes.push_back(FromProto(scene));
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return scenes;
}

absl::StatusOr<std::vector<SceneObject>> Client::ListSceneObjects(
    const std::string& name, const CallOptions& options) const {
  std::vector<SceneObject> objects;
  v1::ListSceneObjectsRequest request;
  request.set_parent(name);
  request.set_page_size(kPageSize);
  int64_t revision = 0;
  do {
    absl::StatusOr<v1::ListSceneObjectsResponse> page =
        shared_->connection->ListSceneObjects(request, options);
    if (!page.ok()) return page.status();
    if (revision != 0 && page->revision() != revision) {
      return absl::AbortedError(absl::StrCat("'", name, "' went from revision ", revision, " to ",
                                             page->revision(), " while its objects were listed"));
    }
    revision = page->revision();
    for (const v1::SceneObject& object : page->scene_objects()) {
      objects.push_back(FromProto(object));
    }
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return objects;
}

absl::Status Client::DeleteScene(const std::string& name, const CallOptions& options) const {
  v1::DeleteSceneRequest request;
  request.set_name(name);
  return shared_->connection->DeleteScene(request, options);
}

absl::Status Client::WatchScene(const std::string& name, bool wait_for_scene,
                                const std::function<bool(const SceneProgress&)>& on_change,
                                const CallOptions& options) const {
  v1::WatchSceneRequest request;
  request.set_name(name);
  request.set_wait_for_scene(wait_for_scene);
  return shared_->connection->WatchScene(
      request,
      [&on_change](const v1::WatchSceneResponse& response) {
        return on_change({.scene = FromProto(response.scene()),
                          .stage = response.stage(),
                          .progress = response.progress()});
      },
      options);
}

absl::StatusOr<Scene> Client::LoadScene(const std::string& name, const CallOptions& options) const {
  v1::LoadSceneRequest request;
  request.set_name(name);
  return Converted(shared_->connection->LoadScene(request, options));
}

absl::StatusOr<Scene> Client::ReloadScene(const std::string& name,
                                          const CallOptions& options) const {
  v1::ReloadSceneRequest request;
  request.set_name(name);
  return Converted(shared_->connection->ReloadScene(request, options));
}

absl::Status Client::UnloadScene(const std::string& name, const CallOptions& options) const {
  v1::UnloadSceneRequest request;
  request.set_name(name);
  return shared_->connection->UnloadScene(request, options);
}

absl::StatusOr<std::vector<StoredScene>> Client::ListStoredScenes(
    const CallOptions& options) const {
  std::vector<StoredScene> scenes;
  v1::ListStoredScenesRequest request;
  request.set_page_size(kPageSize);
  do {
    absl::StatusOr<v1::ListStoredScenesResponse> page =
        shared_->connection->ListStoredScenes(request, options);
    if (!page.ok()) return page.status();
    for (const v1::StoredScene& scene : page->stored_scenes()) scenes.push_back(FromProto(scene));
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return scenes;
}

absl::StatusOr<PointSet> Client::CreatePointSet(const PointSetSource& source,
                                                const CallOptions& options) const {
  if (absl::Status s = CheckPoints(source.points); !s.ok()) return s;
  const size_t count = source.points.positions.size() / 3;
  v1::CreatePointSetRequest first;
  v1::CreatePointSetHeader* header = first.mutable_header();
  header->set_parent(source.scene);
  header->set_point_set_id(source.point_set_id);
  header->set_request_id(NewRequestId());
  header->set_revision(source.revision);
  ToProto(source.lease, header->mutable_lease_duration());
  size_t rows = 0;
  if (source.camera) {
    ToProto(*source.camera, header->mutable_camera()->mutable_camera());
    ToProto(source.options, header->mutable_camera()->mutable_options());
  } else {
    ToProto(source.point_options, header->mutable_point_options());
    header->mutable_upload()->set_point_count(count);
    absl::StatusOr<Capabilities> capabilities = GetCapabilities(options);
    if (!capabilities.ok()) return capabilities.status();
    rows = std::max<size_t>(
        1, ChunkBytes(capabilities->limits.max_message_bytes) / BytesPerPoint(source.points));
  }
  const Upload<v1::CreatePointSetRequest> upload =
      [&](const std::function<bool(const v1::CreatePointSetRequest&)>& write) {
        if (!write(first) || source.camera) return;
        for (size_t i = 0; i < count; i += rows) {
          v1::CreatePointSetRequest request;
          PackPoints(source.points, i, std::min(rows, count - i), request.mutable_chunk());
          if (!write(request)) return;
        }
      };
  return Converted(shared_->Checked(shared_->connection->CreatePointSet(upload, options)));
}

absl::StatusOr<PointSet> Client::GetPointSet(const std::string& name,
                                             const CallOptions& options) const {
  v1::GetPointSetRequest request;
  request.set_name(name);
  return Converted(shared_->connection->GetPointSet(request, options));
}

absl::StatusOr<std::vector<PointSet>> Client::ListPointSets(const std::string& scene,
                                                            const CallOptions& options) const {
  std::vector<PointSet> sets;
  v1::ListPointSetsRequest request;
  request.set_parent(scene);
  request.set_page_size(kPageSize);
  do {
    absl::StatusOr<v1::ListPointSetsResponse> page =
        shared_->connection->ListPointSets(request, options);
    if (!page.ok()) return page.status();
    for (const v1::PointSet& set : page->point_sets()) sets.push_back(FromProto(set));
    request.set_page_token(page->next_page_token());
  } while (!request.page_token().empty());
  return sets;
}

absl::Status Client::DeletePointSet(const std::string& name, const CallOptions& options) const {
  v1::DeletePointSetRequest request;
  request.set_name(name);
  return shared_->connection->DeletePointSet(request, options);
}

absl::StatusOr<PointSet> Client::RenewLease(const std::string& name, absl::Duration lease,
                                            const CallOptions& options) const {
  v1::RenewLeaseRequest request;
  request.set_name(name);
  ToProto(lease, request.mutable_lease_duration());
  return Converted(shared_->connection->RenewLease(request, options));
}

absl::StatusOr<int64_t> Client::PinnedRevision(const std::string& scene, int64_t revision,
                                               const CallOptions& options) const {
  if (revision != 0) return revision;
  absl::StatusOr<Scene> current = SceneToAsk(*this, scene, options);
  if (!current.ok()) return current.status();
  return current->revision;
}

}  // namespace sightline::client
