// SPDX-License-Identifier: Apache-2.0
//
// glTF 2.0 and GLB, parsed by tinygltf from what gltf_json.h lets through, and read by
// gltf_accessor.h.
//
// - Each node with a mesh is an object, named after the node, else its mesh, else "node-<i>".
//   Vertices stay local; the node's place in the world, composed in doubles, is the object's
//   transform. A mirrored node's triangles are turned, so that their fronts stay fronts.
// - The default scene, else the first; without scenes every root node; without nodes every mesh.
// - Triangles, strips and fans. Points and lines are counted and skipped.
// - Positions of any type that KHR_mesh_quantization allows, sparse accessors, data URIs, buffers
//   in files below the file's folder. Data may go on past its buffer's byteLength; only so much is
//   read. Skins, morph targets and gpu instancing are not applied, with a warning.
// - A node that is its own ancestor, or has two parents, is an error.
//
// Thread safety: free function.
#ifndef SIGHTLINE_CLIENT_IMPORT_GLTF_READER_H_
#define SIGHTLINE_CLIENT_IMPORT_GLTF_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// REQUIRES: format is kGltf or kGlb. The scene may be empty: ImportBytes judges that. Errors do not
// name the file.
absl::StatusOr<ImportedScene> ReadGltf(std::string_view bytes, MeshFormat format,
                                       const ImportOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_GLTF_READER_H_
