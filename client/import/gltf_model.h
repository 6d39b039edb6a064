// SPDX-License-Identifier: Apache-2.0
//
// Runs tinygltf over a prepared source. This is the one place that calls into it, and the boundary
// for what it throws. It loads no images, and opens no file but buffers below the given folder.
//
// Thread safety: free function.
//
//   sightline_tinygltf::Model model;
//   SL_RETURN_IF_ERROR(ParseGltf(source, format, options, &model));
#ifndef SIGHTLINE_CLIENT_IMPORT_GLTF_MODEL_H_
#define SIGHTLINE_CLIENT_IMPORT_GLTF_MODEL_H_

#include "absl/status/status.h"
#include "client/import/gltf_json.h"
#include "client/import/import_types.h"

namespace sightline_tinygltf {
class Model;
}

namespace sightline {

// REQUIRES: `source` came from PrepareGltf with the same format.
absl::Status ParseGltf(const GltfSource& source, MeshFormat format, const ImportOptions& options,
                       sightline_tinygltf::Model* model);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_GLTF_MODEL_H_
