// SPDX-License-Identifier: Apache-2.0
//
// Reads mesh files into validated arrays of doubles, with a report of what was found and what was
// wrong.
//
//   OBJ, PLY, STL, OFF, glTF, GLB   in doubles: every decimal rounded once, to the nearest double
//   3DS, DAE, FBX and the rest      through assimp, with a warning: it keeps 32-bit floats
//   FILE.xz, FILE.gz                any of them, decompressed in memory
//
// Polygons are cut as a fan from their first corner. Extensions count in either case. Materials are
// never read, so a missing material file changes nothing. Errors are one line that names the file
// and the reason:
//
//   NotFound, PermissionDenied    the file cannot be opened
//   InvalidArgument               empty, of no known format, malformed, or without a triangle
//   DataLoss                      truncated or corrupt
//   ResourceExhausted             over a limit of ImportOptions
//   Cancelled                     ImportOptions::cancel was
//   Unimplemented                 needs an extension that is not read (Draco, meshopt, ...)
//
// Thread safety: free functions without shared state. assimp runs in a child process
// (assimp_reader.h).
//
//   absl::StatusOr<ImportedScene> scene = ImportFile("city.obj.xz");
//   if (!scene.ok()) return scene.status();
//   for (const std::string& line : DescribeReport(scene->report)) std::cerr << line << '\n';
#ifndef SIGHTLINE_CLIENT_IMPORT_IMPORT_H_
#define SIGHTLINE_CLIENT_IMPORT_IMPORT_H_

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "client/import/import_types.h"

namespace sightline {

absl::StatusOr<ImportedScene> ImportFile(const std::string& path,
                                         const ImportOptions& options = {});

// The same for bytes in memory, already decompressed. `options.name` stands for the file in
// messages.
absl::StatusOr<ImportedScene> ImportBytes(std::string_view bytes, MeshFormat format,
                                          const ImportOptions& options = {});

// The vertex positions of a PLY file (also .ply.xz, .ply.gz), faces or not. Non-finite points come
// back as NaN, in their place. An error where there is no point.
absl::StatusOr<std::vector<Vec3d>> ImportPoints(const std::string& path,
                                                const ImportOptions& options = {});

// The report as text, one fact a line, facts whose count is 0 left out; the warnings last.
std::vector<std::string> DescribeReport(const ImportReport& report);

}  // namespace sightline

#endif  // SIGHTLINE_CLIENT_IMPORT_IMPORT_H_
