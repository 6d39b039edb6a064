// SPDX-License-Identifier: Apache-2.0
#include "server/scenes/object_assembler.h"

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/codec/geometry_codec.h"
#include "server/codec/packed_array.h"
#include "server/codec/scene_codec.h"

namespace sightline {
namespace {

constexpr size_t kMaxNameBytes = 1024;

absl::Status TooMany(absl::string_view field, uint64_t received, uint64_t announced) {
  return InvalidField(field, absl::StrCat(received, " elements"),
                      absl::StrCat("the object's header announced ", announced),
                      v1::ERROR_REASON_BAD_ARRAY_LENGTH);
}

}  // namespace

absl::Status CheckObjectName(absl::string_view field, absl::string_view name) {
  if (name.size() <= kMaxNameBytes) return absl::OkStatus();
  return InvalidField(field, absl::StrCat(name.size(), " bytes"),
                      absl::StrCat("must have at most ", kMaxNameBytes, " bytes"));
}

uint64_t BytesOf(const v1::MeshChunk& chunk) {
  // Floats are kept as doubles.
  constexpr uint64_t kGrowth = sizeof(Vec3d) / sizeof(Vec3f);
  return chunk.vertices_f64().size() + kGrowth * chunk.vertices_f32().size() +
         chunk.indices().size();
}

absl::Status ObjectAssembler::Start(const v1::ObjectHeader& header) {
  started_ = false;
  SL_RETURN_IF_ERROR(CheckObjectName("object.object_name", header.object_name()));
  ObjectInput object;
  object.name = header.object_name();
  SL_ASSIGN_OR_RETURN(object.transform, DecodeTransform("object.transform", header.transform()));
  SL_ASSIGN_OR_RETURN(object.culling, DecodeCulling(header.culling()));
  if (header.has_mask()) object.mask = header.mask();
  object.dynamic = header.dynamic();
  object_ = std::move(object);
  vertex_count_ = header.vertex_count();
  triangle_count_ = header.triangle_count();
  form_ = Form::kUnknown;
  started_ = true;
  return absl::OkStatus();
}

absl::Status ObjectAssembler::StartVertices(const std::string& name, uint64_t vertex_count) {
  started_ = false;
  SL_RETURN_IF_ERROR(CheckObjectName("replace_vertices.object_name", name));
  object_ = ObjectInput{};
  object_.name = name;
  vertex_count_ = vertex_count;
  triangle_count_ = 0;
  form_ = Form::kUnknown;
  started_ = true;
  return absl::OkStatus();
}

absl::Status ObjectAssembler::Add(const v1::MeshChunk& chunk) {
  if (!started_) {
    return InvalidField("chunk", "(set)", "there is no object that it belongs to",
                        v1::ERROR_REASON_BAD_SEQUENCE);
  }
  if (!chunk.vertices_f64().empty() && !chunk.vertices_f32().empty()) {
    return InvalidField("chunk.vertices_f32", "(set)", "a chunk has vertices in one form only");
  }
  const Form form = !chunk.vertices_f64().empty()   ? Form::kDouble
                    : !chunk.vertices_f32().empty() ? Form::kFloat
                                                    : form_;
  if (form_ != Form::kUnknown && form != form_) {
    return InvalidField("chunk.vertices_f64", "(set)", "an object's chunks may not mix both forms");
  }
  form_ = form;
  // Bytes are counted before they are copied: a chunk too many costs nothing.
  const uint64_t vertices = object_.vertices.size() + chunk.vertices_f64().size() / sizeof(Vec3d) +
                            chunk.vertices_f32().size() / sizeof(Vec3f);
  if (vertices > vertex_count_) return TooMany("chunk.vertices", vertices, vertex_count_);
  const uint64_t triangles =
      (object_.indices.size() + chunk.indices().size() / sizeof(uint32_t)) / 3;
  if (triangles > triangle_count_) return TooMany("chunk.indices", triangles, triangle_count_);
  SL_RETURN_IF_ERROR(
      AppendArray(chunk.vertices_f64(), "chunk.vertices_f64", "float64 [k, 3]", &object_.vertices));
  SL_RETURN_IF_ERROR(AddFloatVertices(chunk.vertices_f32()));
  if (chunk.indices().size() % (3 * sizeof(uint32_t)) != 0) {
    return InvalidField("chunk.indices", absl::StrCat(chunk.indices().size(), " bytes"),
                        "not a whole number of triangles of 12 bytes (uint32 [m, 3])",
                        v1::ERROR_REASON_BAD_ARRAY_LENGTH);
  }
  return AppendArray(chunk.indices(), "chunk.indices", "uint32 [m, 3]", &object_.indices);
}

absl::Status ObjectAssembler::AddFloatVertices(const std::string& bytes) {
  std::vector<Vec3f> vertices;
  SL_RETURN_IF_ERROR(DecodeArray(bytes, "chunk.vertices_f32", "float32 [k, 3]", &vertices));
  for (const Vec3f vertex : vertices) object_.vertices.push_back(ToDouble(vertex));
  return absl::OkStatus();
}

absl::Status ObjectAssembler::CheckComplete() const {
  if (!started_ || complete()) return absl::OkStatus();
  return MakeError(
      absl::StatusCode::kInvalidArgument, v1::ERROR_REASON_BAD_SEQUENCE,
      absl::StrCat("object \"", object_.name, "\" is not complete: ", object_.vertices.size(),
                   " of ", vertex_count_, " vertices and ", object_.indices.size() / 3, " of ",
                   triangle_count_, " triangles have arrived"),
      {{"field", "chunk"}});
}

ObjectInput ObjectAssembler::Take() {
  SIGHTLINE_CHECK(started_ && complete()) << object_.name;
  started_ = false;
  return std::exchange(object_, ObjectInput{});
}

}  // namespace sightline
