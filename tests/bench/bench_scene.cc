// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/bench_scene.h"

#include <array>
#include <exception>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "client/import/import.h"
#include "core/base/status_macros.h"

namespace sightline::bench {
namespace {

using nlohmann::json;

constexpr char kBuiltinPrefix[] = "builtin:";

bool FileExists(const std::string& path) {
  std::error_code error;
  return std::filesystem::is_regular_file(path, error);
}

// "folder/bunny.ply.xz" -> "bunny.ply".
std::string UnpackedName(const std::string& path) {
  std::string name = std::filesystem::path(path).filename().string();
  for (const char* packed : {".xz", ".gz"}) {
    if (absl::EndsWith(name, packed)) name.resize(name.size() - 3);
  }
  return name;
}

Vec3d ToVec3d(const json& value) {
  const auto xyz = value.get<std::array<double, 3>>();
  return {xyz[0], xyz[1], xyz[2]};
}

BuiltinView ToView(const json& value, Vec3d up) {
  BuiltinView view;
  view.eye = ToVec3d(value.at("eye"));
  view.at = ToVec3d(value.at("at"));
  view.up = up;
  view.fov_y_degrees = value.at("fov_y_deg").get<double>();
  for (const json& light : value.at("lights")) view.lights.push_back(ToVec3d(light));
  for (const json& sun : value.at("suns")) view.suns.push_back(ToVec3d(sun));
  const json& area = value.at("area");
  view.area = {ToVec3d(area.at("center")), ToVec3d(area.at("u")), ToVec3d(area.at("v"))};
  return view;
}

// Fills in views and up. NotFound: the file does not name the scene.
absl::Status ReadViews(const std::string& path, SceneSource* source) {
  std::ifstream file(path);
  if (!file) return absl::NotFoundError(absl::StrCat("views file '", path, "' cannot be read"));
  // The boundary at which the library's exceptions end: malformed JSON, missing keys, wrong types.
  try {
    const json all = json::parse(file);
    const auto entry = all.find(source->name);
    if (entry == all.end()) {
      return absl::NotFoundError(
          absl::StrCat("views file '", path, "' has no views of '", source->name, "'"));
    }
    source->up = ToVec3d(entry->at("up"));
    for (const json& view : entry->at("views")) {
      source->views.push_back(ToView(view, source->up));
    }
  } catch (const std::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("views file '", path, "': ", e.what()));
  }
  return absl::OkStatus();
}

absl::StatusOr<SceneSource> ReadMesh(const std::string& path, const std::string& views_file) {
  SceneSource source;
  source.name = UnpackedName(path);
  SL_ASSIGN_OR_RETURN(ImportedScene imported, ImportFile(path));
  source.objects = std::move(imported.objects);
  if (!views_file.empty()) {
    SL_RETURN_IF_ERROR(ReadViews(views_file, &source));
    return source;
  }
  const std::string beside = (std::filesystem::path(path).parent_path() / "views.json").string();
  if (!FileExists(beside)) return source;
  const absl::Status status = ReadViews(beside, &source);
  if (!status.ok() && !absl::IsNotFound(status)) return status;
  return source;
}

absl::StatusOr<SceneSource> MakeScene(const std::string& text, const std::string& views_file) {
  SL_ASSIGN_OR_RETURN(BuiltinSpec spec, ParseBuiltin(text));
  SL_ASSIGN_OR_RETURN(BuiltinScene scene, MakeBuiltin(spec));
  SceneSource source;
  source.name = absl::StrCat(kBuiltinPrefix, text);
  source.objects = std::move(scene.objects);
  if (views_file.empty()) {
    source.views = std::move(scene.views);
  } else {
    SL_RETURN_IF_ERROR(ReadViews(views_file, &source));
  }
  return source;
}

}  // namespace

absl::StatusOr<SceneSource> ReadScene(const std::string& scene, const std::string& views_file) {
  if (absl::StartsWith(scene, kBuiltinPrefix)) {
    return MakeScene(std::string(absl::StripPrefix(scene, kBuiltinPrefix)), views_file);
  }
  if (FileExists(scene)) return ReadMesh(scene, views_file);
  absl::StatusOr<SceneSource> builtin = MakeScene(scene, views_file);
  if (builtin.ok() || ParseBuiltin(scene).ok()) return builtin;
  return absl::NotFoundError(absl::StrCat(
      "'", scene, "' is neither a file nor a built-in scene: ", builtin.status().message()));
}

absl::StatusOr<IndexedGeometry> IndexScene(const SceneSource& source, const IndexOptions& options,
                                           ThreadPool& pool) {
  absl::StatusOr<SceneGeometry> geometry = absl::UnknownError("not compiled");
  // CompileScene runs within the pool of the calling thread.
  pool.ParallelFor(1, 1, [&](size_t, size_t) {
    geometry = CompileScene(source.objects, std::nullopt, MeshLimits{});
  });
  SL_RETURN_IF_ERROR(geometry.status());
  IndexedGeometry scene;
  scene.geometry = *std::move(geometry);
  SL_ASSIGN_OR_RETURN(scene.bvh, BuildBvh(scene.geometry, options.bvh, pool));
  if (options.kd_tree) {
    SL_ASSIGN_OR_RETURN(scene.kd_tree, BuildKdTree(scene.geometry, *options.kd_tree, pool));
  }
  if (options.binary_bvh) {
    SL_ASSIGN_OR_RETURN(scene.binary_bvh,
                        BuildBinaryBvh(scene.geometry, *options.binary_bvh, pool));
  }
  return scene;
}

}  // namespace sightline::bench
