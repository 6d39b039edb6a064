// SPDX-License-Identifier: Apache-2.0
//
// The scenes a server holds, by name, under one memory budget. A scene's latest revision is replaced by
// swapping one pointer; older revisions live as long as a query pins them.
//
// Thread safety: every member may be called from any thread. Builds run in the caller's thread and the
// given pool, outside the lock.
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

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "core/scene/scene.h"

namespace sightline {

struct RegistryOptions {
  uint64_t memory_budget_bytes = 8ull << 30;  // Over all scenes and revisions still alive.
  uint64_t max_scenes = 1000;
};

enum class SceneState : uint8_t { kBuilding, kReady, kFailed };

struct SceneStatus {
  std::string name;
  SceneState state = SceneState::kBuilding;
  double progress = 0;            // Share of the running build, 0 .. 1.
  absl::Status error;             // Of the last build that failed; the revision before keeps serving.
  std::shared_ptr<const Scene> latest;  // Null until a first build is done.
};

class SceneRegistry {
 public:
  SceneRegistry(const RegistryOptions& options, ThreadPool& pool);

  // Builds and publishes revision 1. AlreadyExists, ResourceExhausted (budget or max_scenes, checked from the
  // sizes before building), and what BuildScene returns. A failed creation leaves nothing behind.
  absl::StatusOr<std::shared_ptr<const Scene>> Create(
      const std::string& name, std::span<const ObjectInput> objects, std::optional<Vec3d> origin,
      const SceneBuildOptions& options, const CancelToken* cancel = nullptr);

  // Builds and publishes the next revision. Edits of one scene run one at a time: Aborted when another is
  // under way; NotFound; FailedPrecondition when `expected_revision` is not 0 and not the latest.
  absl::StatusOr<std::shared_ptr<const Scene>> Edit(const std::string& name,
                                                    uint64_t expected_revision,
                                                    std::span<const SceneEdit> edits,
                                                    const SceneBuildOptions& options,
                                                    const CancelToken* cancel = nullptr);

  // `revision` 0: the latest. NotFound: no such scene (named). FailedPrecondition: that scene has no such
  // revision any more or not yet (both numbers named); Unavailable while its first build runs.
  absl::StatusOr<std::shared_ptr<const Scene>> Get(const std::string& name, uint64_t revision) const;

  absl::StatusOr<SceneStatus> GetStatus(const std::string& name) const;
  std::vector<SceneStatus> List() const;  // By name.
  // Queries that pinned a revision finish on it. NotFound; Aborted while a build runs.
  absl::Status Delete(const std::string& name);

  // Called after every change of a scene's status, outside the lock, from the changing thread.
  void SetObserver(std::function<void(const SceneStatus&)> observer);

  uint64_t MemoryBytes() const;
  const RegistryOptions& options() const { return options_; }

 private:
  struct Entry;
  const RegistryOptions options_;
  ThreadPool& pool_;
  mutable Mutex mutex_;
  std::map<std::string, std::shared_ptr<Entry>> entries_ ABSL_GUARDED_BY(mutex_);
  std::function<void(const SceneStatus&)> observer_ ABSL_GUARDED_BY(mutex_);
  uint64_t reserved_bytes_ ABSL_GUARDED_BY(mutex_) = 0;  // For builds under way.
};

}  // namespace sightline

#endif  // SIGHTLINE_CORE_SCENE_REGISTRY_H_
