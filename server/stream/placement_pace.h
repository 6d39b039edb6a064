// SPDX-License-Identifier: Apache-2.0
//
// How many points a part may have if each has to be placed first (core/query/points.h): as many as
// are placed within a part's time, by what those of the same stream have lately taken. A part's
// rays do not tell: one light's ray costs a twentieth of what it may take to find the triangle that
// the point lies on, and the least of parts (Scheduler::kLeastPartRays) would be many times too
// long.
//
// Thread safety: every method from any thread.
//
//   const uint64_t most = pace.MostPoints();
//   ...
//   pace.Add(points, cpu_time);
#ifndef SIGHTLINE_SERVER_STREAM_PLACEMENT_PACE_H_
#define SIGHTLINE_SERVER_STREAM_PLACEMENT_PACE_H_

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "core/base/mutex.h"
#include "server/admission/scheduler.h"

namespace sightline {

class PlacementPace {
 public:
  // While nothing is known: at 4 us a point, which attaching takes in large scenes, 4 ms.
  static constexpr uint64_t kFirstPoints = 1 << 10;
  // Below it a part's own costs show.
  static constexpr uint64_t kLeastPoints = 64;

  uint64_t MostPoints() const {
    MutexLock lock(mutex_);
    if (!pace_.known()) return kFirstPoints;
    // What takes no measurable time fits any size.
    const double wanted =
        static_cast<double>(Scheduler::kPartTime.count()) / std::max(pace_.nanos_per_ray(), 1e-6);
    return std::max(kLeastPoints, static_cast<uint64_t>(wanted));
  }
  // `time`: of the thread's CPU.
  void Add(uint64_t points, std::chrono::nanoseconds time) {
    MutexLock lock(mutex_);
    pace_.Add(points, time);
  }

 private:
  mutable Mutex mutex_;
  Scheduler::Pace pace_ ABSL_GUARDED_BY(mutex_);  // A point stands for a ray.
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_PLACEMENT_PACE_H_
