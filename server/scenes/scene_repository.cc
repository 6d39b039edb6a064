// SPDX-License-Identifier: Apache-2.0
#include "server/scenes/scene_repository.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/log.h"
#include "server/base/resource_name.h"

namespace sightline {
namespace {

std::string FileName(const std::string& scene_id) {
  return absl::StrCat(scene_id, kSceneFileEnding);
}

absl::Status Explain(absl::Status status, const std::string& scene_id) {
  return WithReason(std::move(status), v1::ERROR_REASON_STORAGE_FAILED,
                    {{"resource", SceneName(scene_id)}});
}

}  // namespace

absl::StatusOr<std::unique_ptr<SceneRepository>> SceneRepository::Open(const std::string& path,
                                                                       FileCalls& files,
                                                                       SceneFiles mode) {
  SL_ASSIGN_OR_RETURN(Folder folder, Folder::Open(path, files));
  const absl::StatusOr<size_t> removed = folder.RemoveTemporaries();
  if (!removed.ok()) {
    // A folder that cannot be written can still be read.
    Log(LogLevel::kWarning, "repository_not_cleaned", {{"status", removed.status().ToString()}});
  } else if (*removed > 0) {
    Log(LogLevel::kInfo, "repository_cleaned", {{"files", absl::StrCat(*removed)}});
  }
  return std::unique_ptr<SceneRepository>(new SceneRepository(std::move(folder), mode));
}

absl::StatusOr<std::vector<StoredFile>> SceneRepository::List() const {
  absl::StatusOr<std::vector<FolderEntry>> entries = folder_.List();
  if (!entries.ok()) return WithReason(entries.status(), v1::ERROR_REASON_STORAGE_FAILED);
  std::vector<StoredFile> files;
  for (const FolderEntry& entry : *entries) {
    absl::string_view id = entry.name;
    if (!absl::ConsumeSuffix(&id, kSceneFileEnding) || !CheckId("file", id).ok()) continue;
    files.push_back({std::string(id), entry.bytes, absl::FromUnixNanos(entry.modified_ns)});
  }
  // The names of files have another order: '-' stands before the '.' of their ending.
  std::sort(files.begin(), files.end(),
            [](const StoredFile& a, const StoredFile& b) { return a.scene_id < b.scene_id; });
  return files;
}

absl::StatusOr<bool> SceneRepository::Has(const std::string& scene_id) const {
  const absl::Status there = folder_.Stamp(FileName(scene_id)).status();
  if (there.ok()) return true;
  if (absl::IsNotFound(there)) return false;
  return Explain(there, scene_id);
}

absl::StatusOr<SceneBytes> SceneRepository::OpenFile(const std::string& scene_id, MemoryCheck room,
                                                     const CancelToken* cancel) const {
  absl::StatusOr<SceneBytes> file = mode_ == SceneFiles::kMapped
                                        ? MapSceneFile(folder_, FileName(scene_id))
                                        : ReadSceneFile(folder_, FileName(scene_id), room, cancel);
  if (file.ok() || absl::IsCancelled(file.status()) || absl::IsDeadlineExceeded(file.status())) {
    return file;
  }
  if (absl::IsNotFound(file.status())) {
    return MakeError(absl::StatusCode::kNotFound, v1::ERROR_REASON_SCENE_FILE_NOT_FOUND,
                     absl::StrCat("the repository has no file ", FileName(scene_id)),
                     {{"resource", SceneName(scene_id)}});
  }
  return Explain(file.status(), scene_id);
}

absl::StatusOr<FileStamp> SceneRepository::Stamp(const std::string& scene_id) const {
  absl::StatusOr<FileStamp> stamp = folder_.Stamp(FileName(scene_id));
  return stamp.ok() ? stamp : Explain(stamp.status(), scene_id);
}

absl::Status SceneRepository::Store(const std::string& scene_id, const Scene& scene,
                                    ThreadPool& pool, const CancelToken* cancel) const {
  absl::Status stored = WriteSceneFile(scene, folder_, FileName(scene_id), pool, cancel);
  if (absl::IsCancelled(stored)) return stored;
  return Explain(std::move(stored), scene_id);
}

absl::Status SceneRepository::Remove(const std::string& scene_id) const {
  absl::Status removed = folder_.Remove(FileName(scene_id));
  if (absl::IsNotFound(removed)) return absl::OkStatus();
  return Explain(std::move(removed), scene_id);
}

}  // namespace sightline
