// SPDX-License-Identifier: Apache-2.0
//
// Wavefront OBJ, with tinyobjloader's callback reader for the statements.
//
// tinyobjloader's double build does not meet the contract on its own: it sums a decimal digit by
// digit, so that 447422.999 comes out an ulp off, turns `nan` and `inf` into 0, cuts indices to 32
// bits, fails on a whole file for one bad face, and knows no continued lines. So it reads the text
// through obj_statements.h, which mends what would be lost, and the coordinates are read there,
// each rounded once.
//
// - `o` and `g` start an object named "o", "g" or "o/g" (groups joined by blanks; `o` ends a
//   group). Faces under the same name make one object. Its vertices are those it uses, in the order
//   of first use.
// - A face with an index that is 0, out of range at the end of the file, or unreadable is dropped
//   whole.
// - `p` and `l` elements and free-form curves and surfaces are counted and skipped. Texture
//   coordinates, normals, colours, weights and materials are not read.
//
// Thread safety: free function.
#ifndef SIGHTLINE_CLIENT_IMPORT_OBJ_READER_H_
#define SIGHTLINE_CLIENT_IMPORT_OBJ_READER_H_

#include <string_view>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

// The scene may be empty: ImportBytes judges that. Errors do not name the file.
absl::StatusOr<ImportedScene> ReadObj(std::string_view text, const ImportOptions& options);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_OBJ_READER_H_
