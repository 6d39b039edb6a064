// SPDX-License-Identifier: Apache-2.0
//
// The scenes of a server: the engine's registry with what a service needs around it: times,
// repeatable requests, watchers, machine-readable reasons, and a repository that scenes are stored
// in and loaded from (scene_catalog_storage.cc).
//
// Invariants
//  1. A scene is in the catalog exactly while the registry has it: what is known of it here goes
//     by a number that the registry keeps with the scene, not by its name, which another may have
//     by the time that it is forgotten.
//  2. A watcher is told of every change after it was added, perhaps skipping states that were
//     overtaken; a deleted scene is its last news.
//  3. Of one name, one load, edit, unload or deletion runs at a time, and nothing is stored under
//     it while its file is being removed: so a scene that serves and counts as stored has its file.
//     A new scene is never stored over the file of another.
//
// Thread safety: every method from any thread; none may run on a gRPC thread but Pin, Get, List and
// the watcher methods, which do not compute. Watchers are called without the lock held.
//
//   SceneCatalog catalog(limits, build_pool);
//   absl::StatusOr<SceneView> made = catalog.Create({.scene_id = "hall"}, objects, &cancel);
//   absl::StatusOr<std::shared_ptr<const Scene>> pinned = catalog.Pin("hall", /*revision=*/0);
#ifndef SIGHTLINE_SERVER_SCENES_SCENE_CATALOG_H_
#define SIGHTLINE_SERVER_SCENES_SCENE_CATALOG_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/accel/bvh_builder.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "core/scene/registry.h"
#include "server/admission/call_quota.h"
#include "server/admission/memory_charge.h"
#include "server/base/limits.h"
#include "server/base/request_log.h"
#include "server/scenes/scene_repository.h"

namespace sightline {

// A scene as it is at one moment.
struct SceneView {
  SceneStatus status;
  absl::Time create_time = absl::InfinitePast();
  absl::Time update_time = absl::InfinitePast();
  bool deleted = false;
  bool unloaded = false;   // Deleted from memory alone.
  bool anonymous = false;  // The server made its name up.
  std::string builtin;     // The built-in scene that `status.latest` is, in full; empty: none.
};

// A scene of the repository.
struct StoredScene {
  StoredFile file;
  std::optional<SceneView> view;  // Of the scene in memory.
  bool failed = false;            // The last attempt to load it failed; not in memory.
  std::string note;               // Why it is not in memory, where that needs saying.
};

class SceneWatcher {
 public:
  virtual ~SceneWatcher() = default;
  // Must not block.
  virtual void OnScene(const SceneView& view) = 0;
};

class SceneCatalog : public MemoryBudget {
 public:
  struct CreateOptions {
    std::string scene_id;
    std::optional<Vec3d> origin;
    BvhPreset preset = BvhPreset::kStatic;
    bool anonymous = false;  // `scene_id` was made up.
    bool temporary = false;  // Not stored.
    std::string builtin;     // What CreateBuiltin makes the objects of; empty: they are others.
    std::optional<KdBuildOptions> kd_tree;  // One beside the BVH.
    std::optional<BinaryBvhOptions> binary_bvh;
    bool without_bvh = false;  // REQUIRES, if it is true: kd_tree is set.
    // Of the maker's scenes: the catalog's until the scene is deleted. Null: nobody's.
    std::shared_ptr<CallShare> share;
  };
  struct EditOptions {
    std::string scene_id;
    uint64_t base_revision = 0;             // 0: whichever is current.
    uint64_t base_tag = 0;                  // Of the scene that it is of; 0: whichever is there.
    std::optional<BvhPreset> preset;        // As before.
    std::optional<KdBuildOptions> kd_tree;  // As before.
    std::optional<BinaryBvhOptions> binary_bvh;
  };

  // `repository`, which may be null, outlives the catalog. `evict`: RegistryOptions says.
  SceneCatalog(const Limits& limits, ThreadPool& build_pool,
               const SceneRepository* repository = nullptr, bool evict = false);

