// SPDX-License-Identifier: Apache-2.0
#include "client/import/gltf_mesh.h"

#include <array>
#include <optional>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/str_cat.h"
#include "client/import/text_scanner.h"
#include "client/import/tinygltf_api.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// Corners of triangle t in a primitive's list of corners.
std::array<uint64_t, 3> TriangleAt(int mode, uint64_t t) {
  if (mode == TINYGLTF_MODE_TRIANGLES) return {3 * t, 3 * t + 1, 3 * t + 2};
  if (mode == TINYGLTF_MODE_TRIANGLE_FAN) return {0, t + 1, t + 2};
  return {t, t + 1 + t % 2, t + 2 - t % 2};  // A strip: every other one is turned over.
}

}  // namespace

absl::Status GltfMeshReader::Charge(uint64_t elements) {
  if (elements > elements_left_) {
    return absl::ResourceExhaustedError(
        "its accessors claim more elements than max_triangles allows");
  }
  elements_left_ -= elements;
  return absl::OkStatus();
}

void GltfMeshReader::SkipPrimitive(const sightline_tinygltf::Primitive& primitive) {
  const auto position = primitive.attributes.find("POSITION");
  const int counted = primitive.indices >= 0                   ? primitive.indices
                      : position != primitive.attributes.end() ? position->second
                                                               : -1;
  if (counted < 0 || static_cast<size_t>(counted) >= model_.accessors.size()) return;
  const uint64_t corners = model_.accessors[counted].count;
  switch (primitive.mode) {
    case TINYGLTF_MODE_LINE:
      report_->skipped_primitives += corners / 2;
      break;
    case TINYGLTF_MODE_LINE_STRIP:
      report_->skipped_primitives += corners == 0 ? 0 : corners - 1;
      break;
    default:  // A point, or a segment of a loop, each.
      report_->skipped_primitives += corners;
  }
}

absl::Status GltfMeshReader::AddPrimitive(const sightline_tinygltf::Primitive& primitive,
                                          GltfMesh* mesh) {
  if (primitive.mode < TINYGLTF_MODE_TRIANGLES) {
    SkipPrimitive(primitive);
    return absl::OkStatus();
  }
  if (primitive.mode > TINYGLTF_MODE_TRIANGLE_FAN) {
    return absl::InvalidArgumentError(absl::StrCat("has a primitive of mode ", primitive.mode));
  }
  const auto attribute = primitive.attributes.find("POSITION");
  if (attribute == primitive.attributes.end()) {
    return absl::InvalidArgumentError("has a primitive without positions");
  }
  SL_ASSIGN_OR_RETURN(const GltfAccessor positions,
                      GltfAccessor::Open(model_, attribute->second, buffer_bytes_));
  SL_RETURN_IF_ERROR(positions.CheckPositions());
  std::optional<GltfAccessor> indices;
  if (primitive.indices >= 0) {
    SL_ASSIGN_OR_RETURN(indices, GltfAccessor::Open(model_, primitive.indices, buffer_bytes_));
    SL_RETURN_IF_ERROR(indices->CheckIndices());
  }
  const uint64_t corners = indices.has_value() ? indices->count() : positions.count();
  SL_RETURN_IF_ERROR(Charge(positions.sparse_count()));
  SL_RETURN_IF_ERROR(Charge(indices.has_value() ? indices->sparse_count() : 0));
  SL_RETURN_IF_ERROR(Charge(corners));
  if (positions.count() > kMaxVertices) {
    return absl::ResourceExhaustedError("holds more vertices than 32 bits can number");
  }

  fan_.set_vertex_count(positions.count());
  const bool list = primitive.mode == TINYGLTF_MODE_TRIANGLES;
  const uint64_t triangles = list ? corners / 3 : corners < 3 ? 0 : corners - 2;
  if (list && corners % 3 != 0) {
    report_->warnings.push_back(
        absl::StrCat("a triangle list has ", corners % 3, " corners too many"));
  }
  std::vector<uint32_t> global;
  for (uint64_t t = 0; t < triangles; ++t) {
    std::array<int64_t, 3> corner;
    const std::array<uint64_t, 3> at = TriangleAt(primitive.mode, t);
    for (int c = 0; c < 3; ++c) {
      corner[c] = static_cast<int64_t>(indices.has_value() ? indices->Index(at[c]) : at[c]);
    }
    SL_RETURN_IF_ERROR(fan_.Add(corner, &global));
  }
  // Only the positions in use, in the order of first use.
  absl::flat_hash_map<uint32_t, uint32_t> local;
  for (const uint32_t v : global) {
    const auto [it, added] = local.try_emplace(v, static_cast<uint32_t>(mesh->vertices.size()));
    if (added) {
      if (mesh->vertices.size() == kMaxVertices) {
        return absl::ResourceExhaustedError("holds more vertices than 32 bits can number");
      }
      mesh->vertices.push_back(CanonicalVertex(positions.Position(v)));
    }
    mesh->indices.push_back(it->second);
  }
  return absl::OkStatus();
}

absl::StatusOr<GltfMesh> GltfMeshReader::Read(size_t number) {
  GltfMesh mesh;
  for (const sightline_tinygltf::Primitive& primitive : model_.meshes[number].primitives) {
    absl::Status added = AddPrimitive(primitive, &mesh);
    if (!added.ok()) {
      return absl::Status(added.code(), absl::StrCat("mesh ", number, ": ", added.message()));
    }
  }
  return mesh;
}

}  // namespace sightline
