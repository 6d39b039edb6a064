// SPDX-License-Identifier: Apache-2.0
//
// The scenes a server holds, by name, under one memory budget. A scene's latest revision is
// replaced by swapping one pointer; older revisions live as long as a query pins them.
//
// A revision may be kept outside of memory too, in a file say: the registry is told by whom (a
// keeper) or that it comes from there (Load, Reload). What is kept can be let go of to make room,
// if the options say so.
//
// Thread safety: every member may be called from any thread. Builds run in the caller's thread and
// the given pool, outside the lock.
//
//   SceneRegistry registry({.memory_budget_bytes = 8ull << 30}, pool);
//   auto scene = registry.Create("hall", objects, std::nullopt, {});
//   auto pinned = registry.Get("hall", /*revision=*/0);   // 0: the latest
#ifndef SIGHTLINE_CORE_SCENE_REGISTRY_H_
#define SIGHTLINE_CORE_SCENE_REGISTRY_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/mutex.h"
#include "core/scene/scene.h"

namespace sightline {

struct RegistryOptions {
  uint64_t memory_budget_bytes = 8ull << 30;  // Over all scenes and revisions still alive.
  uint64_t max_bytes_per_scene = 8ull << 30;  // Of one revision.
  uint64_t max_scenes = 1000;
  // Whether scenes make room for a new one that the budget, or max_scenes, does not hold beside
  // them: those that are kept, that nobody uses at the moment, the least recently used (Get) first,
  // and only as many as it takes. None, if all of them are not enough.
  bool evict_least_used = false;
};

enum class SceneState : uint8_t {
  kBuilding,  // A build is under way; `latest`, if any, serves meanwhile.
  kReady,     // `latest` serves. `error` tells whether the last edit failed.
  kFailed,    // The creation failed: seen by the observer only, the scene is gone.
  kEvicted,   // It made room for another: seen by the observer only, the scene is gone.
};

struct SceneStatus {
  std::string name;
  uint64_t tag = 0;       // What its maker gave it to be told from others of its name.
  uint64_t creation = 0;  // Greater than that of every scene that was begun before it.
  SceneState state = SceneState::kBuilding;
  double progress = 0;      // Share of the running build, 0 .. 1.
  absl::Status error;       // Of the last build, if it failed; the revision before keeps serving.
  bool kept = false;        // `latest` survives the process, ...
  absl::Status keep_error;  // ... or why its keeper failed.
  std::shared_ptr<const Scene> latest;  // Null until a first build is done.
};

// Puts a revision where it survives the process. Called once it is published, while the scene still
// counts as being built: so two revisions of a scene are never kept at once. One that runs out of
// memory has failed with ResourceExhausted, as has a loader.
using SceneKeeper = std::function<absl::Status(const Scene&)>;

// Makes revision `revision` of a scene (0: whichever it was) from where it is kept.
using SceneLoader = absl::FunctionRef<absl::StatusOr<std::shared_ptr<const Scene>>(
    uint64_t revision, const std::function<void(double)>& progress)>;

class SceneRegistry {
 public:
  SceneRegistry(const RegistryOptions& options, ThreadPool& pool);

  // Builds and publishes revision 1. AlreadyExists, ResourceExhausted (budget or max_scenes,
  // checked from the sizes before building), and what BuildScene returns. A failed creation leaves
  // nothing behind. A keeper (may be null) that fails is told by the status; the scene serves.
  // `tag` is in every status of the scene. `set_aside` bytes become the scene's from here on; where
  // it cannot be begun they are given back.
  absl::StatusOr<std::shared_ptr<const Scene>> Create(
      const std::string& name, std::span<const ObjectInput> objects, std::optional<Vec3d> origin,
      const SceneBuildOptions& options, const CancelToken* cancel = nullptr,
      const SceneKeeper& keeper = nullptr, uint64_t tag = 0, uint64_t set_aside = 0);

  // The same for a scene of about `bytes` in memory that `loader` makes: it is kept there, unless a
  // keeper is given to keep it elsewhere. `set_aside`: for what the loader makes it of.
  absl::StatusOr<std::shared_ptr<const Scene>> Load(const std::string& name, uint64_t bytes,
                                                    SceneLoader loader,
                                                    const SceneKeeper& keeper = nullptr,
                                                    uint64_t tag = 0, uint64_t set_aside = 0);
  // Replaces a scene by the next revision, made by `loader`; if that fails the one before goes on
  // serving. Errors as Edit's.
  absl::StatusOr<std::shared_ptr<const Scene>> Reload(const std::string& name, uint64_t bytes,
                                                      SceneLoader loader, uint64_t set_aside = 0);

  // Builds and publishes the next revision. Edits of one scene run one at a time: Aborted when
  // another is under way; NotFound; FailedPrecondition when `expected_revision` is not 0 and not
  // the latest.
  absl::StatusOr<std::shared_ptr<const Scene>> Edit(const std::string& name,
                                                    uint64_t expected_revision,
                                                    std::span<const SceneEdit> edits,
                                                    const SceneBuildOptions& options,
                                                    const CancelToken* cancel = nullptr,
                                                    const SceneKeeper& keeper = nullptr);

  // `revision` 0: the latest; else that one, as long as it is the latest or somebody holds it.
  // NotFound: no such scene (named). FailedPrecondition: that scene has no such revision any more
  // or not yet (both numbers named); Unavailable while its first build runs.
  absl::StatusOr<std::shared_ptr<const Scene>> Get(const std::string& name,
                                                   uint64_t revision) const;