  // What can be refused before an upload is received. `arriving`: bytes that it will take itself.
  // AlreadyExists, ResourceExhausted, STORAGE_FAILED where it cannot be told whether the name is
  // that of a stored scene.
  absl::Status CheckRoom(const std::string& scene_id, uint64_t triangles, uint64_t vertices,
                         uint64_t arriving = 0) const;
  // The same for an edit that adds so much: ResourceExhausted. What is wrong with it otherwise is
  // for Edit to say.
  absl::Status CheckEditRoom(const std::string& scene_id, uint64_t triangles,
                             uint64_t vertices) const;
  // Of the scenes' budget.
  absl::Status SetAside(uint64_t bytes) override;
  void GiveBack(uint64_t bytes) override;

  absl::StatusOr<SceneView> Create(const CreateOptions& options,
                                   std::span<const ObjectInput> objects, const CancelToken* cancel);
  // The same of a scene that the server makes itself, `options.builtin` with its "builtin:". Errors
  // are also those of CheckRoom, before anything is made.
  absl::StatusOr<SceneView> CreateBuiltin(const CreateOptions& options, const CancelToken* cancel);
  absl::StatusOr<SceneView> Edit(const EditOptions& options, std::span<const SceneEdit> edits,
                                 const CancelToken* cancel);
  // From memory and from the repository, also what is made at the moment, if it is done by then.
  // STORAGE_FAILED: from neither, if it cannot be told whether there is a file, else from memory
  // alone.
  absl::Status Delete(const std::string& scene_id);

  // ---- The repository. FailedPrecondition (NO_REPOSITORY) without one.

  // A scene of the repository's file `file_id`. Under another id it is stored as a scene of its
  // own; errors are also those of CheckRoom about the name.
  absl::StatusOr<SceneView> CreateFromFile(const CreateOptions& options, const std::string& file_id,
                                           const CancelToken* cancel);
  // A scene of any file, temporary.
  absl::StatusOr<SceneView> CreateFromBytes(const CreateOptions& options, const SceneBytes& file,
                                            const CancelToken* cancel);
  // The scene as it is, if it is loaded already.
  absl::StatusOr<SceneView> Load(const std::string& scene_id, const CancelToken* cancel);
  absl::StatusOr<SceneView> Reload(const std::string& scene_id, const CancelToken* cancel);
  absl::Status Unload(const std::string& scene_id);
  // Loads every scene of the repository that loads; the others stay, with the reason.
  absl::Status LoadAll();
  // For good: what is being stored is given up, its file stays what it was. The end of a call does
  // not do so, since a scene that is made should be stored, whether its maker waits for it or not.
  void StopStoring() { stop_storing_.Cancel(); }
  // In the order of the ids, those after `after`, at most `count`.
  absl::StatusOr<std::vector<StoredScene>> ListStored(const std::string& after, size_t count) const;

  absl::StatusOr<SceneView> Get(const std::string& scene_id) const;
  // In the order of the ids, those after `after`, at most `count`.
  std::vector<SceneView> List(const std::string& after, size_t count) const;
  // The revision to answer on. NotFound (SCENE_NOT_FOUND), FailedPrecondition (REVISION_MISMATCH,
  // SCENE_NOT_READY).
  absl::StatusOr<std::shared_ptr<const Scene>> Pin(const std::string& scene_id,
                                                   uint64_t revision) const;

  // The same with the scene's tag, by which a later scene of its name is told from it.
  absl::StatusOr<std::shared_ptr<const Scene>> PinTagged(const std::string& scene_id,
                                                         uint64_t revision, uint64_t* tag) const;
  // Whether an edit may begin, with the same tag; errors as Pin's, but Aborted (SCENE_BUSY) where
  // there is no revision since the scene is being made, loaded, unloaded or deleted.
  absl::Status CheckEdit(const EditOptions& options, uint64_t* tag) const;
  // As PinTagged, of the scene with this tag alone: REVISION_MISMATCH also where the name is
  // another's.
  absl::StatusOr<std::shared_ptr<const Scene>> PinOf(const std::string& scene_id, uint64_t revision,
                                                     uint64_t tag) const;
  // Whether the scene with this tag still has the name; errors as PinOf's for `revision`. A scene
  // has lost it before the listener hears of its end: who asks after having added something that
  // goes with the scene leaves nothing behind.
  absl::Status CheckTag(const std::string& scene_id, uint64_t revision, uint64_t tag) const;

