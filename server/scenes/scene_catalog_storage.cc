// SPDX-License-Identifier: Apache-2.0
//
// The catalog's dealings with the repository.
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "core/base/array_memory.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/log.h"
#include "server/base/resource_name.h"
#include "server/scenes/scene_catalog.h"

namespace sightline {
namespace {

// What reading a file says, with its reason.
absl::Status ExplainLoad(absl::Status status, const std::string& scene_id) {
  switch (status.code()) {
    case absl::StatusCode::kDataLoss:
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kUnimplemented:
      return WithReason(std::move(status), v1::ERROR_REASON_BAD_SCENE_FILE,
                        SceneResource(scene_id));
    default:
      return status;
  }
}

}  // namespace

absl::Status SceneCatalog::CheckRepository() const {
  if (repository_ != nullptr) return absl::OkStatus();
  return MakeError(absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_NO_REPOSITORY,
                   "the server has no repository: start it with --repository FOLDER");
}

SceneKeeper SceneCatalog::KeeperOf(const std::string& scene_id, bool temporary) const {
  if (repository_ == nullptr || temporary) return nullptr;
  return [this, scene_id](const Scene& scene) {
    absl::Status stored = repository_->Store(scene_id, scene, build_pool_);
    if (!stored.ok()) {
      Log(LogLevel::kError, "scene_not_stored",
          {{"scene", scene_id},
           {"revision", absl::StrCat(scene.revision)},
           {"status", stored.ToString()}});
    }
    return stored;
  };
}

void SceneCatalog::SetNote(const std::string& scene_id, std::optional<Note> note) {
  MutexLock lock(mutex_);
  if (note.has_value()) {
    notes_[scene_id] = *std::move(note);
  } else {
    notes_.erase(scene_id);
  }
}

absl::StatusOr<SceneView> SceneCatalog::LoadFile(const CreateOptions& options,
                                                 const SceneBytes& file, const SceneKeeper& keeper,
                                                 const CancelToken* cancel) {
  const std::string& id = options.scene_id;
  const absl::StatusOr<SceneFileInfo> info = InspectSceneFile(file);
  if (!info.ok()) return ExplainLoad(info.status(), id);
  {
    MutexLock lock(mutex_);
    const absl::Time now = absl::Now();
    times_.try_emplace(id, Times{.create_time = now,
                                 .update_time = now,
                                 .temporary = options.temporary,
                                 .anonymous = options.anonymous});
  }
  const LoadOptions load = {.limits = BuildOptions(BvhPreset::kStatic).limits};
  const absl::StatusOr<std::shared_ptr<const Scene>> scene = registry_.Load(
      id, info->scene_bytes,
      [&](uint64_t, const std::function<void(double)>& progress) {
        return LoadScene(file, id, load, build_pool_, cancel, progress);
      },
      keeper);
  if (!scene.ok()) {
    // Another creation of the same name may have won: its times stay.
    if (!registry_.GetStatus(id).ok()) {
      MutexLock lock(mutex_);
      times_.erase(id);
    }
    return ExplainBuild(ExplainLoad(scene.status(), id), id);
  }
  ReturnFreeMemory();  // What checking took.
  if ((*scene)->bvh.has_leaf_rows() || (*scene)->kd_tree_alone()) return Get(id);
  {
    MutexLock lock(mutex_);  // An edit builds as the file was built.
    if (const auto times = times_.find(id); times != times_.end()) {
      times->second.preset = BvhPreset::kCompact;
    }
  }
  return Get(id);
}

absl::StatusOr<SceneView> SceneCatalog::CreateFromBytes(const CreateOptions& options,
                                                        const SceneBytes& file,
                                                        const CancelToken* cancel) {
  CreateOptions temporary = options;
  temporary.temporary = true;
  return LoadFile(temporary, file, /*keeper=*/nullptr, cancel);
}

absl::StatusOr<SceneView> SceneCatalog::CreateFromFile(const CreateOptions& options,
                                                       const std::string& file_id,
                                                       const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckRepository());
  if (options.scene_id == file_id) return Load(file_id, cancel);
  SL_ASSIGN_OR_RETURN(const SceneBytes file, repository_->Map(file_id));
  return LoadFile(options, file, KeeperOf(options.scene_id, options.temporary), cancel);
}

absl::StatusOr<SceneView> SceneCatalog::Load(const std::string& scene_id,
                                             const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckRepository());
  if (absl::StatusOr<SceneView> there = Get(scene_id);
      there.ok() && there->status.latest != nullptr) {
    return there;
  }
  absl::StatusOr<SceneView> loaded = [&]() -> absl::StatusOr<SceneView> {
    SL_ASSIGN_OR_RETURN(const SceneBytes file, repository_->Map(scene_id));
    return LoadFile({.scene_id = scene_id}, file, /*keeper=*/nullptr, cancel);
  }();
  if (loaded.ok()) {
    SetNote(scene_id, std::nullopt);
  } else if (ReasonOf(loaded.status()) != v1::ERROR_REASON_SCENE_FILE_NOT_FOUND &&
             !absl::IsAlreadyExists(loaded.status()) && !absl::IsCancelled(loaded.status())) {
    SetNote(scene_id, Note{true, std::string(loaded.status().message())});
  }
  return loaded;
}

