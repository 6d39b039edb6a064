// SPDX-License-Identifier: Apache-2.0
#include "server/scenes/scene_upload.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/scene_codec.h"

namespace sightline {
namespace {

constexpr absl::string_view kSplitScene = "split the mesh into several scenes";

absl::Status CheckMeshCounts(uint64_t triangles, uint64_t vertices, const Limits& limits) {
  if (triangles > limits.max_triangles_per_scene) {
    return OverLimit("triangles", triangles, "max_triangles_per_scene",
                     limits.max_triangles_per_scene, kSplitScene);
  }
  if (vertices > limits.max_vertices_per_scene) {
    return OverLimit("vertices", vertices, "max_vertices_per_scene", limits.max_vertices_per_scene,
                     kSplitScene);
  }
  return absl::OkStatus();
}

// Adds announced counts without wrapping around: each is checked on its own first.
absl::Status AddCounts(uint64_t triangles, uint64_t vertices, const Limits& limits,
                       uint64_t* total_triangles, uint64_t* total_vertices) {
  SL_RETURN_IF_ERROR(CheckMeshCounts(triangles, vertices, limits));
  SL_RETURN_IF_ERROR(
      CheckMeshCounts(*total_triangles + triangles, *total_vertices + vertices, limits));
  *total_triangles += triangles;
  *total_vertices += vertices;
  return absl::OkStatus();
}

// What two calls with one request_id must have in common.
template <typename Header>
Fingerprint WithoutId(Header header) {
  header.clear_request_id();
  return FingerprintOf(header.SerializeAsString());
}

}  // namespace

uint64_t SceneUpload::BytesOf(const v1::CreateSceneRequest& message) {
  switch (message.part_case()) {
    case v1::CreateSceneRequest::kHeader:
      return message.header().ByteSizeLong();
    case v1::CreateSceneRequest::kObject:
      return sizeof(ObjectInput) + message.object().object_name().size();
    case v1::CreateSceneRequest::kChunk:
      return sightline::BytesOf(message.chunk());
    case v1::CreateSceneRequest::PART_NOT_SET:
      break;
  }
  return 0;
}

absl::Status SceneUpload::Add(const v1::CreateSceneRequest& message) {
  if (failure_.ok()) failure_ = AddPart(message);
  return failure_;
}

absl::Status SceneUpload::AddPart(const v1::CreateSceneRequest& message) {
  using Request = v1::CreateSceneRequest;
  if (message.part_case() == Request::PART_NOT_SET) return BadSequence("part", "is required");
  if (message.part_case() == Request::kHeader) {
    if (header_.has_value()) return BadSequence("header", "comes once");
    return AddHeader(message.header());
  }
  if (!header_.has_value()) return BadSequence("header", "must be the first message");
  if (!header_->builtin.empty() || !header_->file_id.empty()) {
    return BadSequence("object", "a built-in scene or a file has no upload");
  }
  if (message.part_case() == Request::kObject) return StartObject(message.object());
  return assembler_.Add(message.chunk());
}

absl::Status SceneUpload::AddHeader(const v1::CreateSceneHeader& header) {
  SceneHeader result;
  result.create.scene_id = header.scene_id();
  if (!header.scene_id().empty()) SL_RETURN_IF_ERROR(CheckId("header.scene_id", header.scene_id()));
  result.request_id = header.request_id();
  result.fingerprint = WithoutId(header);
  result.create.temporary = header.temporary();
  if (header.has_origin()) {
    result.create.origin = DecodeVector(header.origin());
    if (!(MaxAbs(*result.create.origin) <= kMaxCoordinate)) {
      return InvalidField("header.origin", MaxAbs(*result.create.origin),
                          "must be finite and within 2^40");
    }
  }
  SL_ASSIGN_OR_RETURN(const std::optional<BvhPreset> preset, DecodePreset(header.build_preset()));
  result.create.preset = preset.value_or(BvhPreset::kStatic);
  if (header.has_kd_tree()) {
    SL_ASSIGN_OR_RETURN(result.create.kd_tree, DecodeKdTree(header.kd_tree()));
  }
  if (header.has_binary_bvh()) {
    SL_ASSIGN_OR_RETURN(result.create.binary_bvh, DecodeBinaryBvh(header.binary_bvh()));
  }
  result.create.without_bvh = header.without_bvh();
  switch (header.source_case()) {
    case v1::CreateSceneHeader::kUpload:
      result.object_count = header.upload().object_count();
      result.triangle_count = header.upload().triangle_count();
      result.vertex_count = header.upload().vertex_count();
      if (result.object_count == 0) {
        return InvalidField("header.upload.object_count", 0, "must be at least 1");
      }
      if (result.triangle_count == 0) {
        return InvalidField("header.upload.triangle_count", 0, "must be at least 1",
                            v1::ERROR_REASON_UNUSABLE_UPLOAD);
      }
      if (result.object_count > limits_.max_objects_per_scene) {
        return OverLimit("header.upload.object_count", result.object_count, "max_objects_per_scene",
                         limits_.max_objects_per_scene,
                         "join objects, or split them into several scenes");
      }
      SL_RETURN_IF_ERROR(CheckMeshCounts(result.triangle_count, result.vertex_count, limits_));
      break;
    case v1::CreateSceneHeader::kBuiltin:
      result.builtin = header.builtin().spec();
      if (result.builtin.empty()) {
        return InvalidField("header.builtin.spec", "", "must be builtin:NAME");
      }
      break;
    case v1::CreateSceneHeader::kFile:
      result.file_id = header.file().file_id();
      SL_RETURN_IF_ERROR(CheckId("header.file.file_id", result.file_id));
      if (header.has_origin() || preset.has_value() || header.has_kd_tree() ||
          header.has_binary_bvh() || header.without_bvh()) {
        return InvalidField("header.file", result.file_id,
                            "has an origin and a build of its own: set neither");
      }
      break;
    case v1::CreateSceneHeader::SOURCE_NOT_SET:
      return InvalidField("header.source", "(unset)", "must be upload, builtin or file");
  }
  if (header.without_bvh() && !header.has_kd_tree()) {
    return InvalidField("header.without_bvh", "true", "needs header.kd_tree, to be asked instead");
  }
  header_ = std::move(result);
  return absl::OkStatus();
}

absl::Status SceneUpload::StartObject(const v1::ObjectHeader& header) {
  SL_RETURN_IF_ERROR(EndObject());
  if (objects_.size() == header_->object_count) {
    return BadSequence("object", absl::StrCat("the header announced ", header_->object_count));
  }
  SL_RETURN_IF_ERROR(
      AddCounts(header.triangle_count(), header.vertex_count(), limits_, &triangles_, &vertices_));
  if (triangles_ > header_->triangle_count || vertices_ > header_->vertex_count) {
    return BadSequence("object.triangle_count",
                       absl::StrCat("the objects so far have ", triangles_, " triangles and ",
                                    vertices_, " vertices, the header announced ",
                                    header_->triangle_count, " and ", header_->vertex_count));
  }
  return assembler_.Start(header);
}

absl::Status SceneUpload::EndObject() {
  SL_RETURN_IF_ERROR(assembler_.CheckComplete());
  if (assembler_.started()) objects_.push_back(assembler_.Take());
  return absl::OkStatus();
}

absl::StatusOr<std::vector<ObjectInput>> SceneUpload::Finish() {
  if (!failure_.ok()) return failure_;
  if (!header_.has_value()) return BadSequence("header", "the stream ended without one");
  SL_RETURN_IF_ERROR(EndObject());
  if (objects_.size() != header_->object_count || triangles_ != header_->triangle_count ||
      vertices_ != header_->vertex_count) {
    return BadSequence(
        "object",
        absl::StrCat("the stream ended after ", objects_.size(), " of ", header_->object_count,
                     " objects, ", triangles_, " of ", header_->triangle_count, " triangles and ",
                     vertices_, " of ", header_->vertex_count, " vertices"));
  }
  return std::move(objects_);
}

uint64_t SceneEditUpload::BytesOf(const v1::UpdateSceneRequest& message) {
  using Request = v1::UpdateSceneRequest;
  switch (message.part_case()) {
    case Request::kHeader:
      return message.header().ByteSizeLong();
    case Request::kAddObject:
      return sizeof(SceneEdit) + message.add_object().object_name().size();
    case Request::kReplaceVertices:
      return sizeof(SceneEdit) + message.replace_vertices().object_name().size();
    case Request::kRemoveObject:
      return sizeof(SceneEdit) + message.remove_object().object_name().size();
    case Request::kSetTransform:
      return sizeof(SceneEdit) + message.set_transform().object_name().size();
    case Request::kChunk:
      return sightline::BytesOf(message.chunk());
    case Request::PART_NOT_SET:
      break;
  }
  return 0;
}

absl::Status SceneEditUpload::Add(const v1::UpdateSceneRequest& message) {
  if (failure_.ok()) failure_ = AddPart(message);
  return failure_;
}

absl::Status SceneEditUpload::AddPart(const v1::UpdateSceneRequest& message) {
  using Request = v1::UpdateSceneRequest;
  if (message.part_case() == Request::PART_NOT_SET) return BadSequence("part", "is required");
  if (message.part_case() == Request::kHeader) {
    if (header_.has_value()) return BadSequence("header", "comes once");
    return AddHeader(message.header());
  }
  if (!header_.has_value()) return BadSequence("header", "must be the first message");
  if (message.part_case() == Request::kChunk) return assembler_.Add(message.chunk());
  SL_RETURN_IF_ERROR(EndObject());
  if (edits_.size() >= limits_.max_objects_per_scene) {
    return OverLimit("edits", edits_.size() + 1, "max_objects_per_scene",
                     limits_.max_objects_per_scene, "send them in several updates");
  }
  SceneEdit edit;
  switch (message.part_case()) {
    case Request::kAddObject:
      SL_RETURN_IF_ERROR(
          Reserve(message.add_object().triangle_count(), message.add_object().vertex_count()));
      assembled_ = SceneEdit::Kind::kAdd;
      return assembler_.Start(message.add_object());
    case Request::kReplaceVertices:
      SL_RETURN_IF_ERROR(Reserve(0, message.replace_vertices().vertex_count()));
      moved_vertices_ += message.replace_vertices().vertex_count();
      assembled_ = SceneEdit::Kind::kSetVertices;
      return assembler_.StartVertices(message.replace_vertices().object_name(),
                                      message.replace_vertices().vertex_count());
    case Request::kRemoveObject:
      edit.kind = SceneEdit::Kind::kRemove;
      edit.object.name = message.remove_object().object_name();
      SL_RETURN_IF_ERROR(CheckObjectName("remove_object.object_name", edit.object.name));
      break;
    case Request::kSetTransform: {
      edit.kind = SceneEdit::Kind::kSetTransform;
      edit.object.name = message.set_transform().object_name();
      SL_RETURN_IF_ERROR(CheckObjectName("set_transform.object_name", edit.object.name));
      SL_ASSIGN_OR_RETURN(
          edit.object.transform,
          DecodeTransform("set_transform.transform", message.set_transform().transform()));
      break;
    }
    default:
      return BadSequence("part", "is not one that this server knows");
  }
  edits_.push_back(std::move(edit));
  return absl::OkStatus();
}

absl::Status SceneEditUpload::AddHeader(const v1::UpdateSceneHeader& header) {
  EditHeader result;
  SL_ASSIGN_OR_RETURN(result.edit.scene_id, ParseSceneName("header.name", header.name()));
  result.request_id = header.request_id();
  result.fingerprint = WithoutId(header);
  if (header.base_revision() < 0) {
    return InvalidField("header.base_revision", header.base_revision(), "must not be negative");
  }
  result.edit.base_revision = static_cast<uint64_t>(header.base_revision());
  SL_ASSIGN_OR_RETURN(result.edit.preset, DecodePreset(header.build_preset()));
  if (header.has_kd_tree()) {
    SL_ASSIGN_OR_RETURN(result.edit.kd_tree, DecodeKdTree(header.kd_tree()));
  }
  if (header.has_binary_bvh()) {
    SL_ASSIGN_OR_RETURN(result.edit.binary_bvh, DecodeBinaryBvh(header.binary_bvh()));
  }
  header_ = std::move(result);
  return absl::OkStatus();
}

absl::Status SceneEditUpload::Reserve(uint64_t triangles, uint64_t vertices) {
  return AddCounts(triangles, vertices, limits_, &triangles_, &vertices_);
}

absl::Status SceneEditUpload::EndObject() {
  SL_RETURN_IF_ERROR(assembler_.CheckComplete());
  if (assembler_.started()) edits_.push_back({.kind = assembled_, .object = assembler_.Take()});
  return absl::OkStatus();
}

absl::StatusOr<std::vector<SceneEdit>> SceneEditUpload::Finish() {
  if (!failure_.ok()) return failure_;
  if (!header_.has_value()) return BadSequence("header", "the stream ended without one");
  SL_RETURN_IF_ERROR(EndObject());
  if (edits_.empty()) return BadSequence("part", "the stream ended without an edit");
  return std::move(edits_);
}

}  // namespace sightline
