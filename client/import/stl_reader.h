// SPDX-License-Identifier: Apache-2.0
//
// STL, ASCII and binary.
//
// - A file is binary when its size is what its own triangle count says, 84 + 50 n, or more than
//   that where its first word is not `solid` (or where it holds a zero byte): binary files do begin
//   with "solid".
// - ASCII: each `solid` is an object with its name; keywords in either case; several may bear one
//   name. A `loop` of more than three vertices is a polygon. Lines that are not understood are
//   counted.
// - Corners at equal positions become one vertex of the object: STL repeats them for each triangle.
// - A binary file cut short, or an ASCII file that ends inside a facet, is DataLoss.
//
// Thread safety: free function.
#ifndef SIGHTLINE_CLIENT_IMPORT_STL_READER_H_
#define SIGHTLINE_CLIENT_IMPORT_STL_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// The scene may be empty: ImportBytes judges that. Errors do not name the file.
absl::StatusOr<ImportedScene> ReadStl(std::string_view bytes, const ImportOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_STL_READER_H_
