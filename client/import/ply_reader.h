// SPDX-License-Identifier: Apache-2.0
//
// PLY, ASCII and binary in either byte order: any order of elements and properties, of any type;
// what is not geometry is read past. One object with the file's vertices in their order.
//
// - Vertices: element `vertex` with scalar properties x, y, z. In ASCII files decimals are read as
//   doubles whatever type is declared.
// - Faces: list property `vertex_indices` or `vertex_index` of element `face`; strips in element
//   `tristrips` (-1 starts anew). Edges are counted and skipped.
// - A count in the header is held against the bytes that are there before anything is allocated.
//   Bytes after the last element, other than blanks in text, are warned of.
//
// Thread safety: free functions.
#ifndef SIGHTLINE_CLIENT_IMPORT_PLY_READER_H_
#define SIGHTLINE_CLIENT_IMPORT_PLY_READER_H_

#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// The scene may be empty: ImportBytes judges that. Errors do not name the file.
absl::StatusOr<ImportedScene> ReadPly(std::string_view bytes, const ImportOptions& options);

// The vertices alone, for point sets; may be none.
absl::StatusOr<std::vector<Vec3d>> ReadPlyPoints(std::string_view bytes,
                                                 const CancelToken* cancel = nullptr);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_PLY_READER_H_
