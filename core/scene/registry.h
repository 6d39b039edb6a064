// SPDX-License-Identifier: Apache-2.0
//
// The scenes a server holds, by name, under one memory budget. A scene's latest revision is
// replaced by swapping one pointer; older revisions live as long as a query pins them.
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
#include "core/base/mutex.h"
#include "core/scene/scene.h"

namespace sightline {

struct RegistryOptions {
  uint64_t memory_budget_bytes = 8ull << 30;  // Over all scenes and revisions still alive.
  uint64_t max_scenes = 1000;
};

enum class SceneState : uint8_t {
  kBuilding,  // A build is under way; `latest`, if any, serves meanwhile.
  kReady,     // `latest` serves. `error` tells whether the last edit failed.
  kFailed,    // The creation failed: seen by the observer only, the scene is gone.
};

struct SceneStatus {
  std::string name;
  SceneState state = SceneState::kBuilding;
  double progress = 0;  // Share of the running build, 0 .. 1.
  absl::Status error;   // Of the last build, if it failed; the revision before keeps serving.
  std::shared_ptr<const Scene> latest;  // Null until a first build is done.
};

class SceneRegistry {
 public:
  SceneRegistry(const RegistryOptions& options, ThreadPool& pool);

  // Builds and publishes revision 1. AlreadyExists, ResourceExhausted (budget or max_scenes,
  // checked from the sizes before building), and what BuildScene returns. A failed creation leaves
  // nothing behind.
  absl::StatusOr<std::shared_ptr<const Scene>> Create(const std::string& name,
                                                      std::span<const ObjectInput> objects,
                                                      std::optional<Vec3d> origin,
                                                      const SceneBuildOptions& options,
                                                      const CancelToken* cancel = nullptr);

  // Builds and publishes the next revision. Edits of one scene run one at a time: Aborted when
  // another is under way; NotFound; FailedPrecondition when `expected_revision` is not 0 and not
  // the latest.
  absl::StatusOr<std::shared_ptr<const Scene>> Edit(const std::string& name,
                                                    uint64_t expected_revision,
                                                    std::span<const SceneEdit> edits,
                                                    const SceneBuildOptions& options,
                                                    const CancelToken* cancel = nullptr);

  // `revision` 0: the latest; else that one, as long as it is the latest or somebody holds it.
  // NotFound: no such scene (named). FailedPrecondition: that scene has no such revision any more
  // or not yet (both numbers named); Unavailable while its first build runs.
  absl::StatusOr<std::shared_ptr<const Scene>> Get(const std::string& name,
                                                   uint64_t revision) const;

  absl::StatusOr<SceneStatus> GetStatus(const std::string& name) const;
  std::vector<SceneStatus> List() const;  // By name.
  // Queries that pinned a revision finish on it. NotFound; Aborted while a build runs.
  absl::Status Delete(const std::string& name);

  // Called after every change of a scene's status but its deletion, outside the lock, from the
  // changing thread: calls may overlap, and a later change may be told first. May call the
  // registry. Replaces the one before.
  void SetObserver(std::function<void(const SceneStatus&)> observer);

  // Of all revisions still alive and of the builds under way; what the budget bounds.
  uint64_t MemoryBytes() const;
  const RegistryOptions& options() const { return options_; }

 private:
  struct Entry {
    uint64_t creation = 0;  // Tells scenes of the same name apart that came one after the other.
    bool building = false;
    double progress = 0;
    absl::Status error;
    std::shared_ptr<const Scene> latest;
  };
  // A published revision: alive until nobody holds it.
  struct Revision {
    uint64_t creation = 0, number = 0, bytes = 0;
    std::weak_ptr<const Scene> scene;
  };
  using Build = absl::FunctionRef<absl::StatusOr<std::shared_ptr<const Scene>>(
      const std::function<void(double)>& progress)>;

  // Runs `build` for an entry marked as building, with `reserved` bytes set aside, and publishes or
  // reports.
  absl::StatusOr<std::shared_ptr<const Scene>> RunBuild(const std::string& name, uint64_t reserved,
                                                        Build build) ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<std::shared_ptr<const Scene>> Publish(const std::string& name, uint64_t reserved,
                                                       std::shared_ptr<const Scene> scene);
  void Fail(const std::string& name, uint64_t reserved, const absl::Status& error);
  void SetProgress(const std::string& name, double progress);
  void Notify(const SceneStatus& status);

  absl::Status Reserve(const std::string& name, uint64_t bytes)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  uint64_t AliveBytes() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  static SceneStatus StatusOf(const std::string& name, const Entry& entry);

  const RegistryOptions options_;
  ThreadPool& pool_;
  mutable Mutex mutex_;
  std::map<std::string, Entry> entries_ ABSL_GUARDED_BY(mutex_);
  std::vector<Revision> alive_
      ABSL_GUARDED_BY(mutex_);  // Those gone are taken out by the next build.
  uint64_t creations_ ABSL_GUARDED_BY(mutex_) = 0;
  std::shared_ptr<const std::function<void(const SceneStatus&)>> observer_ ABSL_GUARDED_BY(mutex_);
  uint64_t reserved_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // For builds under way.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SCENE_REGISTRY_H_
