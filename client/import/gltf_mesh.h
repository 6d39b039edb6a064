// SPDX-License-Identifier: Apache-2.0
//
// One glTF mesh as local vertices and triangles, all of its primitives together.
//
// Invariant: what it allocates is in proportion to the indices it reads, and these are charged to a
// budget that all meshes of a file share: accessors may overlap, so the file's size alone does not
// bound them.
//
// Thread safety: one reader per thread; the model must outlive it.
//
//   GltfMeshReader meshes(model, options, &report);
//   absl::StatusOr<GltfMesh> mesh = meshes.Read(0);
#ifndef SIGHTLINE_CLIENT_IMPORT_GLTF_MESH_H_
#define SIGHTLINE_CLIENT_IMPORT_GLTF_MESH_H_

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "client/import/gltf_accessor.h"
#include "client/import/import_types.h"
#include "client/import/polygon_fan.h"

namespace sightline_tinygltf {
class Model;
struct Primitive;
}  // namespace sightline_tinygltf

namespace sightline {

struct GltfMesh {
  std::vector<Vec3d> vertices;
  std::vector<uint32_t> indices;
};

class GltfMeshReader {
 public:
  GltfMeshReader(const sightline_tinygltf::Model& model, const ImportOptions& options,
                 ImportReport* report)
      : model_(model),
        buffer_bytes_(BufferBytes(model)),
        report_(report),
        fan_(0, options, report),
        elements_left_(kElementsPerTriangle * options.max_triangles) {}

  // REQUIRES: number is one of the model's meshes.
  absl::StatusOr<GltfMesh> Read(size_t number);

 private:
  // Three corners and as many replaced positions, with room for primitives that come to nothing.
  static constexpr uint64_t kElementsPerTriangle = 8;

  absl::Status Charge(uint64_t elements);
  absl::Status AddPrimitive(const sightline_tinygltf::Primitive& primitive, GltfMesh* mesh);
  void SkipPrimitive(const sightline_tinygltf::Primitive& primitive);

  const sightline_tinygltf::Model& model_;
  const uint64_t buffer_bytes_;
  ImportReport* const report_;
  PolygonFan fan_;
  uint64_t elements_left_;
};

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_GLTF_MESH_H_
