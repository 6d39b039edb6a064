// SPDX-License-Identifier: Apache-2.0
#include "server/points/camera_points.h"

#include <algorithm>
#include <utility>

#include "core/base/status_macros.h"
#include "core/query/tiles.h"
#include "server/codec/query_codec.h"

namespace sightline {

CameraPoints::CameraPoints(std::shared_ptr<const Scene> scene, const Camera& camera,
                           const QueryOptions& options)
    : scene_(std::move(scene)),
      camera_(camera),
      options_(options),
      across_((camera.width + kTileSide - 1) / kTileSide),
      down_((camera.height + kTileSide - 1) / kTileSide) {
  points_.positions.resize(rays());
  points_.sources.assign(rays(), kNoTriangle);
  points_.valid.assign(rays(), 0);
}

absl::StatusOr<std::unique_ptr<CameraPoints>> CameraPoints::Make(std::shared_ptr<const Scene> scene,
                                                                 const Camera& camera,
                                                                 const QueryOptions& options) {
  SL_RETURN_IF_ERROR(CheckSceneOptions(*scene, options));
  return std::unique_ptr<CameraPoints>(new CameraPoints(std::move(scene), camera, options));
}

TileRect CameraPoints::RectOf(size_t tile) const {
  const uint32_t x = static_cast<uint32_t>(tile % across_) * kTileSide;
  const uint32_t y = static_cast<uint32_t>(tile / across_) * kTileSide;
  return {x, y, std::min(kTileSide, camera_.width - x), std::min(kTileSide, camera_.height - y)};
}

uint64_t CameraPoints::RaysOf(size_t tile) const {
  const TileRect rect = RectOf(tile);
  return uint64_t{rect.width} * rect.height;
}

absl::Status CameraPoints::Trace(size_t tile, const CancelToken* cancel, TileResult* scratch) {
  const TileRect rect = RectOf(tile);
  QueryOptions options = options_;
  options.cancel = cancel;
  SL_RETURN_IF_ERROR(
      TraceTile(*scene_, camera_, rect, {}, {.hits = true, .points = true}, options, scratch));
  const PreparedPoints& seen = scratch->points;
  for (size_t i = 0; i < seen.size(); ++i) {
    const uint32_t in_tile = scratch->point_pixel[i];
    const size_t pixel =
        size_t{rect.y + in_tile / rect.width} * camera_.width + rect.x + in_tile % rect.width;
    points_.positions[pixel] = seen.positions[i];
    points_.sources[pixel] = seen.sources[i];
    points_.valid[pixel] = seen.valid[i];
  }
  hits_ += seen.size();
  near_surface_ += seen.near_surface;
  return absl::OkStatus();
}

PreparedPoints CameraPoints::Take() {
  points_.attached = hits_;
  points_.invalid = rays() - hits_;
  points_.near_surface = near_surface_;
  return std::move(points_);
}

}  // namespace sightline