  absl::StatusOr<SceneStatus> GetStatus(const std::string& name) const;
  std::vector<SceneStatus> List() const;  // By name.
  // What was deleted, as it was. Queries that pinned a revision finish on it. NotFound; Aborted
  // while a build runs; FailedPrecondition if `if_kept` and the latest revision is not kept.
  absl::StatusOr<SceneStatus> Delete(const std::string& name, bool if_kept = false);

  // Has `bytes` count against the budget until they are given back, for what is no scene yet, such
  // as an upload that arrives. May let go of scenes, as a build may. ResourceExhausted.
  absl::Status SetAside(uint64_t bytes);
  void GiveBack(uint64_t bytes);

  // Called after every change of a scene's status but its deletion, outside the lock, from the
  // changing thread: calls may overlap, and a later change may be told first. May call the
  // registry. One that runs out of memory misses that change. Replaces the one before.
  void SetObserver(std::function<void(const SceneStatus&)> observer);

  // Of all revisions still alive, of the builds under way and what is set aside: what the budget
  // bounds.
  uint64_t MemoryBytes() const;
  const RegistryOptions& options() const { return options_; }

 private:
  struct Entry {
    uint64_t creation = 0;  // Tells scenes of the same name apart that came one after the other.
    uint64_t tag = 0;       // The maker's way to do so.
    bool building = false;
    double progress = 0;
    absl::Status error;
    bool kept = false;
    absl::Status keep_error;
    mutable uint64_t last_use = 0;
    std::shared_ptr<const Scene> latest;
  };
  // A published revision: alive until nobody holds it.
  struct Revision {
    uint64_t creation = 0, number = 0, bytes = 0;
    std::weak_ptr<const Scene> scene;
  };
  // What was let go of, to be told and freed outside the lock.
  struct Evicted {
    std::string name;
    uint64_t tag = 0, creation = 0;
    std::shared_ptr<const Scene> scene;
  };
  using Build = absl::FunctionRef<absl::StatusOr<std::shared_ptr<const Scene>>(
      const std::function<void(double)>& progress)>;

  // Adds an entry for a first build, with `bytes` set aside in the stead of `set_aside`, which are
  // given back in any case.
  absl::Status BeginNew(const std::string& name, uint64_t bytes, uint64_t tag,
                        uint64_t set_aside = 0) ABSL_LOCKS_EXCLUDED(mutex_);
  // Marks an entry as being built again; its latest revision. `size` says how many bytes that
  // takes, in the stead of `set_aside` as above, and is asked outside the lock: it may look at
  // every object.
  absl::StatusOr<std::shared_ptr<const Scene>> BeginNext(
      const std::string& name, uint64_t expected_revision,
      absl::FunctionRef<uint64_t(const Scene&)> size, uint64_t* reserved, uint64_t set_aside = 0)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Null where there is none.
  std::shared_ptr<const Scene> LatestOf(const std::string& name) const ABSL_LOCKS_EXCLUDED(mutex_);
  // Runs `build` for an entry marked as building, with `reserved` bytes set aside, and publishes or
  // reports. `kept`: what is built is kept already; else `keeper`, unless null, is asked to.
  absl::StatusOr<std::shared_ptr<const Scene>> RunBuild(const std::string& name, uint64_t reserved,
                                                        bool kept, const SceneKeeper& keeper,
                                                        Build build) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<std::shared_ptr<const Scene>> Publish(const std::string& name, uint64_t reserved,
                                                       bool kept, bool goes_on,
                                                       std::shared_ptr<const Scene> scene);
  void EndKeeping(const std::string& name, const absl::Status& error);
  void Fail(const std::string& name, uint64_t reserved, const absl::Status& error);
  void SetProgress(const std::string& name, double progress);
  void Notify(const SceneStatus& status);

  absl::Status Reserve(const std::string& name, uint64_t bytes, std::vector<Evicted>* evicted)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // The last step of both: `what` needs `bytes`, for which there is room or not.
  absl::Status TakeBytes(absl::string_view what, uint64_t bytes)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Lets go of what `bytes` and `scenes` in all need beside what is in use, if that is possible;
  // never of `name`. All of it or, where memory runs out, nothing. REQUIRES: `evicted` is empty.
  void MakeRoom(const std::string& name, uint64_t bytes, uint64_t scenes,
                std::vector<Evicted>* evicted) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  static bool IsEvictable(const Entry& entry);
  // Whether any scene but `name` could be let go of.
  bool HasEvictable(const std::string& name) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void NotifyEvicted(std::vector<Evicted> evicted);
  void GiveBackLocked(uint64_t bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  uint64_t AliveBytes() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  static SceneStatus StatusOf(std::string name, const Entry& entry);
  // The same of what has been changed already: nothing where memory runs out.
  static std::optional<SceneStatus> TryStatusOf(const std::string& name, const Entry& entry);

  const RegistryOptions options_;
  ThreadPool& pool_;
  mutable Mutex mutex_;
  std::map<std::string, Entry> entries_ ABSL_GUARDED_BY(mutex_);
  std::vector<Revision> alive_
      ABSL_GUARDED_BY(mutex_);  // Those gone are taken out by the next build.
  uint64_t creations_ ABSL_GUARDED_BY(mutex_) = 0;
  mutable uint64_t uses_ ABSL_GUARDED_BY(mutex_) = 0;  // Calls of Get that found their scene.
  std::shared_ptr<const std::function<void(const SceneStatus&)>> observer_ ABSL_GUARDED_BY(mutex_);
  // For builds under way, and set aside.
  uint64_t reserved_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SCENE_REGISTRY_H_