  void AddWatcher(const std::string& scene_id, std::weak_ptr<SceneWatcher> watcher);
  void RemoveWatcher(const std::string& scene_id, const SceneWatcher* watcher);
  // Told of every change of every scene; set once, before the first scene. That a scene was deleted
  // may be told when another of its name, with another tag, is there already.
  void SetListener(std::function<void(const SceneView&)> listener);

  RequestLog& requests() { return requests_; }
  uint64_t MemoryBytes() const { return registry_.MemoryBytes(); }
  // How many revisions could not be stored.
  uint64_t failed_stores() const { return failed_stores_; }

 private:
  struct Times {
    absl::Time create_time, update_time;
    BvhPreset preset = BvhPreset::kStatic;
    bool temporary = false;
    std::optional<KdBuildOptions> kd_tree = std::nullopt;
    std::optional<BinaryBvhOptions> binary_bvh = std::nullopt;
    bool without_bvh = false;
    bool anonymous = false;
    std::string builtin;

    // From now on edits build as the file was built that `scene` came out of.
    void BuildAs(const Scene& scene);
  };
  // Of a scene that is not in memory, though it might be.
  struct Note {
    bool failed = false;
    std::string text;
  };
  // Whose scene it is, from before it is made until it is deleted: in memory and stored alike.
  struct Share {
    std::string scene_id;
    std::shared_ptr<CallShare> share;
    bool made = false;
  };
  // For the time that a scene of this name is loaded, edited, unloaded or deleted. Aborted
  // (SCENE_BUSY): another call is about it.
  class Move {
   public:
    Move(SceneCatalog* catalog, std::string scene_id)
        : catalog_(catalog), scene_id_(std::move(scene_id)) {}
    Move(Move&& other) noexcept
        : catalog_(std::exchange(other.catalog_, nullptr)), scene_id_(std::move(other.scene_id_)) {}
    Move& operator=(Move&&) = delete;
    ~Move();

