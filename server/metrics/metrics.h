// SPDX-License-Identifier: Apache-2.0
//
// What a server counts, in Prometheus' terms: requests by result, time waited and computed, rays,
// what the walks did for them. The state that is only looked at when somebody asks (scenes, queue,
// connections) comes from a ServerState, which the server gives.
//
// Units: seconds, bytes, rays; names as Prometheus wants them, sightline_..._total for counters. A
// request is an item of a stream, or a call that has none: an upload, a plain call, a stream that
// could not be opened.
//
// Thread safety: every method from any thread; recording an item takes well under a microsecond.
//
//   Metrics metrics([this] { return StateNow(); });
//   metrics.RecordItem({.operation = Operation::kTraceTiles, .code = status.code(), ...});
//   std::string page = metrics.Text();
#ifndef SIGHTLINE_SERVER_METRICS_METRICS_H_
#define SIGHTLINE_SERVER_METRICS_METRICS_H_

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"
#include "core/query/options.h"

namespace sightline {

// What is counted apart; the names are those of the methods.
enum class Operation {
  kTraceTiles,
  kComputeShadows,
  kTestSegments,
  kCreateScene,
  kUpdateScene,
  kCreatePointSet,
  kGetScene,
  kListScenes,
  kListSceneObjects,
  kDeleteScene,
  kLoadScene,
  kReloadScene,
  kUnloadScene,
  kListStoredScenes,
  kGetPointSet,
  kListPointSets,
  kDeletePointSet,
  kRenewLease,
  kGetCapabilities,
  kWatchScene,  // Counted when the watch ends; its time is how long it lasted.
};
inline constexpr int kOperations = 20;
absl::string_view OperationName(Operation operation);

struct ItemRecord {
  Operation operation = Operation::kTraceTiles;
  absl::StatusCode code = absl::StatusCode::kOk;
  std::chrono::nanoseconds queue{0};  // From its arrival to the start of its computation.
  std::chrono::nanoseconds total{0};  // From its arrival to its last reply.
  QueryStats stats;
};

// The server at one moment.
struct ServerState {
  struct Scene {
    std::string id;
    uint64_t revision = 0, bytes = 0, triangles = 0;
  };
  std::vector<Scene> scenes;
  uint64_t unstored_scenes = 0;  // Of those whose current revision should be stored.
  uint64_t failed_scene_stores = 0;
  uint64_t scene_bytes = 0;      // All revisions alive and builds under way.
  uint64_t point_set_bytes = 0;  // All point sets.
  // What bounds these two and queued_rays.
  uint64_t max_scene_bytes = 0, max_point_set_bytes = 0, max_queued_rays = 0;
  uint64_t active_calls = 0, active_uploads = 0, queued_rays = 0;
  uint64_t refused_calls = 0;  // For want of a role.
  uint64_t clients = 0, waiting_tasks = 0, running_tasks = 0;
  double rays_per_second = 0;  // While computing, of all threads, of late.
  uint64_t open_connections = 0, accepted_connections = 0, refused_connections = 0;
  absl::Time certificate_end = absl::InfiniteFuture();  // Of the server's certificate.
  bool draining = false;
  // Of certificates and the access file, since the start.
  uint64_t security_reloads = 0, failed_security_reloads = 0;
  uint64_t dropped_log_lines = 0;
};

class Metrics {
 public:
  explicit Metrics(std::function<ServerState()> state);
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  // Each is counted by how it ended: "ok"; "rejected" (no room, no right, draining); "cancelled";
  // "expired" (its deadline passed); "failed" (everything else, the client's mistakes among it).
  void RecordItem(const ItemRecord& record);
  // A call that is no item: an upload and what it built, a plain call, a stream that did not open.
  void RecordCall(Operation operation, absl::StatusCode code, std::chrono::nanoseconds total);

  // Everything, in Prometheus' text format.
  std::string Text() const;

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
};

// Counts one call, from its beginning until it is recorded.
class CallTimer {
 public:
  // `metrics` may be null: nothing is counted.
  CallTimer(Metrics* metrics, Operation operation) : metrics_(metrics), operation_(operation) {}
  void Record(absl::StatusCode code) const {
    if (metrics_ == nullptr) return;
    metrics_->RecordCall(operation_, code, std::chrono::steady_clock::now() - start_);
  }

 private:
  Metrics* const metrics_;
  const Operation operation_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_METRICS_METRICS_H_
