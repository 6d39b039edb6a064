// SPDX-License-Identifier: Apache-2.0
#include "core/scene/registry.h"

#include <algorithm>
#include <exception>
#include <limits>
#include <new>
#include <tuple>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/limit_error.h"
#include "core/base/status_macros.h"

namespace sightline {
namespace {

absl::Status NoSuchScene(const std::string& name) {
  return absl::NotFoundError(absl::StrCat("there is no scene \"", name, "\""));
}

// What `run` returns, a Status or a StatusOr, or an error if it throws: memory that runs out in a
// build or a keeper ends it, and must not leave its scene being built for ever.
template <typename Run>
std::invoke_result_t<Run> Guarded(const char* what, const std::string& name, const Run& run) try {
  return run();
} catch (const std::bad_alloc&) {
  return absl::ResourceExhaustedError(
      absl::StrCat("out of memory while ", what, " scene \"", name, "\": free some, or split it"));
} catch (const std::exception& e) {
  return absl::InternalError(absl::StrCat(what, " scene \"", name, "\" failed: ", e.what()));
}

// What a scene of these sizes will hold, in the registry's books.
struct SceneSize {
  uint64_t triangles = 0, vertices = 0, kept_doubles = 0, objects = 0, name_bytes = 0;

  void Add(const ObjectInput& object) {
    triangles += object.indices.size() / 3;
    vertices += object.vertices.size();
    if (object.dynamic) kept_doubles += object.vertices.size();
    AddObject(object.name);
  }
  void AddObject(const std::string& name) {
    ++objects;
    name_bytes += name.size();
  }
  uint64_t bytes(const SceneBuildOptions& options) const {
    return EstimateSceneBytes(triangles, vertices, options) + kept_doubles * sizeof(Vec3d) +
           EstimateObjectBytes(objects, name_bytes);
  }
};

}  // namespace

SceneRegistry::SceneRegistry(const RegistryOptions& options, ThreadPool& pool)
    : options_(options), pool_(pool) {}

absl::Status SceneRegistry::BeginNew(const std::string& name, uint64_t bytes, uint64_t tag,
                                     uint64_t set_aside) {
  SceneStatus status;
  std::vector<Evicted> evicted;
  {
    MutexLock lock(mutex_);
    GiveBackLocked(set_aside);
    if (entries_.contains(name)) {
      return absl::AlreadyExistsError(absl::StrCat("there is a scene \"", name, "\" already"));
    }
    if (entries_.size() >= options_.max_scenes &&
        !(options_.evict_least_used && HasEvictable(name))) {
      return LimitError("max_scenes", options_.max_scenes,
                        absl::StrCat("the server holds ", entries_.size(), " scenes"),
                        "delete one");
    }
    // All that may run out of memory comes before what it would leave half done.
    std::map<std::string, Entry> fresh;
    Entry& entry = fresh[name];
    entry.creation = creations_ + 1;
    entry.tag = tag;
    entry.last_use = uses_;
    entry.building = true;
    status = StatusOf(name, entry);
    SL_RETURN_IF_ERROR(Reserve(name, bytes, &evicted));
    ++creations_;
    entries_.merge(fresh);
  }
  NotifyEvicted(std::move(evicted));
  Notify(status);
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::BeginNext(
    const std::string& name, uint64_t expected_revision,
    absl::FunctionRef<uint64_t(const Scene&)> size, uint64_t* reserved, uint64_t set_aside) {
  // Once more where another revision was published while the size of one was asked.
  while (true) {
    std::shared_ptr<const Scene> base = LatestOf(name);
    *reserved = base != nullptr ? size(*base) : 0;
    SceneStatus status;
    std::vector<Evicted> evicted;
    {
      MutexLock lock(mutex_);
      const auto found = entries_.find(name);
      if (found != entries_.end() && found->second.latest != base) continue;
      GiveBackLocked(set_aside);
      if (found == entries_.end()) return NoSuchScene(name);
      Entry& entry = found->second;
      if (entry.building) {
        return absl::AbortedError(
            absl::StrCat("another build of scene \"", name, "\" is under way: try again after it"));
      }
      if (expected_revision != 0 && expected_revision != base->revision) {
        return absl::FailedPreconditionError(
            absl::StrCat("scene \"", name, "\" is at revision ", base->revision, ", not ",
                         expected_revision, ": look at the change and edit again"));
      }
      std::string told = name;  // Before anything is changed: memory may run out.
      SL_RETURN_IF_ERROR(Reserve(name, *reserved, &evicted));
      entry.building = true;
      entry.progress = 0;
      entry.error = absl::OkStatus();
      status = StatusOf(std::move(told), entry);
    }
    NotifyEvicted(std::move(evicted));
    Notify(status);
    return base;
  }
}

std::shared_ptr<const Scene> SceneRegistry::LatestOf(const std::string& name) const {
  MutexLock lock(mutex_);
  const auto found = entries_.find(name);
  return found != entries_.end() ? found->second.latest : nullptr;
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::Create(
    const std::string& name, std::span<const ObjectInput> objects, std::optional<Vec3d> origin,
    const SceneBuildOptions& options, const CancelToken* cancel, const SceneKeeper& keeper,
    uint64_t tag, uint64_t set_aside) {
  SceneSize size;
  for (const ObjectInput& object : objects) size.Add(object);
  SL_RETURN_IF_ERROR(BeginNew(name, size.bytes(options), tag, set_aside));
  return RunBuild(name, size.bytes(options), /*kept=*/false, keeper,
                  [&](const std::function<void(double)>& progress) {
                    return BuildScene(name, /*revision=*/1, objects, origin, options, pool_, cancel,
                                      progress);
                  });
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::Load(const std::string& name,
                                                                 uint64_t bytes, SceneLoader loader,
                                                                 const SceneKeeper& keeper,
                                                                 uint64_t tag, uint64_t set_aside) {
  SL_RETURN_IF_ERROR(BeginNew(name, bytes, tag, set_aside));
  return RunBuild(name, bytes, /*kept=*/keeper == nullptr, keeper,
                  [&](const std::function<void(double)>& progress) { return loader(0, progress); });
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::Reload(const std::string& name,
                                                                   uint64_t bytes,
                                                                   SceneLoader loader,
                                                                   uint64_t set_aside) {
  uint64_t reserved = 0;
  SL_ASSIGN_OR_RETURN(const std::shared_ptr<const Scene> base,
                      BeginNext(
                          name, 0, [bytes](const Scene&) { return bytes; }, &reserved, set_aside));
  return RunBuild(name, reserved, /*kept=*/true, /*keeper=*/nullptr,
                  [&](const std::function<void(double)>& progress) {
                    return loader(base->revision + 1, progress);
                  });
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::Edit(
    const std::string& name, uint64_t expected_revision, std::span<const SceneEdit> edits,
    const SceneBuildOptions& options, const CancelToken* cancel, const SceneKeeper& keeper) {
  // An upper bound: what is removed or replaced is not taken off.
  const auto size_of = [edits, &options](const Scene& base) {
    SceneSize size;
    for (const SceneEdit& edit : edits) {
      if (edit.kind == SceneEdit::Kind::kAdd) size.Add(edit.object);
      if (edit.kind == SceneEdit::Kind::kSetVertices)
        size.kept_doubles += edit.object.vertices.size();
    }
    size.triangles += base.geometry.triangles.size();
    size.vertices += base.geometry.vertices.size();
    for (const ObjectRecord& object : base.geometry.objects) {
      if (object.source_vertices != nullptr) size.kept_doubles += object.vertex_count;
      size.AddObject(object.name);
    }
    return size.bytes(options);
  };
  uint64_t reserved = 0;
  SL_ASSIGN_OR_RETURN(const std::shared_ptr<const Scene> base,
                      BeginNext(name, expected_revision, size_of, &reserved));
  return RunBuild(
      name, reserved, /*kept=*/false, keeper, [&](const std::function<void(double)>& progress) {
        return EditScene(*base, base->revision + 1, edits, options, pool_, cancel, progress);
      });
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::RunBuild(const std::string& name,
                                                                     uint64_t reserved, bool kept,
                                                                     const SceneKeeper& keeper,
                                                                     Build build) {
  absl::StatusOr<std::shared_ptr<const Scene>> scene = Guarded("building", name, [&] {
    return build([&](double progress) { SetProgress(name, progress); });
  });
  if (!scene.ok()) {
    Fail(name, reserved, scene.status());
    return scene;
  }
  scene = Publish(name, reserved, kept, /*goes_on=*/keeper != nullptr, *std::move(scene));
  if (scene.ok() && keeper != nullptr) {
    EndKeeping(name, Guarded("keeping", name, [&] { return keeper(**scene); }));
  }
  return scene;
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::Publish(
    const std::string& name, uint64_t reserved, bool kept, bool goes_on,
    std::shared_ptr<const Scene> scene) {
  const uint64_t bytes = scene->report.memory_bytes;
  SceneStatus status;
  std::shared_ptr<const Scene> replaced;  // Let go of outside the lock: it may be large.
  absl::Status room;
  {
    MutexLock lock(mutex_);
    // The estimate was reserved; a scene that needs more must fit as well.
    const uint64_t others = AliveBytes() + (reserved_bytes_ - reserved);
    std::erase_if(alive_, [](const Revision& revision) { return revision.scene.expired(); });
    std::vector<Revision>* const alive = &alive_;  // The lock is held, which a lambda cannot say.
    std::string told;
    room = Guarded("publishing", name, [alive, &told, &name] {
      alive->reserve(alive->size() + 1);  // Before anything is changed: both may throw.
      told = name;
      return absl::OkStatus();
    });
    if (room.ok() && (bytes <= reserved || (bytes <= options_.max_bytes_per_scene &&
                                            others <= options_.memory_budget_bytes &&
                                            bytes <= options_.memory_budget_bytes - others))) {
      Entry& entry = entries_.at(name);
      alive_.push_back({entry.creation, scene->revision, bytes, scene});
      reserved_bytes_ -= reserved;
      entry.building = goes_on;
      entry.progress = 1;
      entry.kept = kept;
      entry.keep_error = absl::OkStatus();
      replaced = std::exchange(entry.latest, scene);
      status = StatusOf(std::move(told), entry);
    }
  }
  if (!room.ok()) {
    Fail(name, reserved, room);
    return room;
  }
  if (status.latest == nullptr) {
    const bool alone = bytes > options_.max_bytes_per_scene;
    const absl::Status error = Guarded("publishing", name, [&] {
      return LimitError(
          alone ? "max_bytes_per_scene" : "memory_budget_bytes",
          alone ? options_.max_bytes_per_scene : options_.memory_budget_bytes,
          absl::StrCat("scene \"", name, "\" needs ", bytes, " bytes, more than was foreseen"),
          alone ? "split it, or build it as compact" : "delete a scene");
    });
    Fail(name, reserved, error);
    return error;
  }
  Notify(status);
  return scene;
}

void SceneRegistry::EndKeeping(const std::string& name, const absl::Status& error) {
  std::optional<SceneStatus> status;
  {
    MutexLock lock(mutex_);
    Entry& entry = entries_.at(name);
    entry.building = false;
    entry.kept = error.ok();
    entry.keep_error = error;
    status = TryStatusOf(name, entry);
  }
  if (status.has_value()) Notify(*status);
}

void SceneRegistry::Fail(const std::string& name, uint64_t reserved, const absl::Status& error) {
  std::optional<SceneStatus> status;
  {
    MutexLock lock(mutex_);
    reserved_bytes_ -= reserved;
    const auto found = entries_.find(name);
    SIGHTLINE_CHECK(found != entries_.end());
    Entry& entry = found->second;
    entry.building = false;
    entry.error = error;
    status = TryStatusOf(name, entry);
    if (entry.latest == nullptr) {
      if (status.has_value()) status->state = SceneState::kFailed;
      entries_.erase(found);
    }
  }
  if (status.has_value()) Notify(*status);
}

void SceneRegistry::SetProgress(const std::string& name, double progress) {
  std::optional<SceneStatus> status;
  {
    MutexLock lock(mutex_);
    Entry& entry = entries_.at(name);
    if (progress <= entry.progress) return;  // Threads report out of order.
    entry.progress = progress;
    status = TryStatusOf(name, entry);
  }
  if (status.has_value()) Notify(*status);
}

absl::StatusOr<std::shared_ptr<const Scene>> SceneRegistry::Get(const std::string& name,
                                                                uint64_t revision) const {
  MutexLock lock(mutex_);
  const auto found = entries_.find(name);
  if (found == entries_.end()) return NoSuchScene(name);
  const Entry& entry = found->second;
  if (entry.latest == nullptr) {
    return absl::UnavailableError(
        absl::StrCat("scene \"", name, "\" is being built for the first time: try again later"));
  }
  entry.last_use = ++uses_;
  if (revision == 0 || revision == entry.latest->revision) return entry.latest;
  if (revision < entry.latest->revision) {
    for (const Revision& older : alive_) {
      if (older.creation != entry.creation || older.number != revision) continue;
      if (std::shared_ptr<const Scene> scene = older.scene.lock(); scene != nullptr) return scene;
    }
  }
  return absl::FailedPreconditionError(
      absl::StrCat("scene \"", name, "\" has no revision ", revision,
                   revision < entry.latest->revision ? " any more" : " yet", ": it is at revision ",
                   entry.latest->revision));
}

absl::StatusOr<SceneStatus> SceneRegistry::GetStatus(const std::string& name) const {
  MutexLock lock(mutex_);
  const auto found = entries_.find(name);
  if (found == entries_.end()) return NoSuchScene(name);
  return StatusOf(name, found->second);
}

std::vector<SceneStatus> SceneRegistry::List() const {
  MutexLock lock(mutex_);
  std::vector<SceneStatus> list;
  list.reserve(entries_.size());
  for (const auto& [name, entry] : entries_) list.push_back(StatusOf(name, entry));
  return list;
}

absl::StatusOr<SceneStatus> SceneRegistry::Delete(const std::string& name, bool if_kept) {
  MutexLock lock(mutex_);
  const auto found = entries_.find(name);
  if (found == entries_.end()) return NoSuchScene(name);
  if (found->second.building) {
    return absl::AbortedError(
        absl::StrCat("a build of scene \"", name, "\" is under way: cancel it first"));
  }
  if (if_kept && !found->second.kept) {
    return absl::FailedPreconditionError(
        absl::StrCat("scene \"", name, "\" is in memory alone: keep it first"));
  }
  SceneStatus deleted = StatusOf(name, found->second);
  entries_.erase(found);
  return deleted;  // With its last revision, to be freed outside the lock: it may be large.
}

absl::Status SceneRegistry::SetAside(uint64_t bytes) {
  std::vector<Evicted> evicted;
  absl::Status status;
  {
    MutexLock lock(mutex_);
    if (options_.evict_least_used) MakeRoom(/*name=*/"", bytes, entries_.size(), &evicted);
    status = TakeBytes("a request", bytes);
  }
  NotifyEvicted(std::move(evicted));
  return status;
}

void SceneRegistry::GiveBack(uint64_t bytes) {
  MutexLock lock(mutex_);
  GiveBackLocked(bytes);
}

void SceneRegistry::GiveBackLocked(uint64_t bytes) {
  SIGHTLINE_CHECK(bytes <= reserved_bytes_) << "more was given back than was set aside";
  reserved_bytes_ -= bytes;
}

void SceneRegistry::SetObserver(std::function<void(const SceneStatus&)> observer) {
  auto shared =
      std::make_shared<const std::function<void(const SceneStatus&)>>(std::move(observer));
  MutexLock lock(mutex_);
  observer_.swap(shared);
}

void SceneRegistry::Notify(const SceneStatus& status) {
  std::shared_ptr<const std::function<void(const SceneStatus&)>> observer;
  {
    MutexLock lock(mutex_);
    observer = observer_;
  }
  if (observer == nullptr || !*observer) return;
  try {
    (*observer)(status);
  } catch (const std::bad_alloc&) {
    // What it was to be told stands; a build that ended here would never be settled.
  }
}

uint64_t SceneRegistry::MemoryBytes() const {
  MutexLock lock(mutex_);
  return AliveBytes() + reserved_bytes_;
}

uint64_t SceneRegistry::AliveBytes() const {
  uint64_t bytes = 0;
  for (const Revision& revision : alive_) bytes += revision.scene.expired() ? 0 : revision.bytes;
  return bytes;
}

absl::Status SceneRegistry::Reserve(const std::string& name, uint64_t bytes,
                                    std::vector<Evicted>* evicted) {
  if (bytes > options_.max_bytes_per_scene) {
    return LimitError("max_bytes_per_scene", options_.max_bytes_per_scene,
                      absl::StrCat("scene \"", name, "\" would need about ", bytes, " bytes"),
                      "split it, or build it as compact");
  }
  // Before anything is let go of: memory may run out.
  const std::string what = absl::StrCat("scene \"", name, "\"");
  // One that is there already, a next revision of it, takes no more places.
  const uint64_t scenes = entries_.size() + (entries_.contains(name) ? 0 : 1);
  if (options_.evict_least_used) MakeRoom(name, bytes, scenes, evicted);
  return TakeBytes(what, bytes);
}

absl::Status SceneRegistry::TakeBytes(absl::string_view what, uint64_t bytes) {
  const uint64_t used = AliveBytes() + reserved_bytes_;
  const uint64_t budget = options_.memory_budget_bytes;
  if (used > budget || bytes > budget - used) {
    return LimitError(
        "memory_budget_bytes", budget,
        absl::StrCat(what, " would need about ", bytes, " bytes beside ", used, " in use"),
        "delete a scene, or wait until uploads and builds have ended");
  }
  reserved_bytes_ += bytes;
  return absl::OkStatus();
}

bool SceneRegistry::IsEvictable(const Entry& entry) {
  // A revision that somebody holds would not be freed.
  return !entry.building && entry.kept && entry.latest.use_count() == 1;
}

bool SceneRegistry::HasEvictable(const std::string& name) const {
  return std::any_of(entries_.begin(), entries_.end(), [&](const auto& other) {
    return other.first != name && IsEvictable(other.second);
  });
}

void SceneRegistry::MakeRoom(const std::string& name, uint64_t bytes, uint64_t scenes,
                             std::vector<Evicted>* evicted) {
  const uint64_t budget = options_.memory_budget_bytes;
  uint64_t used = AliveBytes() + reserved_bytes_;
  const auto fits = [&](uint64_t held) { return held <= budget && bytes <= budget - held; };
  if (bytes > budget || (fits(used) && scenes <= options_.max_scenes)) return;
  using Candidate = std::map<std::string, Entry>::iterator;
  std::vector<Candidate> candidates;
  uint64_t candidate_bytes = 0;
  for (auto at = entries_.begin(); at != entries_.end(); ++at) {
    if (at->first == name || !IsEvictable(at->second)) continue;
    candidates.push_back(at);
    candidate_bytes += at->second.latest->report.memory_bytes;
  }
  if (!fits(used - std::min(used, candidate_bytes))) return;
  std::sort(candidates.begin(), candidates.end(), [](Candidate a, Candidate b) {
    return std::tie(a->second.last_use, a->first) < std::tie(b->second.last_use, b->first);
  });
  // All that may run out of memory comes before anything is let go of.
  evicted->reserve(candidates.size());
  for (const Candidate& one : candidates) {
    if (fits(used) && scenes <= options_.max_scenes) break;
    used -= one->second.latest->report.memory_bytes;
    --scenes;
    evicted->push_back({one->first, one->second.tag, one->second.creation, nullptr});
  }
  for (size_t i = 0; i < evicted->size(); ++i) {
    Entry& entry = candidates[i]->second;
    // It is freed as soon as the lock is released, before what it makes room for is built.
    std::erase_if(alive_, [&](const Revision& revision) {
      return revision.creation == entry.creation && revision.number == entry.latest->revision;
    });
    (*evicted)[i].scene = std::move(entry.latest);
    entries_.erase(candidates[i]);
  }
}

void SceneRegistry::NotifyEvicted(std::vector<Evicted> evicted) {
  for (Evicted& one : evicted) {
    one.scene.reset();
    SceneStatus status;
    status.name = std::move(one.name);
    status.tag = one.tag;
    status.creation = one.creation;
    status.state = SceneState::kEvicted;
    Notify(status);
  }
}

std::optional<SceneStatus> SceneRegistry::TryStatusOf(const std::string& name,
                                                      const Entry& entry) try {
  return StatusOf(name, entry);
} catch (const std::bad_alloc&) {
  return std::nullopt;
}

SceneStatus SceneRegistry::StatusOf(std::string name, const Entry& entry) {
  SceneStatus status;
  status.name = std::move(name);
  status.tag = entry.tag;
  status.creation = entry.creation;
  status.state = entry.building ? SceneState::kBuilding : SceneState::kReady;
  status.progress = entry.progress;
  status.error = entry.error;
  status.kept = entry.kept;
  status.keep_error = entry.keep_error;
  status.latest = entry.latest;
  return status;
}

}  // namespace sightline
