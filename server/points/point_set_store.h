// SPDX-License-Identifier: Apache-2.0
//
// The point sets of a server: prepared points of one scene revision, each under a lease, all under
// one memory budget.
//
// Invariants: a set belongs to one revision of one scene for good; it can be found until its lease
// runs out, it is removed, or its scene is. Queries that found it keep it alive, and its memory
// counts until the last of them has let go of it; what arrives of uploads counts, too.
//
// Thread safety: every method from any thread. Sets may outlive the store.
//
//   SL_RETURN_IF_ERROR(store.CheckRoom("hall", "floor", points));
//   MemoryCharge charge(store);
//   SL_RETURN_IF_ERROR(charge.Add(PointSetStore::BytesFor(points)));
//   absl::StatusOr<PointSetView> made = store.Add(std::move(set), lease, charge.Leave());
#ifndef SIGHTLINE_SERVER_POINTS_POINT_SET_STORE_H_
#define SIGHTLINE_SERVER_POINTS_POINT_SET_STORE_H_

#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "core/base/mutex.h"
#include "core/query/point_order.h"
#include "core/query/points.h"
#include "core/scene/scene.h"
#include "server/admission/memory_charge.h"
#include "server/base/limits.h"
#include "server/base/request_log.h"

namespace sightline {

struct PointSet {
  std::string scene_id, point_set_id;
  uint64_t revision = 0;
  // The revision itself: a scene that was deleted and made again has the same name and number.
  std::weak_ptr<const Scene> scene;
  uint64_t scene_tag = 0;  // SceneStatus::tag, the same of all its revisions.
  PreparedPoints points;
  PointOrders orders;  // Of the points; empty where none helps, or there was no room.
  absl::Time create_time;

  uint64_t MemoryBytes() const;
  std::string name() const;
};

struct PointSetView {
  std::shared_ptr<const PointSet> set;
  absl::Time expire_time;
};

class PointSetStore : public MemoryBudget {
 public:
  using Clock = std::function<absl::Time()>;

  PointSetStore(const Limits& limits, Clock clock) : limits_(limits), clock_(std::move(clock)) {}

  // What can be refused before points are received or traced. `arriving`: bytes that their upload
  // will take itself. AlreadyExists, ResourceExhausted.
  absl::Status CheckRoom(const std::string& scene_id, const std::string& point_set_id,
                         uint64_t points, uint64_t arriving = 0);
  // What so many points will take.
  static uint64_t BytesFor(uint64_t points);
  // `set_aside` bytes become the set's; where it is refused they are given back.
  absl::StatusOr<PointSetView> Add(PointSet set, absl::Duration lease, uint64_t set_aside = 0);

  // NotFound (POINT_SET_NOT_FOUND) for these three.
  absl::StatusOr<PointSetView> Get(const std::string& scene_id,
                                   const std::string& point_set_id) const;
  absl::Status Remove(const std::string& scene_id, const std::string& point_set_id);
  absl::StatusOr<PointSetView> Renew(const std::string& scene_id, const std::string& point_set_id,
                                     absl::Duration lease);

  // The sets of a scene in the order of their ids, those after `after`, at most `count`.
  std::vector<PointSetView> List(const std::string& scene_id, const std::string& after,
                                 size_t count) const;
  // The sets of the scene with this tag; those of a later one of its name stay.
  void RemoveScene(const std::string& scene_id, uint64_t scene_tag);
  // Lets go of sets whose lease ran out, as whatever asks for room does first: their memory is free
  // then, but for what a query holds. That takes time for large ones: not on a gRPC thread, as Get,
  // Renew and List may be called, which free nothing.
  void Sweep();

  absl::Status SetAside(uint64_t bytes) override;
  void GiveBack(uint64_t bytes) override;
  uint64_t memory_bytes() const { return *bytes_; }
  RequestLog& requests() { return requests_; }

 private:
  using Key = std::pair<std::string, std::string>;
  // Moves what has expired to `gone`, so that it is freed without the lock.
  void SweepLocked(std::vector<PointSetView>* gone) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // A set whose lease runs; null: there is none of that name.
  const PointSetView* FindLocked(const std::string& scene_id, const std::string& point_set_id) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status RoomLocked(const Key& key, uint64_t bytes) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  absl::Status MemoryLocked(uint64_t bytes) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Erase(std::map<Key, PointSetView>::iterator set, std::vector<PointSetView>* gone)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Limits limits_;
  const Clock clock_;
  RequestLog requests_;
  mutable Mutex mutex_;
  std::map<Key, PointSetView> sets_ ABSL_GUARDED_BY(mutex_);
  // Of the sets, found or held, and set aside. The lock is held where it grows. The sets', too, who
  // take their bytes off when they are freed.
  const std::shared_ptr<std::atomic<uint64_t>> bytes_ = std::make_shared<std::atomic<uint64_t>>(0);
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_POINTS_POINT_SET_STORE_H_
