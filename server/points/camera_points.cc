// SPDX-License-Identifier: Apache-2.0
#include "server/points/camera_points.h"

#include <algorithm>
#include <utility>

#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/query/tiles.h"
#include "server/codec/query_codec.h"

namespace sightline {
namespace {

// Large enough to share a walk between neighbours, small enough to keep all threads busy.
constexpr uint32_t kTileSide = 64;

}  // namespace

absl::StatusOr<PreparedPoints> TraceCameraPoints(const Scene& scene, const Camera& camera,
                                                 const QueryOptions& options, ThreadPool& pool) {
  SL_RETURN_IF_ERROR(CheckSceneOptions(scene, options));
  const size_t pixels = size_t{camera.width} * camera.height;
  PreparedPoints points;
  points.positions.resize(pixels);
  points.sources.assign(pixels, kNoTriangle);
  points.valid.assign(pixels, 0);
  const uint32_t across = (camera.width + kTileSide - 1) / kTileSide;
  const uint32_t down = (camera.height + kTileSide - 1) / kTileSide;
  Mutex mutex;
  absl::Status status;  // The first failure, under `mutex`.
  uint64_t hits = 0, near_surface = 0;
  pool.ParallelFor(
      size_t{across} * down, 1,
      [&](size_t begin, size_t end) {
        for (size_t t = begin; t < end; ++t) {
          TileRect tile{static_cast<uint32_t>(t % across) * kTileSide,
                        static_cast<uint32_t>(t / across) * kTileSide, kTileSide, kTileSide};
          tile.width = std::min(tile.width, camera.width - tile.x);
          tile.height = std::min(tile.height, camera.height - tile.y);
          TileResult result;
          absl::Status traced =
              TraceTile(scene, camera, tile, {}, {.hits = true, .points = true}, options, &result);
          MutexLock lock(mutex);
          if (!traced.ok()) {
            if (status.ok()) status = std::move(traced);
            return;
          }
          hits += result.points.size();
          near_surface += result.points.near_surface;
          for (size_t i = 0; i < result.points.size(); ++i) {
            const uint32_t in_tile = result.point_pixel[i];
            const size_t pixel = size_t{tile.y + in_tile / tile.width} * camera.width + tile.x +
                                 in_tile % tile.width;
            points.positions[pixel] = result.points.positions[i];
            points.sources[pixel] = result.points.sources[i];
            points.valid[pixel] = result.points.valid[i];
          }
        }
      },
      options.cancel);
  if (options.cancel != nullptr && options.cancel->cancelled()) return options.cancel->ToStatus();
  if (!status.ok()) return status;
  points.attached = hits;
  points.invalid = pixels - hits;
  points.near_surface = near_surface;
  return points;
}

}  // namespace sightline
