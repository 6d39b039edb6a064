// SPDX-License-Identifier: Apache-2.0
#include "client/cli/native_scene.h"

#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "client/cli/exit_code.h"
#include "core/base/folder.h"
#include "core/base/status_macros.h"

namespace sightline::cli {
namespace {

struct Place {
  std::string folder, name;
};

Place Resolve(const std::string& path) {
  std::error_code error;
  std::filesystem::path resolved = std::filesystem::weakly_canonical(path, error);
  if (error) resolved = path;
  const std::string folder = resolved.parent_path().string();
  return {folder.empty() ? "." : folder, resolved.filename().string()};
}

}  // namespace

bool IsSceneFileName(const std::string& path) {
  return absl::EndsWithIgnoreCase(path, kSceneFileEnding);
}

absl::StatusOr<SceneBytes> OpenSceneFile(const std::string& path) {
  const Place place = Resolve(path);
  SL_ASSIGN_OR_RETURN(const Folder folder, Folder::Open(place.folder));
  SL_ASSIGN_OR_RETURN(SceneBytes file, MapSceneFile(folder, place.name));
  file.shown = absl::StrCat("'", path, "'");
  return file;
}

absl::Status CheckSceneFileWritable(const std::string& path) {
  const Place place = Resolve(path);
  absl::StatusOr<Folder> folder = Folder::Open(place.folder);
  if (!folder.ok()) return WithExitCode(folder.status(), kExitCannotCreate);
  // Begun, and given up again.
  return WithExitCode(folder->Replace(place.name).status(), kExitCannotCreate);
}

absl::Status SaveSceneFile(const Scene& scene, const std::string& path, ThreadPool& pool,
                           const CancelToken* cancel, const std::function<void(double)>& progress) {
  const Place place = Resolve(path);
  const absl::StatusOr<Folder> folder = Folder::Open(place.folder);
  if (!folder.ok()) return WithExitCode(folder.status(), kExitCannotCreate);
  return WithExitCode(WriteSceneFile(scene, *folder, place.name, pool, cancel, progress),
                      kExitCannotCreate);
}

}  // namespace sightline::cli