   private:
    SceneCatalog* catalog_;
    std::string scene_id_;
  };
  absl::StatusOr<Move> BeginMove(const std::string& scene_id) ABSL_LOCKS_EXCLUDED(mutex_);
  // What is read is charged as it is read.
  absl::StatusOr<SceneBytes> OpenFile(const std::string& file_id, MemoryCharge* charge,
                                      const CancelToken* cancel);
  uint64_t AddTimes(const CreateOptions& options, const Times& times) ABSL_LOCKS_EXCLUDED(mutex_);
  // Of a scene that could not be made, unless it is there after all.
  void DropTimes(const std::string& scene_id, uint64_t tag) ABSL_LOCKS_EXCLUDED(mutex_);
  // The tag of the scene that now has this name; 0, which no scene has, if there is none.
  uint64_t TagNow(const std::string& scene_id) const;
  // What is known of the scene; none once it is forgotten.
  std::optional<Times> TimesOf(uint64_t tag) const ABSL_LOCKS_EXCLUDED(mutex_);
  // Changes it; nothing if it is forgotten.
  void ChangeTimes(uint64_t tag, absl::FunctionRef<void(Times&)> change)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // The scene is made: from now on its share goes with whatever has its name last. Takes `share`
  // for a scene that has none, unless that is null.
  void KeepShare(const std::string& scene_id, uint64_t tag, std::shared_ptr<CallShare> share)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Of the scene `tag`, which was deleted, and if `all`, of every one of this name that is made and
  // not in memory: its file is gone, too.
  void DropShares(const std::string& scene_id, uint64_t tag, bool all) ABSL_LOCKS_EXCLUDED(mutex_);
  // The part of CheckRoom that is about the name, and about one scene more.
  absl::Status CheckName(const std::string& scene_id) const;
  // AlreadyExists if the repository has a scene of this name.
  absl::Status CheckNotStored(const std::string& scene_id) const;
  // The same at a moment when the name is in the registry's books for a new scene: from then on
  // nothing else is stored under it.
  absl::Status CheckFirstOfName(const std::string& scene_id) const ABSL_LOCKS_EXCLUDED(mutex_);
  // Until the file of a scene of before is gone, if it is being removed.
  void WaitForRemoval(const std::string& scene_id) const ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status CheckMemory(uint64_t scene_bytes, uint64_t held) const;
  absl::Status CheckRepository() const;
  // Of a name that is free. `set_aside` becomes the scene's.
  absl::StatusOr<SceneView> Build(const CreateOptions& options,
                                  std::span<const ObjectInput> objects, MemoryCharge* set_aside,
                                  const CancelToken* cancel);
  // What stores a scene's revisions; null if nothing does.
  SceneKeeper KeeperOf(const std::string& scene_id, bool temporary) const;
  // Whose name a scene of a file has: its own, or that of a new scene, which must be free.
  enum class NameOf { kFile, kNewScene };
  // `charge`: of the file, which becomes the scene's.
  absl::StatusOr<SceneView> LoadFile(const CreateOptions& options, const SceneBytes& file,
                                     NameOf name, MemoryCharge* charge, const SceneKeeper& keeper,
                                     const CancelToken* cancel);
  // Takes a scene that the registry has let go of out of the books, and tells of it.
  void Forget(SceneView view) ABSL_LOCKS_EXCLUDED(mutex_);
  void SetNote(const std::string& scene_id, std::optional<Note> note) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::Status NotThere(const std::string& scene_id) const ABSL_LOCKS_EXCLUDED(mutex_);
  // To somebody who asks for a revision of the scene that had the name before.
  absl::Status IsAnother(const std::string& scene_id, uint64_t revision) const;
  void OnChange(const SceneStatus& status);

  SceneBuildOptions BuildOptions(BvhPreset preset,
                                 const std::optional<KdBuildOptions>& kd_tree = std::nullopt,
                                 const std::optional<BinaryBvhOptions>& binary_bvh = std::nullopt,
                                 bool without_bvh = false) const;
  SceneView View(SceneStatus status) const;
  // Whether the name is another scene's by now.
  bool IsSucceeded(const SceneStatus& status) const;
  void Tell(const SceneView& view, bool watchers = true);
  // What a build says, with the reason that its code stands for.
  absl::Status ExplainBuild(absl::Status status, const std::string& scene_id) const;
  absl::Status ExplainEdit(absl::Status status, const EditOptions& options) const;

  const Limits limits_;
  ThreadPool& build_pool_;
  const SceneRepository* const repository_;
  SceneRegistry registry_;
  RequestLog requests_;
  CancelToken stop_storing_;
  mutable std::atomic<uint64_t> failed_stores_ = 0;
  mutable Mutex mutex_;
  mutable CondVar removed_;
  uint64_t tags_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<uint64_t, Times> times_ ABSL_GUARDED_BY(mutex_);   // By SceneStatus::tag.
  std::map<uint64_t, Share> shares_ ABSL_GUARDED_BY(mutex_);  // By the tag it was made with.
  std::set<std::string> moving_ ABSL_GUARDED_BY(mutex_);      // Names; see BeginMove.
  std::set<std::string> removing_ ABSL_GUARDED_BY(mutex_);    // Whose files are being removed.
  std::map<std::string, Note> notes_ ABSL_GUARDED_BY(mutex_);
  std::multimap<std::string, std::weak_ptr<SceneWatcher>> watchers_ ABSL_GUARDED_BY(mutex_);
  std::function<void(const SceneView&)> listener_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_SCENE_CATALOG_H_
