// SPDX-License-Identifier: Apache-2.0
//
// OFF (Geomview, ASCII): one object with the file's vertices in their order.
//
// - The keyword may bear ST, C and N (texture coordinates, colours, normals), stand before the
//   counts without a blank (`OFF8 6 12`), or be missing. `#` begins a comment. Dimensions other
//   than three (4OFF, nOFF) and the binary form are Unimplemented.
// - A line a vertex, its first three numbers; a line a face, its corner count, its indices, and
//   perhaps a colour, which is not read. More lines than the counts promise are warned of.
//
// Thread safety: free function.
#ifndef SIGHTLINE_CLIENT_IMPORT_OFF_READER_H_
#define SIGHTLINE_CLIENT_IMPORT_OFF_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// The scene may be empty: ImportBytes judges that. Errors do not name the file.
absl::StatusOr<ImportedScene> ReadOff(std::string_view text, const ImportOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_OFF_READER_H_