absl::StatusOr<SceneView> SceneCatalog::Reload(const std::string& scene_id,
                                               const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckRepository());
  SL_RETURN_IF_ERROR(Get(scene_id).status());
  // What is wrong with the file is found within the registry's books, so that the scene says it.
  absl::StatusOr<SceneBytes> file = repository_->Map(scene_id);
  absl::StatusOr<SceneFileInfo> info = file.ok() ? InspectSceneFile(*file) : file.status();
  const LoadOptions load = {.limits = BuildOptions(BvhPreset::kStatic).limits};
  const absl::StatusOr<std::shared_ptr<const Scene>> scene = registry_.Reload(
      scene_id, info.ok() ? info->scene_bytes : 0,
      [&](uint64_t revision, const std::function<void(double)>& progress)
          -> absl::StatusOr<std::shared_ptr<const Scene>> {
        SL_RETURN_IF_ERROR(info.status());
        return LoadScene(*file, scene_id, {.limits = load.limits, .revision = revision},
                         build_pool_, cancel, progress);
      });
  if (!scene.ok()) {
    if (absl::IsNotFound(scene.status()) && info.ok()) return NotThere(scene_id);
    return ExplainBuild(ExplainLoad(scene.status(), scene_id), scene_id);
  }
  {
    MutexLock lock(mutex_);
    if (const auto times = times_.find(scene_id); times != times_.end()) {
      times->second.update_time = absl::Now();
    }
  }
  ReturnFreeMemory();  // What checking took, and the revision before.
  return Get(scene_id);
}

absl::Status SceneCatalog::Unload(const std::string& scene_id) {
  SL_RETURN_IF_ERROR(CheckRepository());
  SL_ASSIGN_OR_RETURN(SceneView view, Get(scene_id));
  if (!view.status.kept) {
    return MakeError(
        absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_SCENE_NOT_STORED,
        absl::StrCat(SceneName(scene_id), " is in memory alone",
                     view.status.keep_error.ok() ? "" : ": ", view.status.keep_error.message(),
                     ". Unloading would lose it; delete it if that is meant"),
        SceneResource(scene_id));
  }
  SL_RETURN_IF_ERROR(ExplainBuild(registry_.Delete(scene_id), scene_id));
  SetNote(scene_id, Note{false, "it was unloaded"});
  view.unloaded = true;
  Forget(std::move(view));
  return absl::OkStatus();
}

absl::Status SceneCatalog::Delete(const std::string& scene_id) {
  absl::StatusOr<SceneView> view = Get(scene_id);
  bool temporary = false;
  {
    MutexLock lock(mutex_);
    if (const auto times = times_.find(scene_id); times != times_.end()) {
      temporary = times->second.temporary;
    }
  }
  const bool stored = repository_ != nullptr && !temporary && repository_->Has(scene_id);
  if (!view.ok() && !stored) return view.status();
  if (view.ok()) SL_RETURN_IF_ERROR(ExplainBuild(registry_.Delete(scene_id), scene_id));
  SetNote(scene_id, std::nullopt);
  if (view.ok()) Forget(*std::move(view));
  return stored ? repository_->Remove(scene_id) : absl::OkStatus();
}

absl::Status SceneCatalog::LoadAll() {
  SL_RETURN_IF_ERROR(CheckRepository());
  SL_ASSIGN_OR_RETURN(const std::vector<StoredFile> files, repository_->List());
  for (const StoredFile& file : files) {
    const absl::Time start = absl::Now();
    const absl::StatusOr<SceneView> loaded = Load(file.scene_id, /*cancel=*/nullptr);
    Log(loaded.ok() ? LogLevel::kInfo : LogLevel::kError,
        loaded.ok() ? "scene_loaded" : "scene_not_loaded",
        {{"scene", file.scene_id},
         {"bytes", absl::StrCat(file.bytes)},
         {"seconds", absl::StrCat(absl::ToDoubleSeconds(absl::Now() - start))},
         {"status", loaded.status().ToString()}});
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<StoredScene>> SceneCatalog::ListStored(const std::string& after,
                                                                  size_t count) const {
  SL_RETURN_IF_ERROR(CheckRepository());
  SL_ASSIGN_OR_RETURN(std::vector<StoredFile> files, repository_->List());
  std::vector<StoredScene> scenes;
  for (StoredFile& file : files) {
    if (file.scene_id <= after) continue;
    if (scenes.size() == count) break;
    StoredScene scene;
    scene.file = std::move(file);
    if (absl::StatusOr<SceneStatus> status = registry_.GetStatus(scene.file.scene_id);
        status.ok()) {
      scene.view = View(*std::move(status));
    } else {
      MutexLock lock(mutex_);
      if (const auto note = notes_.find(scene.file.scene_id); note != notes_.end()) {
        scene.failed = note->second.failed;
        scene.note = note->second.text;
      }
    }
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

}  // namespace sightline
