// SPDX-License-Identifier: Apache-2.0
//
// A scene as bytes, for the way from a child process to its parent on the same machine. The parent
// does not trust the child: a library gone wild in it may send anything.
//
// Thread safety: free functions.
//
//   absl::StatusOr<ImportedScene> scene = DecodeScene(EncodeScene(in));
#ifndef SIGHTLINE_CLIENT_IMPORT_SCENE_WIRE_H_
#define SIGHTLINE_CLIENT_IMPORT_SCENE_WIRE_H_

#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

std::string EncodeScene(const ImportedScene& scene);

// DataLoss unless the bytes are a scene whose indices are all in range.
absl::StatusOr<ImportedScene> DecodeScene(std::string_view bytes);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_SCENE_WIRE_H_
