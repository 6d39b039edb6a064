// SPDX-License-Identifier: Apache-2.0
//
// The catalog's dealings with the repository.
#include <utility>

#include "absl/cleanup/cleanup.h"
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

// The structures beside the BVH an edit sees by the revision that it is of.
void SceneCatalog::Times::BuildAs(const Scene& scene) {
  kd_tree.reset();
  binary_bvh.reset();
  without_bvh = false;
  if (scene.kd_tree_alone()) return;
  const bool compact = !scene.bvh.has_leaf_rows();
  if (compact != (preset == BvhPreset::kCompact)) {
    preset = compact ? BvhPreset::kCompact : BvhPreset::kStatic;
  }
}

SceneCatalog::Move::~Move() {
  if (catalog_ == nullptr) return;
  MutexLock lock(catalog_->mutex_);
  catalog_->moving_.erase(scene_id_);
}

absl::StatusOr<SceneCatalog::Move> SceneCatalog::BeginMove(const std::string& scene_id) {
  MutexLock lock(mutex_);
  if (moving_.insert(scene_id).second) return Move(this, scene_id);
  return MakeError(absl::StatusCode::kAborted, v1::ERROR_REASON_SCENE_BUSY,
                   absl::StrCat(SceneName(scene_id), " is being loaded, edited, unloaded or ",
                                "deleted by another call: try again after it"),
                   SceneResource(scene_id));
}

absl::Status SceneCatalog::CheckRepository() const {
  if (repository_ != nullptr) return absl::OkStatus();
  return MakeError(absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_NO_REPOSITORY,
                   "the server has no repository: start it with --repository FOLDER");
}

SceneKeeper SceneCatalog::KeeperOf(const std::string& scene_id, bool temporary) const {
  if (repository_ == nullptr || temporary) return nullptr;
  return [this, scene_id](const Scene& scene) {
    WaitForRemoval(scene_id);  // The file of a scene of before must not take this one's with it.
    absl::Status stored = repository_->Store(scene_id, scene, build_pool_, &stop_storing_);
    if (absl::IsCancelled(stored)) {
      stored = MakeError(absl::StatusCode::kCancelled, v1::ERROR_REASON_CANCELLED,
                         "the server was stopped before the file was written");
    }
    if (!stored.ok()) {
      ++failed_stores_;
      Log(LogLevel::kError, "scene_not_stored",
          {{"scene", scene_id},
           {"revision", absl::StrCat(scene.revision)},
           {"status", stored.ToString()}});
    }
    return stored;
  };
}

void SceneCatalog::WaitForRemoval(const std::string& scene_id) const {
  MutexLock lock(mutex_);
  while (removing_.contains(scene_id)) removed_.Wait(mutex_);
}

absl::Status SceneCatalog::CheckNotStored(const std::string& scene_id) const {
  if (repository_ == nullptr || scene_id.empty()) return absl::OkStatus();
  // What cannot be told might be replaced.
  SL_ASSIGN_OR_RETURN(const bool stored, repository_->Has(scene_id));
  if (!stored) return absl::OkStatus();
  return MakeError(absl::StatusCode::kAlreadyExists, v1::ERROR_REASON_ALREADY_EXISTS,
                   absl::StrCat(SceneName(scene_id), " exists already: it is stored, but not ",
                                "loaded; load or delete it, or take another name"),
                   SceneResource(scene_id));
}

absl::Status SceneCatalog::CheckFirstOfName(const std::string& scene_id) const {
  WaitForRemoval(scene_id);
  return CheckNotStored(scene_id);
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
                                                 const SceneBytes& file, NameOf name,
                                                 MemoryCharge* charge, const SceneKeeper& keeper,
                                                 const CancelToken* cancel) {
  const std::string& id = options.scene_id;
  const absl::StatusOr<SceneFileInfo> info = InspectSceneFile(file);
  if (!info.ok()) return ExplainLoad(info.status(), id);
  MemoryCharge checks(*this);  // Until the scene is there, or is not.
  SL_RETURN_IF_ERROR(checks.Add(SceneCheckBytes(*info, build_pool_.threads())));
  const absl::Time now = absl::Now();
  const uint64_t tag = AddTimes(options, Times{.create_time = now,
                                               .update_time = now,
                                               .temporary = options.temporary,
                                               .anonymous = options.anonymous});
  const LoadOptions load = {.limits = BuildOptions(BvhPreset::kStatic).limits};
  const absl::StatusOr<std::shared_ptr<const Scene>> scene = registry_.Load(
      id, info->scene_bytes,
      [&](uint64_t, const std::function<void(double)>& progress)
          -> absl::StatusOr<std::shared_ptr<const Scene>> {
        if (name == NameOf::kNewScene) SL_RETURN_IF_ERROR(CheckFirstOfName(id));
        SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> loaded,
                            LoadScene(file, id, load, build_pool_, cancel, progress));
        // Before anybody can edit it, who begins with what is known here.
        ChangeTimes(tag, [&](Times& times) { times.BuildAs(*loaded); });
        return loaded;
      },
      keeper, tag, charge->Leave());
  if (!scene.ok()) {
    DropTimes(id, tag);
    return ExplainBuild(ExplainLoad(scene.status(), id), id);
  }
  KeepShare(id, tag, nullptr);
  return Get(id);
}

