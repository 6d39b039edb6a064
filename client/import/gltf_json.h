// SPDX-License-Identifier: Apache-2.0
//
// What of a glTF file reaches tinygltf: its geometry, checked, and nothing else.
//
// tinygltf trusts its input in places (it recurses on `extras`, reads a GLB's last chunk up to 8
// bytes past its end, copies the binary chunk for every buffer that names it, narrows integers,
// expands file names by a shell's rules). So the JSON is scanned for its depth and size before it
// is parsed, and written anew with only scenes, nodes, meshes, accessors, buffer views and buffers
// in it, every number checked to be of the kind and range that its place asks for. A data URI is
// cut to its buffer's byteLength, beyond which glTF lets data go on and tinygltf does not.
//
// Thread safety: free functions.
//
//   absl::StatusOr<GltfSource> source = PrepareGltf(bytes, MeshFormat::kGlb, options);
#ifndef SIGHTLINE_CLIENT_IMPORT_GLTF_JSON_H_
#define SIGHTLINE_CLIENT_IMPORT_GLTF_JSON_H_

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// Deeper or larger JSON than geometry ever needs: a node's matrix is at depth 4, and a parsed value
// takes about 16 bytes, 64 with an array around it.
inline constexpr int kMaxJsonDepth = 64;
inline constexpr uint64_t kMaxJsonValues = uint64_t{16} << 20;
// Of nodes, meshes, primitives, accessors and what else is listed, together: an empty `{}` in the
// file is a structure of up to some 600 bytes to tinygltf.
inline constexpr uint64_t kMaxGltfItems = uint64_t{1} << 20;

struct GltfSource {
  std::string json;      // The geometry's part of the document.
  std::string_view bin;  // A GLB's binary chunk; empty where there is none.
  // byteLength of each buffer that is a file, in the document's order.
  std::vector<uint64_t> file_lengths;
  std::vector<std::string> warnings;
};

// REQUIRES: format is kGltf or kGlb. The result's `bin` points into `bytes`.
absl::StatusOr<GltfSource> PrepareGltf(std::string_view bytes, MeshFormat format,
                                       const ImportOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_GLTF_JSON_H_
