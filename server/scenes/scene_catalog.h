// SPDX-License-Identifier: Apache-2.0
//
// The scenes of a server: the engine's registry with what a service needs around it: times,
// repeatable requests, watchers, machine-readable reasons.
//
// Invariants
//  1. A scene is in the catalog exactly while the registry has it.
//  2. A watcher is told of every change after it was added, perhaps skipping states that were
//     overtaken; a deleted scene is its last news.
//
// Thread safety: every method from any thread; none may run on a gRPC thread but Pin, Get, List and
// the watcher methods, which do not compute. Watchers are called without the lock held.
//
//   SceneCatalog catalog(limits, build_pool);
//   absl::StatusOr<SceneView> made = catalog.Create({.scene_id = "hall"}, objects, &cancel);
//   absl::StatusOr<std::shared_ptr<const Scene>> pinned = catalog.Pin("hall", /*revision=*/0);
#ifndef SIGHTLINE_SERVER_SCENES_SCENE_CATALOG_H_
#define SIGHTLINE_SERVER_SCENES_SCENE_CATALOG_H_

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
#include "absl/time/time.h"
#include "core/accel/bvh_builder.h"
#include "core/base/cancel.h"
#include "core/base/mutex.h"
#include "core/base/parallel.h"
#include "core/scene/registry.h"
#include "server/base/limits.h"
#include "server/base/request_log.h"

namespace sightline {

// A scene as it is at one moment.
struct SceneView {
  SceneStatus status;
  absl::Time create_time = absl::InfinitePast();
  absl::Time update_time = absl::InfinitePast();
  bool deleted = false;
};

class SceneWatcher {
 public:
  virtual ~SceneWatcher() = default;
  // Must not block.
  virtual void OnScene(const SceneView& view) = 0;
};

class SceneCatalog {
 public:
  struct CreateOptions {
    std::string scene_id;
    std::optional<Vec3d> origin;
    BvhPreset preset = BvhPreset::kStatic;
  };
  struct EditOptions {
    std::string scene_id;
    uint64_t base_revision = 0;       // 0: whichever is current.
    std::optional<BvhPreset> preset;  // As before.
  };

  SceneCatalog(const Limits& limits, ThreadPool& build_pool);

  // What can be refused before an upload is received. AlreadyExists, ResourceExhausted.
  absl::Status CheckRoom(const std::string& scene_id, uint64_t triangles, uint64_t vertices) const;

  absl::StatusOr<SceneView> Create(const CreateOptions& options,
                                   std::span<const ObjectInput> objects, const CancelToken* cancel);
  absl::StatusOr<SceneView> Edit(const EditOptions& options, std::span<const SceneEdit> edits,
                                 const CancelToken* cancel);
  absl::Status Delete(const std::string& scene_id);

  // `spec` with its "builtin:".
  absl::StatusOr<std::vector<ObjectInput>> MakeBuiltinObjects(const std::string& spec) const;

  absl::StatusOr<SceneView> Get(const std::string& scene_id) const;
  // In the order of the ids, those after `after`, at most `count`.
  std::vector<SceneView> List(const std::string& after, size_t count) const;
  // The revision to answer on. NotFound (SCENE_NOT_FOUND), FailedPrecondition (REVISION_MISMATCH,
  // SCENE_NOT_READY).
  absl::StatusOr<std::shared_ptr<const Scene>> Pin(const std::string& scene_id,
                                                   uint64_t revision) const;

  void AddWatcher(const std::string& scene_id, std::weak_ptr<SceneWatcher> watcher);
  void RemoveWatcher(const std::string& scene_id, const SceneWatcher* watcher);
  // Told of every change of every scene; set once, before the first scene.
  void SetListener(std::function<void(const SceneView&)> listener);

  RequestLog& requests() { return requests_; }
  uint64_t MemoryBytes() const { return registry_.MemoryBytes(); }

 private:
  struct Times {
    absl::Time create_time, update_time;
    BvhPreset preset = BvhPreset::kStatic;
  };
  SceneBuildOptions BuildOptions(BvhPreset preset) const;
  SceneView View(SceneStatus status) const;
  void Tell(const SceneView& view);
  absl::Status ExplainEdit(absl::Status status, const EditOptions& options) const;

  const Limits limits_;
  SceneRegistry registry_;
  RequestLog requests_;
  mutable Mutex mutex_;
  std::map<std::string, Times> times_ ABSL_GUARDED_BY(mutex_);
  std::multimap<std::string, std::weak_ptr<SceneWatcher>> watchers_ ABSL_GUARDED_BY(mutex_);
  std::function<void(const SceneView&)> listener_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_SCENES_SCENE_CATALOG_H_