absl::StatusOr<SceneView> SceneCatalog::CreateFromBytes(const CreateOptions& options,
                                                        const SceneBytes& file,
                                                        const CancelToken* cancel) {
  const absl::Cleanup trim = [] { ReturnFreeMemory(); };
  CreateOptions temporary = options;
  temporary.temporary = true;
  MemoryCharge nothing(*this);  // The bytes are the caller's.
  return LoadFile(temporary, file, NameOf::kFile, &nothing, /*keeper=*/nullptr, cancel);
}

absl::StatusOr<SceneView> SceneCatalog::CreateFromFile(const CreateOptions& options,
                                                       const std::string& file_id,
                                                       const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckRepository());
  if (options.scene_id == file_id) {
    SL_ASSIGN_OR_RETURN(SceneView view, Load(file_id, cancel));
    KeepShare(file_id, view.status.tag, options.share);
    return view;
  }
  SL_RETURN_IF_ERROR(CheckName(options.scene_id));
  const absl::Cleanup trim = [] { ReturnFreeMemory(); };
  MemoryCharge charge(*this);
  SL_ASSIGN_OR_RETURN(const SceneBytes file, OpenFile(file_id, &charge, cancel));
  return LoadFile(options, file, NameOf::kNewScene, &charge,
                  KeeperOf(options.scene_id, options.temporary), cancel);
}

absl::StatusOr<SceneBytes> SceneCatalog::OpenFile(const std::string& file_id, MemoryCharge* charge,
                                                  const CancelToken* cancel) {
  return repository_->OpenFile(
      file_id, [charge](uint64_t bytes) { return charge->Add(bytes); }, cancel);
}

absl::StatusOr<SceneView> SceneCatalog::Load(const std::string& scene_id,
                                             const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckRepository());
  if (absl::StatusOr<SceneView> there = Get(scene_id);
      there.ok() && there->status.latest != nullptr) {
    return there;
  }
  // What checking took: after the move, or edits would be refused while it is given back.
  const absl::Cleanup trim = [] { ReturnFreeMemory(); };
  SL_ASSIGN_OR_RETURN(const Move move, BeginMove(scene_id));
  if (absl::StatusOr<SceneView> there = Get(scene_id);
      there.ok() && there->status.latest != nullptr) {
    return there;  // Another call was faster.
  }
  absl::StatusOr<SceneView> loaded = [&]() -> absl::StatusOr<SceneView> {
    MemoryCharge charge(*this);
    SL_ASSIGN_OR_RETURN(const SceneBytes file, OpenFile(scene_id, &charge, cancel));
    return LoadFile({.scene_id = scene_id}, file, NameOf::kFile, &charge, /*keeper=*/nullptr,
                    cancel);
  }();
  if (loaded.ok()) {
    SetNote(scene_id, std::nullopt);
  } else if (ReasonOf(loaded.status()) != v1::ERROR_REASON_SCENE_FILE_NOT_FOUND &&
             !absl::IsAlreadyExists(loaded.status()) && !absl::IsCancelled(loaded.status()) &&
             !absl::IsDeadlineExceeded(loaded.status())) {
    SetNote(scene_id, Note{true, std::string(loaded.status().message())});
  }
  return loaded;
}

