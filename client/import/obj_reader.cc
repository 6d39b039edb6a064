// SPDX-License-Identifier: Apache-2.0
#include "client/import/obj_reader.h"

#include <tiny_obj_loader.h>

#include <deque>
#include <exception>
#include <istream>
#include <span>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/import/obj_statements.h"
#include "client/import/object_assembly.h"
#include "client/import/polygon_fan.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// Collects what tinyobjloader reads. Its methods are called from within tinyobjloader and do not
// throw on bad input.
class ObjCollector {
 public:
  ObjCollector(std::string_view text, const ImportOptions& options)
      : statements_(text, options.cancel), cancel_(options.cancel), fan_(0, options, &report_) {}

  absl::StatusOr<ImportedScene> Read();

 private:
  // Faces wait until the end of the file, since OBJ lets them name vertices that follow. Corners
  // are kept as they will be resolved: 0-based, kBadCorner where they name nothing.
  struct Faces {
    std::string name;
    std::vector<int64_t> corners;
    std::vector<uint32_t> ends;  // Of face i: one past its last corner.
  };

  void AddFace(std::span<const tinyobj::index_t> corners);
  void StartObject(std::string_view name);
  void StartGroup(std::span<const char* const> names);
  void SelectFaces();

  ObjStatements statements_;
  const CancelToken* const cancel_;
  ImportReport report_;
  PolygonFan fan_;
  uint64_t vertices_seen_ = 0;
  uint64_t faces_past_limit_ = 0;
  std::string object_name_, group_name_;
  std::deque<Faces> objects_;  // In the order of their first face.
  absl::flat_hash_map<std::string, Faces*> by_name_;
  Faces* current_ = nullptr;  // Null until the next face.
};

void ObjCollector::SelectFaces() {
  const bool both = !object_name_.empty() && !group_name_.empty();
  std::string name = absl::StrCat(object_name_, both ? "/" : "", group_name_);
  Faces*& faces = by_name_[name];
  if (faces == nullptr) {
    faces = &objects_.emplace_back();
    faces->name = std::move(name);
  }
  current_ = faces;
}

void ObjCollector::AddFace(std::span<const tinyobj::index_t> corners) {
  if (current_ == nullptr) SelectFaces();
  // Corners of one object are counted in 32 bits: a file of the default limit cannot hold as many.
  if (corners.size() > kMaxVertices - current_->corners.size()) {
    ++faces_past_limit_;
    return;
  }
  for (const tinyobj::index_t& corner : corners) {
    const int64_t index = corner.vertex_index;
    // Negative indices count back from the vertex before this face; 0 is none.
    const int64_t resolved = index > 0   ? index - 1
                             : index < 0 ? static_cast<int64_t>(vertices_seen_) + index
                                         : PolygonFan::kBadCorner;
    current_->corners.push_back(resolved);
  }
  current_->ends.push_back(static_cast<uint32_t>(current_->corners.size()));
}

void ObjCollector::StartObject(std::string_view name) {
  object_name_ = TrimBlanks(name);
  group_name_.clear();
  current_ = nullptr;
}

void ObjCollector::StartGroup(std::span<const char* const> names) {
  group_name_ = absl::StrJoin(names, " ");
  current_ = nullptr;
}

absl::StatusOr<ImportedScene> ObjCollector::Read() {
  tinyobj::callback_t callback;
  callback.vertex_cb = [](void* self, tinyobj::real_t, tinyobj::real_t, tinyobj::real_t,
                          tinyobj::real_t) { ++static_cast<ObjCollector*>(self)->vertices_seen_; };
  callback.index_cb = [](void* self, tinyobj::index_t* corners, int count) {
    static_cast<ObjCollector*>(self)->AddFace({corners, static_cast<size_t>(count)});
  };
  callback.object_cb = [](void* self, const char* name) {
    static_cast<ObjCollector*>(self)->StartObject(name);
  };
  callback.group_cb = [](void* self, const char** names, int count) {
    static_cast<ObjCollector*>(self)->StartGroup({names, static_cast<size_t>(count)});
  };
  std::istream stream(&statements_);
  stream.exceptions(std::ios::badbit);  // Else an allocation that fails would look like the end.
  std::string warnings, errors;
  const bool read =
      tinyobj::LoadObjWithCallback(stream, callback, this, nullptr, &warnings, &errors);
  SL_RETURN_IF_ERROR(CheckWanted(cancel_, 0));  // What it saw is not all, then.
  if (!read) {
    return absl::InvalidArgumentError(absl::StrCat("is not an OBJ file: ", errors));
  }
  const std::vector<Vec3d>& vertices = statements_.vertices();
  if (vertices_seen_ != vertices.size()) {
    return absl::InternalError(
        absl::StrCat("tinyobjloader saw ", vertices_seen_, " of ", vertices.size(), " vertices"));
  }
  if (vertices.size() > kMaxVertices || faces_past_limit_ > 0) {
    return absl::ResourceExhaustedError("holds more vertices or corners than 32 bits can number");
  }

  report_.format = "obj";
  report_.non_finite_vertices = statements_.non_finite_vertices();
  report_.skipped_primitives = statements_.skipped_primitives();
  if (statements_.malformed_vertices() > 0) {
    report_.warnings.push_back(
        absl::StrCat(statements_.malformed_vertices(),
                     " vertices lack a coordinate or hold one that is no number"));
  }
  fan_.set_vertex_count(vertices.size());
  ImportedScene scene;
  VertexCompactor compactor(&vertices);
  std::vector<uint32_t> indices;
  for (Faces& faces : objects_) {
    indices.clear();
    size_t begin = 0;
    for (const uint32_t end : faces.ends) {
      const absl::Status added =
          fan_.Add(std::span(faces.corners).subspan(begin, end - begin), &indices);
      if (!added.ok()) return added;
      begin = end;
    }
    faces.corners = {};  // Each object's memory goes as its triangles come.
    faces.ends = {};
    if (!indices.empty()) {
      scene.objects.push_back(compactor.MakeObject(std::move(faces.name), indices));
    }
  }
  scene.report = std::move(report_);
  return scene;
}

}  // namespace

absl::StatusOr<ImportedScene> ReadObj(std::string_view text, const ImportOptions& options) {
  try {
    return ObjCollector(text, options).Read();
  } catch (
      const std::exception& e) {  // The one boundary for tinyobjloader and the stream it reads.
    return absl::ResourceExhaustedError(absl::StrCat("cannot be read: ", e.what()));
  }
}

}  // namespace sightline
