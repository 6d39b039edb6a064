// SPDX-License-Identifier: Apache-2.0
#include "server/points/point_set_store.h"

#include <utility>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "server/base/error.h"
#include "server/base/resource_name.h"

namespace sightline {
namespace {

// Position, source and validity.
constexpr uint64_t kBytesPerPoint = sizeof(Vec3f) + sizeof(uint32_t) + sizeof(uint8_t);

absl::Status NotFound(const std::string& scene_id, const std::string& point_set_id) {
  const std::string name = PointSetNameOf(scene_id, point_set_id);
  return MakeError(absl::StatusCode::kNotFound, v1::ERROR_REASON_POINT_SET_NOT_FOUND,
                   absl::StrCat("there is no point set ", name, ", or its lease ran out"),
                   {{"resource", name}});
}

}  // namespace

uint64_t PointSet::MemoryBytes() const {
  return sizeof(PointSet) + points.positions.capacity() * sizeof(Vec3f) +
         points.sources.capacity() * sizeof(uint32_t) + points.valid.capacity() +
         orders.MemoryBytes();
}

std::string PointSet::name() const { return PointSetNameOf(scene_id, point_set_id); }

absl::Status PointSetStore::RoomLocked(const Key& key, uint64_t bytes) {
  if (sets_.contains(key)) {
    const std::string name = PointSetNameOf(key.first, key.second);
    return MakeError(absl::StatusCode::kAlreadyExists, v1::ERROR_REASON_ALREADY_EXISTS,
                     absl::StrCat(name, " exists already"), {{"resource", name}});
  }
  if (sets_.size() >= limits_.max_point_sets) {
    return OverLimit("point sets", sets_.size() + 1, "max_point_sets", limits_.max_point_sets,
                     "delete one");
  }
  return MemoryLocked(bytes);
}

absl::Status PointSetStore::MemoryLocked(uint64_t bytes) const {
  const uint64_t most = limits_.max_point_set_bytes;
  const uint64_t held = *bytes_;
  if (bytes <= most && held <= most - bytes) return absl::OkStatus();
  return OverLimit("memory that point sets and their uploads would take", held + bytes,
                   "max_point_set_bytes", most,
                   "delete point sets, wait until queries of deleted ones have ended, use fewer "
                   "points, or have the server raise it",
                   v1::ERROR_REASON_OUT_OF_MEMORY_BUDGET);
}

absl::Status PointSetStore::SetAside(uint64_t bytes) {
  Sweep();
  MutexLock lock(mutex_);
  SL_RETURN_IF_ERROR(MemoryLocked(bytes));
  *bytes_ += bytes;
  return absl::OkStatus();
}

void PointSetStore::GiveBack(uint64_t bytes) { *bytes_ -= bytes; }

absl::Status PointSetStore::CheckRoom(const std::string& scene_id, const std::string& point_set_id,
                                      uint64_t points, uint64_t arriving) {
  Sweep();
  MutexLock lock(mutex_);
  return RoomLocked({scene_id, point_set_id}, BytesFor(points) + arriving);
}

uint64_t PointSetStore::BytesFor(uint64_t points) {
  return sizeof(PointSet) + points * kBytesPerPoint;
}

absl::StatusOr<PointSetView> PointSetStore::Add(PointSet set, absl::Duration lease,
                                                uint64_t set_aside) {
  // Also if memory runs out on the way; else under the lock, so that nobody takes it in between.
  absl::Cleanup give_back = [&] { *bytes_ -= set_aside; };
  set.create_time = clock_();
  auto made = std::make_unique<const PointSet>(std::move(set));
  const uint64_t bytes = made->MemoryBytes();
  PointSetView view;
  view.expire_time = made->create_time + lease;
  Sweep();
  MutexLock lock(mutex_);
  std::move(give_back).Invoke();
  const Key key(made->scene_id, made->point_set_id);
  SL_RETURN_IF_ERROR(RoomLocked(key, bytes));
  *bytes_ += bytes;
  view.set =
      std::shared_ptr<const PointSet>(made.release(), [bytes, all = bytes_](const PointSet* freed) {
        delete freed;
        *all -= bytes;
      });
  sets_.emplace(key, view);
  return view;
}

absl::StatusOr<PointSetView> PointSetStore::Get(const std::string& scene_id,
                                                const std::string& point_set_id) const {
  MutexLock lock(mutex_);
  const PointSetView* const found = FindLocked(scene_id, point_set_id);
  if (found == nullptr) return NotFound(scene_id, point_set_id);
  return *found;
}

absl::Status PointSetStore::Remove(const std::string& scene_id, const std::string& point_set_id) {
  std::vector<PointSetView> gone;
  MutexLock lock(mutex_);
  SweepLocked(&gone);
  const auto found = sets_.find({scene_id, point_set_id});
  if (found == sets_.end()) return NotFound(scene_id, point_set_id);
  Erase(found, &gone);
  return absl::OkStatus();
}

absl::StatusOr<PointSetView> PointSetStore::Renew(const std::string& scene_id,
                                                  const std::string& point_set_id,
                                                  absl::Duration lease) {
  MutexLock lock(mutex_);
  if (FindLocked(scene_id, point_set_id) == nullptr) return NotFound(scene_id, point_set_id);
  PointSetView& renewed = sets_.at({scene_id, point_set_id});
  renewed.expire_time = clock_() + lease;
  return renewed;
}

std::vector<PointSetView> PointSetStore::List(const std::string& scene_id, const std::string& after,
                                              size_t count) const {
  std::vector<PointSetView> views;
  MutexLock lock(mutex_);
  const absl::Time now = clock_();
  for (auto i = sets_.upper_bound({scene_id, after});
       i != sets_.end() && i->first.first == scene_id && views.size() < count; ++i) {
    if (i->second.expire_time > now) views.push_back(i->second);
  }
  return views;
}

const PointSetView* PointSetStore::FindLocked(const std::string& scene_id,
                                              const std::string& point_set_id) const {
  const auto found = sets_.find({scene_id, point_set_id});
  if (found == sets_.end() || found->second.expire_time <= clock_()) return nullptr;
  return &found->second;
}

void PointSetStore::RemoveScene(const std::string& scene_id, uint64_t scene_tag) {
  std::vector<PointSetView> gone;
  MutexLock lock(mutex_);
  for (auto i = sets_.lower_bound({scene_id, ""});
       i != sets_.end() && i->first.first == scene_id;) {
    const auto set = i++;
    if (set->second.set->scene_tag == scene_tag) Erase(set, &gone);
  }
}

void PointSetStore::Sweep() {
  std::vector<PointSetView> gone;
  MutexLock lock(mutex_);
  SweepLocked(&gone);
}

void PointSetStore::SweepLocked(std::vector<PointSetView>* gone) {
  const absl::Time now = clock_();
  for (auto i = sets_.begin(); i != sets_.end();) {
    const auto set = i++;
    if (set->second.expire_time <= now) Erase(set, gone);
  }
}

void PointSetStore::Erase(std::map<Key, PointSetView>::iterator set,
                          std::vector<PointSetView>* gone) {
  requests_.ForgetResource(set->second.set->name());
  gone->push_back(std::move(set->second));
  sets_.erase(set);
}

}  // namespace sightline