absl::StatusOr<SceneView> SceneCatalog::Reload(const std::string& scene_id,
                                               const CancelToken* cancel) {
  SL_RETURN_IF_ERROR(CheckRepository());
  // What checking took, and the revision before: after the move, as in Load.
  const absl::Cleanup trim = [] { ReturnFreeMemory(); };
  SL_ASSIGN_OR_RETURN(const Move move, BeginMove(scene_id));
  const uint64_t tag = TagNow(scene_id);
  if (tag == 0) return NotThere(scene_id);
  // What is wrong with the file is found within the registry's books, so that the scene says it.
  const absl::StatusOr<FileStamp> stamp = repository_->Stamp(scene_id);
  MemoryCharge charge(*this);
  const absl::StatusOr<SceneBytes> file = OpenFile(scene_id, &charge, cancel);
  const absl::StatusOr<SceneFileInfo> info = file.ok() ? InspectSceneFile(*file) : file.status();
  MemoryCharge checks(*this);  // Until the next revision is there, or is not.
  if (info.ok()) SL_RETURN_IF_ERROR(checks.Add(SceneCheckBytes(*info, build_pool_.threads())));
  const LoadOptions load = {.limits = BuildOptions(BvhPreset::kStatic).limits};
  const absl::StatusOr<std::shared_ptr<const Scene>> scene = registry_.Reload(
      scene_id, info.ok() ? info->scene_bytes : 0,
      [&](uint64_t revision, const std::function<void(double)>& progress)
          -> absl::StatusOr<std::shared_ptr<const Scene>> {
        SL_RETURN_IF_ERROR(info.status());
        // As it is now that no edit can store another.
        const absl::StatusOr<FileStamp> now = repository_->Stamp(scene_id);
        if (!stamp.ok() || !now.ok() || *now != *stamp) {
          return absl::AbortedError(absl::StrCat("the file of ", SceneName(scene_id),
                                                 " was replaced meanwhile: try again"));
        }
        return LoadScene(*file, scene_id, {.limits = load.limits, .revision = revision},
                         build_pool_, cancel, progress);
      },
      charge.Leave());
  if (!scene.ok()) {
    if (absl::IsNotFound(scene.status()) && info.ok()) return NotThere(scene_id);
    return ExplainBuild(ExplainLoad(scene.status(), scene_id), scene_id);
  }
  ChangeTimes(tag, [&](Times& times) {
    times.update_time = absl::Now();
    times.temporary = false;  // There is a file to store the next edit in.
    times.BuildAs(**scene);
  });
  return Get(scene_id);
}

absl::Status SceneCatalog::Unload(const std::string& scene_id) {
  SL_RETURN_IF_ERROR(CheckRepository());
  SL_ASSIGN_OR_RETURN(const Move move, BeginMove(scene_id));
  absl::StatusOr<SceneStatus> unloaded = registry_.Delete(scene_id, /*if_kept=*/true);
  if (absl::IsFailedPrecondition(unloaded.status())) {
    const absl::StatusOr<SceneStatus> now = registry_.GetStatus(scene_id);
    const absl::Status why = now.ok() ? now->keep_error : absl::OkStatus();
    return MakeError(
        absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_SCENE_NOT_STORED,
        absl::StrCat(SceneName(scene_id), " is in memory alone", why.ok() ? "" : ": ",
                     why.message(), ". Unloading would lose it; delete it if that is meant"),
        SceneResource(scene_id));
  }
  if (absl::IsNotFound(unloaded.status())) return NotThere(scene_id);
  SL_RETURN_IF_ERROR(ExplainBuild(unloaded.status(), scene_id));
  SetNote(scene_id, Note{false, "it was unloaded"});
  SceneView view = View(*std::move(unloaded));
  view.unloaded = true;
  Forget(std::move(view));
  return absl::OkStatus();
}

absl::Status SceneCatalog::Delete(const std::string& scene_id) {
  SL_ASSIGN_OR_RETURN(const Move move, BeginMove(scene_id));
  const std::optional<Times> times = TimesOf(TagNow(scene_id));
  const bool temporary = times.has_value() && times->temporary;
  const auto look = [&]() -> absl::StatusOr<bool> {
    return repository_ == nullptr ? false : repository_->Has(scene_id);
  };
  absl::StatusOr<bool> there = look();
  // A file that may be there would bring the scene back. A temporary one has none of its own.
  if (!temporary) SL_RETURN_IF_ERROR(there.status());
  {
    // From now on nothing new is stored under the name until its file is gone.
    MutexLock lock(mutex_);
    removing_.insert(scene_id);
  }
  absl::Cleanup removed = [&] {
    MutexLock lock(mutex_);
    removing_.erase(scene_id);
    removed_.SignalAll();
  };
  absl::StatusOr<SceneStatus> deleted = registry_.Delete(scene_id);
  // A creation that was under way may have stored it since. What is gone has none any more.
  if (there.ok() && !*there) there = look();
  const bool has_file = !there.ok() || *there;
  const bool stored = there.ok() && *there;
  if (!stored) std::move(removed).Invoke();
  const uint64_t tag = deleted.ok() ? deleted->tag : 0;
  if (deleted.ok()) {
    Forget(View(*std::move(deleted)));
  } else if (!absl::IsNotFound(deleted.status())) {
    return ExplainBuild(deleted.status(), scene_id);
  } else if (!stored) {
    DropShares(scene_id, /*tag=*/0, /*all=*/!has_file);  // Whoever took its file away did not.
    return NotThere(scene_id);
  }
  SetNote(scene_id, std::nullopt);
  if (stored) SL_RETURN_IF_ERROR(repository_->Remove(scene_id));
  DropShares(scene_id, tag, /*all=*/stored || !has_file);
  return temporary ? absl::OkStatus() : there.status();
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
