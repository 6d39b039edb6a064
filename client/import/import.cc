// SPDX-License-Identifier: Apache-2.0
#include "client/import/import.h"

#include <new>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "client/import/assimp_reader.h"
#include "client/import/decompress.h"
#include "client/import/file_bytes.h"
#include "client/import/gltf_reader.h"
#include "client/import/mesh_checks.h"
#include "client/import/obj_reader.h"
#include "client/import/object_assembly.h"
#include "client/import/off_reader.h"
#include "client/import/ply_reader.h"
#include "client/import/stl_reader.h"
#include "client/import/text_scanner.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

// "bunny.ply: the mesh is empty", on one line whatever the name and the reason hold.
absl::Status Named(std::string_view file, const absl::Status& status) {
  std::string line = absl::StrCat(file.empty() ? "mesh" : ToAbsl(file), ": ", status.message());
  for (char& c : line) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) c = '?';
  }
  return absl::Status(status.code(), line);
}

std::optional<MeshFormat> FormatOf(const std::string& extension) {
  if (extension == "obj") return MeshFormat::kObj;
  if (extension == "ply") return MeshFormat::kPly;
  if (extension == "stl") return MeshFormat::kStl;
  if (extension == "off") return MeshFormat::kOff;
  if (extension == "gltf") return MeshFormat::kGltf;
  if (extension == "glb") return MeshFormat::kGlb;
  if (AssimpKnows(extension)) return MeshFormat::kOther;
  return std::nullopt;
}

// The file's bytes, decompressed.
absl::StatusOr<std::string> LoadBytes(const std::string& path, const ImportOptions& options) {
  SL_ASSIGN_OR_RETURN(std::string bytes,
                      ReadFileBytes(path, options.max_file_bytes, options.cancel));
  const std::string suffix = CompressionSuffix(path);
  if (suffix.empty()) return bytes;
  const auto decompress = suffix == "xz" ? DecompressXz : DecompressGzip;
  SL_ASSIGN_OR_RETURN(std::string plain, decompress(bytes, options.max_file_bytes, options.cancel));
  if (plain.empty()) return absl::InvalidArgumentError("the file is empty once decompressed");
  return plain;
}

// Without a byte order mark, which some editors put before text.
std::string_view TextOf(std::string_view bytes) {
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  return bytes;
}

absl::StatusOr<ImportedScene> ReadFormat(std::string_view bytes, MeshFormat format,
                                         const ImportOptions& options) {
  const std::string_view text = TextOf(bytes);
  switch (format) {
    case MeshFormat::kObj:
      return ReadObj(text, options);
    case MeshFormat::kPly:
      return ReadPly(text, options);
    case MeshFormat::kStl:
      return ReadStl(StartsWithIgnoreCase(text, "solid") ? text : bytes, options);
    case MeshFormat::kOff:
      return ReadOff(text, options);
    case MeshFormat::kGltf:
    case MeshFormat::kGlb:
      return ReadGltf(format == MeshFormat::kGltf ? text : bytes, format, options);
    case MeshFormat::kOther:
      return ReadWithAssimp(bytes, options);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("format ", static_cast<int>(format), " is none that is known"));
}

absl::Status EmptyMesh(const ImportReport& report) {
  std::vector<std::string> facts = DescribeReport(report);
  facts.erase(facts.begin());  // The format and its 0 triangles.
  return absl::InvalidArgumentError(
      facts.empty()
          ? "the mesh is empty: no triangle in it"
          : absl::StrCat("the mesh is empty: no triangle in it; ", absl::StrJoin(facts, "; ")));
}

absl::StatusOr<ImportedScene> ImportUnnamed(std::string_view bytes, MeshFormat format,
                                            const ImportOptions& options) {
  if (bytes.empty()) return absl::InvalidArgumentError("the file is empty");
  SL_ASSIGN_OR_RETURN(ImportedScene scene, ReadFormat(bytes, format, options));
  SL_RETURN_IF_ERROR(CountDefects(scene.objects, &scene.report, options.cancel));
  if (scene.report.triangles == 0) return EmptyMesh(scene.report);
  FinishNames(options.name, &scene.objects);
  return scene;
}

// What `run` returns, its error with the file's name before it. Memory ends here, too: whichever
// step asked for it.
template <typename Function>
auto NamedResult(std::string_view file, const Function& run) -> decltype(run()) {
  try {
    auto result = run();
    if (!result.ok()) return Named(file, result.status());
    return result;
  } catch (const std::bad_alloc&) {
    return Named(file, absl::ResourceExhaustedError("needs more memory than there is"));
  }
}

}  // namespace

absl::StatusOr<ImportedScene> ImportBytes(std::string_view bytes, MeshFormat format,
                                          const ImportOptions& options) {
  return NamedResult(options.name, [&] { return ImportUnnamed(bytes, format, options); });
}

absl::StatusOr<ImportedScene> ImportFile(const std::string& path, const ImportOptions& options) {
  ImportOptions named = options;
  if (named.name.empty()) named.name = FileStem(path);
  if (named.base_folder.empty()) named.base_folder = FileFolder(path);
  named.extension = MeshExtension(path);
  const std::optional<MeshFormat> format = FormatOf(named.extension);
  if (!format.has_value()) {
    return Named(path,
                 absl::InvalidArgumentError(absl::StrCat(
                     "its extension ", Quoted(named.extension),
                     " names no known mesh format (obj, ply, stl, off, gltf, glb, 3ds, dae, fbx "
                     "and others; .xz and .gz may follow)")));
  }
  return NamedResult(path, [&]() -> absl::StatusOr<ImportedScene> {
    SL_ASSIGN_OR_RETURN(const std::string bytes, LoadBytes(path, named));
    return ImportUnnamed(bytes, *format, named);
  });
}

absl::StatusOr<std::vector<Vec3d>> ImportPoints(const std::string& path,
                                                const ImportOptions& options) {
  if (MeshExtension(path) != "ply") {
    return Named(path, absl::InvalidArgumentError("points are read from PLY files alone"));
  }
  return NamedResult(path, [&]() -> absl::StatusOr<std::vector<Vec3d>> {
    SL_ASSIGN_OR_RETURN(const std::string bytes, LoadBytes(path, options));
    SL_ASSIGN_OR_RETURN(std::vector<Vec3d> points, ReadPlyPoints(TextOf(bytes), options.cancel));
    if (points.empty()) return absl::InvalidArgumentError("holds no point");
    return points;
  });
}

std::vector<std::string> DescribeReport(const ImportReport& report) {
  std::vector<std::string> lines = {absl::StrCat(report.format, ": ", report.triangles,
                                                 " triangles from ", report.polygons, " faces")};
  const auto add = [&lines](uint64_t count, std::string_view what) {
    if (count > 0) lines.push_back(absl::StrCat(count, " ", ToAbsl(what)));
  };
  add(report.polygons_fanned, "polygons of more than three corners cut as a fan");
  add(report.skipped_primitives, "points and lines skipped");
  add(report.faces_too_few_corners, "faces of fewer than three corners dropped");
  add(report.faces_bad_index, "faces with an index out of range dropped");
  add(report.non_finite_vertices, "vertices that are not finite");
  add(report.non_finite_triangles, "triangles that use such a vertex");
  add(report.degenerate_triangles, "triangles with two corners at one position");
  add(report.zero_area_triangles, "triangles without area");
  add(report.duplicate_triangles, "copies of an earlier triangle");
  lines.insert(lines.end(), report.warnings.begin(), report.warnings.end());
  return lines;
}

}  // namespace sightline
