// SPDX-License-Identifier: Apache-2.0
//
// The two upload state machines of SceneService: messages in, objects or edits out. No gRPC in
// them, so that tests and the fuzzer feed them whatever they like.
//
// Invariants: after an error nothing more is accepted; Finish succeeds only when everything
// announced has arrived and nothing else.
//
// Thread safety: one thread at a time.
//
//   SceneUpload upload(limits);
//   for (message : stream) SL_RETURN_IF_ERROR(upload.Add(message));
//   SL_ASSIGN_OR_RETURN(std::vector<ObjectInput> objects, upload.Finish());
#ifndef SIGHTLINE_SERVER_SCENES_SCENE_UPLOAD_H_
#define SIGHTLINE_SERVER_SCENES_SCENE_UPLOAD_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/mesh/object.h"
#include "core/scene/scene.h"
#include "server/base/limits.h"
#include "server/base/request_log.h"
#include "server/scenes/object_assembler.h"
#include "server/scenes/scene_catalog.h"
#include "sightline/v1/scene_service.pb.h"

namespace sightline {

// What CreateScene's header asks for.
struct SceneHeader {
  SceneCatalog::CreateOptions create;  // scene_id empty: to be made up.
  std::string request_id;
  Fingerprint fingerprint{};
  std::string builtin;  // Empty for an upload, ...
  std::string file_id;  // ... and so is this.
  uint64_t object_count = 0, triangle_count = 0, vertex_count = 0;
};

class SceneUpload {
 public:
  explicit SceneUpload(const Limits& limits) : limits_(limits) {}

  // What an upload will hold of a message; 0 for one that brings nothing.
  static uint64_t BytesOf(const v1::CreateSceneRequest& message);
  absl::Status Add(const v1::CreateSceneRequest& message);
  // Set once the header was accepted.
  const std::optional<SceneHeader>& header() const { return header_; }
  // The objects; none for a built-in scene.
  absl::StatusOr<std::vector<ObjectInput>> Finish();

 private:
  absl::Status AddPart(const v1::CreateSceneRequest& message);
  absl::Status AddHeader(const v1::CreateSceneHeader& header);
  absl::Status StartObject(const v1::ObjectHeader& header);
  absl::Status EndObject();

  const Limits limits_;
  absl::Status failure_;
  std::optional<SceneHeader> header_;
  ObjectAssembler assembler_;
  std::vector<ObjectInput> objects_;
  uint64_t triangles_ = 0, vertices_ = 0;  // Announced by object headers so far.
};

// What UpdateScene's header asks for.
struct EditHeader {
  SceneCatalog::EditOptions edit;
  std::string request_id;
  Fingerprint fingerprint{};
};

class SceneEditUpload {
 public:
  explicit SceneEditUpload(const Limits& limits) : limits_(limits) {}

  static uint64_t BytesOf(const v1::UpdateSceneRequest& message);
  absl::Status Add(const v1::UpdateSceneRequest& message);
  const std::optional<EditHeader>& header() const { return header_; }
  // What the objects that were announced so far add to the scene.
  uint64_t added_triangles() const { return triangles_; }
  uint64_t added_vertices() const { return vertices_ - moved_vertices_; }
  absl::StatusOr<std::vector<SceneEdit>> Finish();

 private:
  absl::Status AddPart(const v1::UpdateSceneRequest& message);
  absl::Status AddHeader(const v1::UpdateSceneHeader& header);
  absl::Status Reserve(uint64_t triangles, uint64_t vertices);
  absl::Status EndObject();

  const Limits limits_;
  absl::Status failure_;
  std::optional<EditHeader> header_;
  ObjectAssembler assembler_;
  SceneEdit::Kind assembled_ = SceneEdit::Kind::kAdd;
  std::vector<SceneEdit> edits_;
  uint64_t triangles_ = 0, vertices_ = 0;  // Announced so far, ...
  uint64_t moved_vertices_ = 0;            // ... and of them in the stead of others.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_SCENE_UPLOAD_H_
