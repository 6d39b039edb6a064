// SPDX-License-Identifier: Apache-2.0
//
// Every other format, by assimp: 3DS, Collada, FBX, X, LWO, DXF, ... by the file's extension.
//
// assimp's readers are many and not all of them survive hostile input, so they run in a child
// process (child_process.h) with limits on time and memory; what it sends back is checked like a
// file.
//
// - assimp keeps 32-bit floats, also in nodes: the report says so, with the rounding that the
//   largest coordinate may have undergone.
// - Each node with meshes is an object, named after the node; its transform, composed in doubles
//   from assimp's floats, is the object's. Axes are as assimp gives them (it turns some formats to
//   y up).
// - Points and lines are counted and skipped; polygons are cut as a fan, as everywhere.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_IMPORT_ASSIMP_READER_H_
#define SIGHTLINE_CLIENT_IMPORT_ASSIMP_READER_H_

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// Whether assimp has a reader for the extension ("3ds", in lower case).
bool AssimpKnows(const std::string& extension);

// Reads `bytes` as the format of options.extension. The scene may be empty: ImportBytes judges
// that. Errors do not name the file.
absl::StatusOr<ImportedScene> ReadWithAssimp(std::string_view bytes, const ImportOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_ASSIMP_READER_H_
