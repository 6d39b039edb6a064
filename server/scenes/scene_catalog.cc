// SPDX-License-Identifier: Apache-2.0
#include "server/scenes/scene_catalog.h"

#include <algorithm>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"
#include "absl/time/clock.h"
#include "core/base/array_memory.h"
#include "core/base/limit_error.h"
#include "core/base/status_macros.h"
#include "core/mesh/builtin/builtin.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"

namespace sightline {
namespace {

constexpr absl::string_view kBuiltinPrefix = "builtin:";
// Of a scene that was made of objects.
constexpr uint64_t kFirstRevision = 1;
// What helps against too little memory in all, and against too much in one.
constexpr char kFreeMemory[] =
    "delete or unload a scene, wait until uploads have ended, or have the server raise it";
constexpr char kSplitScene[] = "split it into several scenes";

// What the server calls a limit of the engine's.
std::string PublishedLimit(const std::string& name) {
  if (name == "memory_budget_bytes") return "max_scene_bytes";
  if (name == "max_scenes" || name == "max_bytes_per_scene") return name;
  return absl::StrCat(name, "_per_scene");
}

// At least, of each triangle that a built-in scene is made of: its indices, and half a vertex.
constexpr uint64_t kBuiltinInputBytes = 3 * sizeof(uint32_t) + sizeof(Vec3d) / 2;

// A built-in scene has within a tenth of what it was asked for.
uint64_t LeastTriangles(const BuiltinSpec& spec) {
  uint64_t target = spec.target_triangles;
  for (const BuiltinInfo& info : BuiltinScenes()) {
    if (target == 0 && info.name == spec.name) target = info.default_triangles;
  }
  return target / 10 * 9;
}

// The spec with every part written out; empty for none.
std::string FullBuiltin(absl::string_view spec) {
  if (!absl::ConsumePrefix(&spec, kBuiltinPrefix)) return "";
  const absl::StatusOr<BuiltinSpec> parsed = ParseBuiltin(std::string(spec));
  return parsed.ok() ? absl::StrCat(kBuiltinPrefix, FormatBuiltin(*parsed)) : "";
}

absl::Status ExhaustedError(absl::Status status, uint64_t budget) {
  if (const std::optional<ExceededLimit> limit = ExceededLimitOf(status)) {
    const std::string published = PublishedLimit(limit->name);
    const bool memory = published == "max_scene_bytes" || published == "max_bytes_per_scene";
    return MakeError(
        status.code(),
        memory ? v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET : v1::ERROR_REASON_LIMIT_EXCEEDED,
        absl::StrReplaceAll(status.message(), {{limit->name, published}}),
        {{"limit", published}, {"limit_value", absl::StrCat(limit->value)}});
  }
  return WithReason(std::move(status), v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET,
                    {{"limit", "max_scene_bytes"}, {"limit_value", absl::StrCat(budget)}});
}

// A scene that nothing can hit is some mistake of its maker's.
absl::Status CheckCanBeHit(const SceneGeometry& geometry, const std::string& scene_id) {
  if (geometry.triangles.size() != geometry.inert.size()) return absl::OkStatus();
  const MeshReport& report = geometry.report;
  return absl::InvalidArgumentError(
      absl::StrCat("no triangle of ", SceneName(scene_id), " can be hit: of ", report.triangles,
                   ", ", report.non_finite_triangles, " are not finite and ",
                   report.zero_area_triangles, " have no area"));
}

}  // namespace

absl::Status SceneCatalog::ExplainBuild(absl::Status status, const std::string& scene_id) const {
  const uint64_t budget = limits_.max_scene_bytes;
  switch (status.code()) {
    case absl::StatusCode::kAlreadyExists:
      return WithReason(std::move(status), v1::ERROR_REASON_ALREADY_EXISTS,
                        SceneResource(scene_id));
    case absl::StatusCode::kResourceExhausted:
      return ExhaustedError(std::move(status), budget);
    case absl::StatusCode::kInvalidArgument:
      return WithReason(std::move(status), v1::ERROR_REASON_UNUSABLE_UPLOAD);
    case absl::StatusCode::kAborted:
      return WithReason(std::move(status), v1::ERROR_REASON_SCENE_BUSY, SceneResource(scene_id));
    default:
      return status;
  }
}

SceneCatalog::SceneCatalog(const Limits& limits, ThreadPool& build_pool,
                           const SceneRepository* repository, bool evict)
    : limits_(limits),
      build_pool_(build_pool),
      repository_(repository),
      registry_({.memory_budget_bytes = limits.max_scene_bytes,
                 .max_bytes_per_scene = limits.max_bytes_per_scene,
                 .max_scenes = limits.max_scenes,
                 .evict_least_used = evict},
                build_pool) {
  registry_.SetObserver([this](const SceneStatus& status) { OnChange(status); });
}

void SceneCatalog::OnChange(const SceneStatus& status) {
  if (status.state != SceneState::kEvicted) return Tell(View(status));
  SceneView view = View(status);
  view.unloaded = true;
  if (!IsSucceeded(status)) {
    SetNote(status.name, Note{false, "it was unloaded to make room for another scene"});
  }
  Forget(std::move(view));
}

absl::Status SceneCatalog::NotThere(const std::string& scene_id) const {
  std::string note;
  {
    MutexLock lock(mutex_);
    if (const auto found = notes_.find(scene_id); found != notes_.end()) note = found->second.text;
  }
  if (!note.empty()) {
    return MakeError(absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_SCENE_NOT_READY,
                     absl::StrCat(SceneName(scene_id), " is not loaded: ", note, ". Load it first"),
                     SceneResource(scene_id));
  }
  return MakeError(absl::StatusCode::kNotFound, v1::ERROR_REASON_SCENE_NOT_FOUND,
                   absl::StrCat("there is no scene ", SceneName(scene_id)),
                   SceneResource(scene_id));
}

SceneBuildOptions SceneCatalog::BuildOptions(BvhPreset preset,
                                             const std::optional<KdBuildOptions>& kd_tree,
                                             const std::optional<BinaryBvhOptions>& binary_bvh,
                                             bool without_bvh) const {
  SceneBuildOptions options;
  options.limits = {.max_triangles = limits_.max_triangles_per_scene,
                    .max_vertices = limits_.max_vertices_per_scene,
                    .max_objects = limits_.max_objects_per_scene};
  options.bvh = BvhPresetOptions(preset);
  options.kd_tree = kd_tree;
  options.binary_bvh = binary_bvh;
  options.without_bvh = without_bvh;
  return options;
}

absl::Status SceneCatalog::CheckRoom(const std::string& scene_id, uint64_t triangles,
                                     uint64_t vertices, uint64_t arriving) const {
  SL_RETURN_IF_ERROR(CheckName(scene_id));
  const uint64_t held = registry_.options().evict_least_used ? 0 : registry_.MemoryBytes();
  return CheckMemory(EstimateSceneBytes(triangles, vertices), held + arriving);
}

absl::Status SceneCatalog::CheckName(const std::string& scene_id) const {
  if (registry_.GetStatus(scene_id).ok()) {
    return MakeError(absl::StatusCode::kAlreadyExists, v1::ERROR_REASON_ALREADY_EXISTS,
                     absl::StrCat(SceneName(scene_id), " exists already"), SceneResource(scene_id));
  }
  SL_RETURN_IF_ERROR(CheckNotStored(scene_id));
  const uint64_t scenes = registry_.List().size();
  if (scenes >= limits_.max_scenes && !registry_.options().evict_least_used) {
    return OverLimit("scenes", scenes + 1, "max_scenes", limits_.max_scenes,
                     "delete or unload one");
  }
  return absl::OkStatus();
}

absl::Status SceneCatalog::CheckEditRoom(const std::string& scene_id, uint64_t triangles,
                                         uint64_t vertices) const {
  const absl::StatusOr<SceneStatus> base = registry_.GetStatus(scene_id);
  if (!base.ok() || base->latest == nullptr) return absl::OkStatus();
  const SceneGeometry& geometry = base->latest->geometry;
  // Without the structures that a kd-tree alone may do without: never more than the edit needs.
  const uint64_t needed = EstimateSceneBytes(geometry.triangles.size() + triangles,
                                             geometry.vertices.size() + vertices);
  // The revision before goes on serving meanwhile.
  const uint64_t held = registry_.options().evict_least_used ? base->latest->report.memory_bytes
                                                             : registry_.MemoryBytes();
  return CheckMemory(needed, held);
}

absl::Status SceneCatalog::CheckMemory(uint64_t scene_bytes, uint64_t held) const {
  const uint64_t budget = limits_.max_scene_bytes;
  if (scene_bytes > budget || held > budget - scene_bytes) {
    return OverLimit("memory that scenes and their uploads would take", held + scene_bytes,
                     "max_scene_bytes", budget, kFreeMemory, v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  }
  if (scene_bytes > limits_.max_bytes_per_scene) {
    return OverLimit("memory that the scene would take", scene_bytes, "max_bytes_per_scene",
                     limits_.max_bytes_per_scene, kSplitScene,
                     v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
  }
  return absl::OkStatus();
}

absl::Status SceneCatalog::SetAside(uint64_t bytes) {
  absl::Status status = registry_.SetAside(bytes);
  return status.ok() ? status : ExhaustedError(std::move(status), limits_.max_scene_bytes);
}

void SceneCatalog::GiveBack(uint64_t bytes) { registry_.GiveBack(bytes); }

uint64_t SceneCatalog::AddTimes(const CreateOptions& options, const Times& times) {
  MutexLock lock(mutex_);
  times_.emplace(++tags_, times);
  if (options.share != nullptr) shares_.emplace(tags_, Share{options.scene_id, options.share});
  return tags_;
}

void SceneCatalog::DropTimes(const std::string& scene_id, uint64_t tag) {
  if (const auto now = registry_.GetStatus(scene_id); now.ok() && now->tag == tag) {
    return KeepShare(scene_id, tag, nullptr);
  }
  MutexLock lock(mutex_);
  times_.erase(tag);
  shares_.erase(tag);
}

void SceneCatalog::KeepShare(const std::string& scene_id, uint64_t tag,
                             std::shared_ptr<CallShare> share) {
  {
    MutexLock lock(mutex_);
    const auto own = shares_.find(tag);
    if (own != shares_.end()) {
      own->second.made = true;
    } else if (share != nullptr) {
      // One that was loaded is whose it was before.
      const bool owned = std::any_of(shares_.begin(), shares_.end(), [&](const auto& other) {
        return other.second.scene_id == scene_id;
      });
      if (!owned) shares_.emplace(tag, Share{scene_id, std::move(share), /*made=*/true});
    }
  }
  // It may have been deleted since it was published.
  const auto now = registry_.GetStatus(scene_id);
  if (now.ok() && now->tag == tag) return;
  // Where that cannot be told, the file may be there: so its maker's share stays.
  const absl::StatusOr<bool> stored = repository_ == nullptr ? false : repository_->Has(scene_id);
  if (stored.ok() && !*stored) DropShares(scene_id, tag, false);
}

void SceneCatalog::DropShares(const std::string& scene_id, uint64_t tag, bool all) {
  MutexLock lock(mutex_);
  // Under the lock: what was made until now is there.
  const auto now = registry_.GetStatus(scene_id);
  std::erase_if(shares_, [&](const auto& entry) {
    const Share& share = entry.second;
    return share.scene_id == scene_id && (entry.first == tag || (all && share.made)) &&
           !(now.ok() && now->tag == entry.first);
  });
}

std::optional<SceneCatalog::Times> SceneCatalog::TimesOf(uint64_t tag) const {
  MutexLock lock(mutex_);
  const auto times = times_.find(tag);
  return times == times_.end() ? std::nullopt : std::optional<Times>(times->second);
}

void SceneCatalog::ChangeTimes(uint64_t tag, absl::FunctionRef<void(Times&)> change) {
  MutexLock lock(mutex_);
  if (const auto times = times_.find(tag); times != times_.end()) change(times->second);
}

absl::StatusOr<SceneView> SceneCatalog::Create(const CreateOptions& options,
                                               std::span<const ObjectInput> objects,
                                               const CancelToken* cancel) {
  uint64_t triangles = 0, vertices = 0;
  for (const ObjectInput& object : objects) {
    triangles += object.indices.size() / 3;
    vertices += object.vertices.size();
  }
  SL_RETURN_IF_ERROR(CheckRoom(options.scene_id, triangles, vertices));
  MemoryCharge nothing(*this);  // What arrived is the caller's.
  return Build(options, objects, &nothing, cancel);
}

absl::StatusOr<SceneView> SceneCatalog::Build(const CreateOptions& options,
                                              std::span<const ObjectInput> objects,
                                              MemoryCharge* set_aside, const CancelToken* cancel) {
  const absl::Time now = absl::Now();
  const uint64_t tag =
      AddTimes(options, Times{now, now, options.preset, options.temporary, options.kd_tree,
                              options.binary_bvh, options.without_bvh, options.anonymous,
                              FullBuiltin(options.builtin)});
  SceneBuildOptions build =
      BuildOptions(options.preset, options.kd_tree, options.binary_bvh, options.without_bvh);
  build.accept = [&](const SceneGeometry& geometry) {
    SL_RETURN_IF_ERROR(CheckFirstOfName(options.scene_id));
    return CheckCanBeHit(geometry, options.scene_id);
  };
  const absl::Status status =
      registry_
          .Create(options.scene_id, objects, options.origin, build, cancel,
                  KeeperOf(options.scene_id, options.temporary), tag, set_aside->Leave())
          .status();
  if (!status.ok()) {
    DropTimes(options.scene_id, tag);
    return ExplainBuild(status, options.scene_id);
  }
  KeepShare(options.scene_id, tag, nullptr);
  return Get(options.scene_id);
}

absl::StatusOr<SceneView> SceneCatalog::Edit(const EditOptions& options,
                                             std::span<const SceneEdit> edits,
                                             const CancelToken* cancel) {
  const std::string& id = options.scene_id;
  // What the next edit takes for "as before" is what this one leaves.
  SL_ASSIGN_OR_RETURN(const Move move, BeginMove(id));
  const uint64_t tag = TagNow(id);
  std::optional<Times> times = TimesOf(tag);
  if (!times.has_value()) return NotThere(id);
  if (options.base_tag != 0 && options.base_tag != tag) {
    return IsAnother(id, options.base_revision);
  }
  if (options.preset.has_value()) times->preset = *options.preset;
  if (options.kd_tree.has_value()) times->kd_tree = options.kd_tree;
  if (options.binary_bvh.has_value()) times->binary_bvh = options.binary_bvh;
  // One that came out of a file has structures that nobody here asked for.
  Times build = *times;
  if (const auto base = registry_.GetStatus(id); base.ok() && base->latest != nullptr) {
    const Scene& latest = *base->latest;
    if (!build.kd_tree.has_value() && latest.kd_tree) {
      build.kd_tree = KdBuildOptions{.perfect_splits = latest.kd_tree->perfect(),
                                     .lay_out_leaves = latest.kd_leaves.has_value()};
    }
    if (!build.binary_bvh.has_value() && latest.binary_bvh) build.binary_bvh.emplace();
    build.without_bvh = build.without_bvh || latest.kd_tree_alone();
  }
  const absl::Status edited =
      registry_
          .Edit(id, options.base_revision, edits,
                BuildOptions(build.preset, build.kd_tree, build.binary_bvh, build.without_bvh),
                cancel, KeeperOf(id, build.temporary))
          .status();
  if (!edited.ok()) return ExplainEdit(edited, options);
  times->update_time = absl::Now();
  ChangeTimes(tag, [&](Times& known) { known = *std::move(times); });
  return Get(id);
}

absl::Status SceneCatalog::ExplainEdit(absl::Status status, const EditOptions& options) const {
  const absl::StatusOr<SceneStatus> now = registry_.GetStatus(options.scene_id);
  if (absl::IsNotFound(status)) {
    if (!now.ok()) return NotThere(options.scene_id);
    return WithReason(std::move(status), v1::ERROR_REASON_OBJECT_NOT_FOUND,
                      SceneResource(options.scene_id));
  }
  if (absl::IsFailedPrecondition(status)) {
    const uint64_t current = now.ok() && now->latest != nullptr ? now->latest->revision : 0;
    if (options.base_revision != 0 && options.base_revision != current) {
      return WithReason(std::move(status), v1::ERROR_REASON_REVISION_MISMATCH,
                        {{"resource", SceneName(options.scene_id)},
                         {"value", absl::StrCat(options.base_revision)},
                         {"current", absl::StrCat(current)}});
    }
    return WithReason(std::move(status), v1::ERROR_REASON_EDIT_NOT_POSSIBLE,
                      SceneResource(options.scene_id));
  }
  return ExplainBuild(std::move(status), options.scene_id);
}

void SceneCatalog::Forget(SceneView view) {
  const std::string scene_id = view.status.name;
  {
    MutexLock lock(mutex_);
    times_.erase(view.status.tag);
  }
  view.deleted = true;
  view.status.latest.reset();
  // What goes by the name is the other's by then; those that watch the name see it.
  const bool last = !IsSucceeded(view.status);
  if (last) requests_.ForgetResource(SceneName(scene_id));
  Tell(view, /*watchers=*/last);
  ReturnFreeMemory();
}

absl::StatusOr<SceneView> SceneCatalog::CreateBuiltin(const CreateOptions& options,
                                                      const CancelToken* cancel) {
  const std::string& spec = options.builtin;
  const auto explain = [&](absl::Status status) {
    return WithReason(std::move(status), v1::ERROR_REASON_INVALID_FIELD,
                      {{"field", "builtin.spec"}, {"value", spec}});
  };
  if (!absl::StartsWith(spec, kBuiltinPrefix)) {
    return InvalidField("builtin.spec", spec, "must be builtin:NAME[:TRIANGLES][,seed=N]");
  }
  absl::StatusOr<BuiltinSpec> parsed = ParseBuiltin(spec.substr(kBuiltinPrefix.size()));
  if (!parsed.ok()) return explain(parsed.status());
  if (parsed->target_triangles > limits_.max_triangles_per_scene) {
    return OverLimit("builtin.spec triangles", parsed->target_triangles, "max_triangles_per_scene",
                     limits_.max_triangles_per_scene, "ask for fewer");
  }
  const uint64_t triangles = LeastTriangles(*parsed);
  SL_RETURN_IF_ERROR(CheckRoom(options.scene_id, triangles, 0));
  // Before anything is made: several of these may be under way.
  MemoryCharge input(*this), scene(*this);
  SL_RETURN_IF_ERROR(input.Add(triangles * kBuiltinInputBytes));
  SL_RETURN_IF_ERROR(scene.Add(EstimateSceneBytes(triangles, 0)));
  absl::StatusOr<BuiltinScene> made = MakeBuiltin(*parsed, cancel);
  if (cancel != nullptr) SL_RETURN_IF_ERROR(cancel->ToStatus());
  if (!made.ok()) return explain(made.status());
  SL_RETURN_IF_ERROR(CheckName(options.scene_id));  // It took a while.
  return Build(options, made->objects, &scene, cancel);
}

absl::StatusOr<SceneView> SceneCatalog::Get(const std::string& scene_id) const {
  absl::StatusOr<SceneStatus> status = registry_.GetStatus(scene_id);
  if (!status.ok()) return NotThere(scene_id);
  return View(*std::move(status));
}

std::vector<SceneView> SceneCatalog::List(const std::string& after, size_t count) const {
  std::vector<SceneView> views;
  for (SceneStatus& status : registry_.List()) {
    if (views.size() == count) break;
    if (status.name > after) views.push_back(View(std::move(status)));
  }
  return views;
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneCatalog::Pin(const std::string& scene_id,
                                                               uint64_t revision) const {
  absl::StatusOr<std::shared_ptr<const Scene>> scene = registry_.Get(scene_id, revision);
  if (scene.ok()) return scene;
  const absl::StatusOr<SceneStatus> now = registry_.GetStatus(scene_id);
  if (!now.ok()) return NotThere(scene_id);
  if (now->latest == nullptr) {
    return MakeError(absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_SCENE_NOT_READY,
                     absl::StrCat(SceneName(scene_id), " is still being built"),
                     SceneResource(scene_id));
  }
  return WithReason(scene.status(), v1::ERROR_REASON_REVISION_MISMATCH,
                    {{"resource", SceneName(scene_id)},
                     {"value", absl::StrCat(revision)},
                     {"current", absl::StrCat(now->latest->revision)}});
}

uint64_t SceneCatalog::TagNow(const std::string& scene_id) const {
  const absl::StatusOr<SceneStatus> now = registry_.GetStatus(scene_id);
  return now.ok() ? now->tag : 0;
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneCatalog::PinTagged(const std::string& scene_id,
                                                                     uint64_t revision,
                                                                     uint64_t* tag) const {
  for (;;) {
    *tag = TagNow(scene_id);
    SL_ASSIGN_OR_RETURN(std::shared_ptr<const Scene> scene, Pin(scene_id, revision));
    if (TagNow(scene_id) == *tag) return scene;
  }
}

absl::Status SceneCatalog::CheckEdit(const EditOptions& options, uint64_t* tag) const {
  absl::Status status = PinTagged(options.scene_id, options.base_revision, tag).status();
  if (status.ok()) return status;
  const absl::StatusOr<SceneStatus> now = registry_.GetStatus(options.scene_id);
  {
    MutexLock lock(mutex_);
    const bool busy = now.ok() ? now->latest == nullptr : moving_.contains(options.scene_id);
    if (!busy) return status;
  }
  return MakeError(
      absl::StatusCode::kAborted, v1::ERROR_REASON_SCENE_BUSY,
      absl::StrCat(SceneName(options.scene_id),
                   " is still being made, loaded, unloaded or deleted: try again after that"),
      SceneResource(options.scene_id));
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneCatalog::PinOf(const std::string& scene_id,
                                                                 uint64_t revision,
                                                                 uint64_t tag) const {
  uint64_t now = 0;
  absl::StatusOr<std::shared_ptr<const Scene>> scene = PinTagged(scene_id, revision, &now);
  if (now == tag || (now == 0 && !scene.ok())) return scene;
  return IsAnother(scene_id, revision);
}

absl::Status SceneCatalog::CheckTag(const std::string& scene_id, uint64_t revision,
                                    uint64_t tag) const {
  const uint64_t now = TagNow(scene_id);
  if (now == 0) return NotThere(scene_id);
  return now == tag ? absl::OkStatus() : IsAnother(scene_id, revision);
}

absl::Status SceneCatalog::IsAnother(const std::string& scene_id, uint64_t revision) const {
  const absl::StatusOr<SceneStatus> now = registry_.GetStatus(scene_id);
  const uint64_t current = now.ok() && now->latest != nullptr ? now->latest->revision : 0;
  return MakeError(absl::StatusCode::kFailedPrecondition, v1::ERROR_REASON_REVISION_MISMATCH,
                   absl::StrCat(SceneName(scene_id), " is another scene by now: the one whose ",
                                "revision ", revision, " this is about was deleted or unloaded. ",
                                "Begin again with what is there"),
                   {{"resource", SceneName(scene_id)},
                    {"value", absl::StrCat(revision)},
                    {"current", absl::StrCat(current)}});
}

bool SceneCatalog::IsSucceeded(const SceneStatus& status) const {
  const absl::StatusOr<SceneStatus> now = registry_.GetStatus(status.name);
  return now.ok() && now->tag != status.tag;
}

SceneView SceneCatalog::View(SceneStatus status) const {
  SceneView view;
  {
    MutexLock lock(mutex_);
    if (const auto times = times_.find(status.tag); times != times_.end()) {
      view.create_time = times->second.create_time;
      view.update_time = times->second.update_time;
      view.anonymous = times->second.anonymous;
      // What an edit or a reload made is something else.
      if (status.latest != nullptr && status.latest->revision == kFirstRevision) {
        view.builtin = times->second.builtin;
      }
    }
  }
  view.status = std::move(status);
  return view;
}

void SceneCatalog::AddWatcher(const std::string& scene_id, std::weak_ptr<SceneWatcher> watcher) {
  MutexLock lock(mutex_);
  watchers_.emplace(scene_id, std::move(watcher));
}

void SceneCatalog::RemoveWatcher(const std::string& scene_id, const SceneWatcher* watcher) {
  MutexLock lock(mutex_);
  const auto [first, last] = watchers_.equal_range(scene_id);
  for (auto i = first; i != last;) {
    const std::shared_ptr<SceneWatcher> held = i->second.lock();
    i = held == nullptr || held.get() == watcher ? watchers_.erase(i) : std::next(i);
  }
}

void SceneCatalog::SetListener(std::function<void(const SceneView&)> listener) {
  MutexLock lock(mutex_);
  listener_ = std::move(listener);
}

void SceneCatalog::Tell(const SceneView& view, bool watchers) {
  std::vector<std::shared_ptr<SceneWatcher>> told;
  std::function<void(const SceneView&)> listener;
  {
    MutexLock lock(mutex_);
    listener = listener_;
    const auto [first, last] = watchers_.equal_range(view.status.name);
    for (auto i = first; watchers && i != last; ++i) {
      if (std::shared_ptr<SceneWatcher> watcher = i->second.lock()) told.push_back(watcher);
    }
  }
  if (listener) listener(view);
  for (const auto& watcher : told) watcher->OnScene(view);
}

}  // namespace sightline
