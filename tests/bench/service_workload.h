// SPDX-License-Identifier: Apache-2.0
//
// What sightline-bench service asks: the same items of the engine in process and of the service.
// Both sides end with the answers as the wire has them, in memory; a digest tells whether they are
// the same.
//
// Thread safety: none; RunEngine uses the pool, RunService gRPC's threads.
//
//   for (ServiceWorkload& workload : *MakeServiceWorkloads(scene, view, options)) ...
#ifndef SIGHTLINE_TESTS_BENCH_SERVICE_WORKLOAD_H_
#define SIGHTLINE_TESTS_BENCH_SERVICE_WORKLOAD_H_

#include <grpcpp/channel.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/parallel.h"
#include "core/geometry/camera.h"
#include "core/mesh/builtin/builtin.h"
#include "core/scene/scene.h"
#include "sightline/v1/geometry.pb.h"

namespace sightline::bench {

// What a run answered. The order of replies is open, and how items are cut into them.
struct Answer {
  uint64_t digest = 0;   // Of what stands where (answer_digest.h).
  uint64_t bytes = 0;    // Of arrays.
  uint64_t replies = 0;  // Of the service.

  bool Agrees(const Answer& other) const { return digest == other.digest && bytes == other.bytes; }
};

struct ServiceWorkload {
  std::string name;
  uint64_t rays = 0;
  uint64_t request_bytes = 0;  // Of an item.
  size_t items = 0;
  bool moves_arrays = false;  // Depth and ids: judged by what they move.
  std::function<absl::StatusOr<Answer>(ThreadPool& pool)> run_engine;
  std::function<absl::StatusOr<Answer>(const std::shared_ptr<grpc::Channel>& channel)> run_service;
};

struct ServiceSpec {
  std::string scene_id;  // Its name on the servers.
  std::string point_set_id = "hits";
  uint32_t width = 1024, height = 1024;
  uint64_t segments = 1 << 20;
};

// The names of all that MakeServiceWorkloads makes, in its order.
inline constexpr const char* kServiceWorkloads[] = {"points-bits",   "sky-sums",
                                                    "segments-bits", "segments-f32-bits",
                                                    "tiles-bits",    "tiles-depth-ids"};

// `scene` must outlive them. The servers must have the scene under its name, and the view's hits as
// a point set (MakePointSet).
absl::StatusOr<std::vector<ServiceWorkload>> MakeServiceWorkloads(
    std::shared_ptr<const Scene> scene, const BuiltinView& view, const ServiceSpec& spec,
    ThreadPool& pool);

// As the wire has it.
void EncodeBenchCamera(const Camera& camera, v1::Camera* out);

absl::Status MakePointSet(const std::shared_ptr<grpc::Channel>& channel, const BuiltinView& view,
                          const ServiceSpec& spec);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_SERVICE_WORKLOAD_H_
