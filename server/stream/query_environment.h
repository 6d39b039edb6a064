// SPDX-License-Identifier: Apache-2.0
//
// What queries need of the server: scenes, point sets, threads, limits, admission.
//
// Thread safety: every part has its own; the struct is constant. Everything in it outlives the
// calls.
#ifndef SIGHTLINE_SERVER_STREAM_QUERY_ENVIRONMENT_H_
#define SIGHTLINE_SERVER_STREAM_QUERY_ENVIRONMENT_H_

#include "core/base/parallel.h"
#include "server/admission/call_quota.h"
#include "server/admission/call_tracker.h"
#include "server/admission/ray_queue.h"
#include "server/admission/scheduler.h"
#include "server/auth/access_control.h"
#include "server/base/limits.h"
#include "server/metrics/metrics.h"
#include "server/metrics/slow_query_log.h"
#include "server/points/point_set_store.h"
#include "server/scenes/scene_catalog.h"

namespace sightline {

struct QueryEnvironment {
  const Limits& limits;
  SceneCatalog& scenes;
  PointSetStore& point_sets;
  ThreadPool& query_pool;  // Answers queries; never builds.
  ThreadPool& build_pool;  // Builds and loads scenes, makes point sets; never answers.
  ThreadPool& call_pool;   // What calls have to do that is short: reads uploads, frees memory.
  RayQueue& ray_queue;
  Scheduler& scheduler;  // Shares the query pool's threads.
  CallTracker& calls;
  CallQuota& streams;                     // Of each client: of visibility, of watched scenes.
  CallQuota& uploads;                     // Its uploads,
  CallQuota& upload_bytes;                // and the bytes that have arrived of them.
  CallQuota& scenes_made;                 // The scenes that it made.
  const AccessControl* access = nullptr;  // Null: nobody is asked who they are.
  Metrics* metrics = nullptr;             // Null: nothing is counted.
  const SlowQueryLog* slow_queries = nullptr;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_STREAM_QUERY_ENVIRONMENT_H_
