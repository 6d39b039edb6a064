// SPDX-License-Identifier: Apache-2.0
//
// A point set of what a camera sees: one point per pixel, row by row, invalid where the pixel sees
// nothing. The picture is cut into tiles, to be traced in any order, by any threads.
//
// Invariant: the points do not depend on how the tiles are shared out.
//
// Thread safety: Trace for different tiles at once; Take after all of them.
//
//   SL_ASSIGN_OR_RETURN(std::unique_ptr<CameraPoints> points,
//                       CameraPoints::Make(scene, camera, options));
//   for (size_t tile = 0; tile < points->tiles(); ++tile) {
//     SL_RETURN_IF_ERROR(points->Trace(tile, &cancel, &scratch));
//   }
//   PreparedPoints prepared = points->Take();
#ifndef SIGHTLINE_SERVER_POINTS_CAMERA_POINTS_H_
#define SIGHTLINE_SERVER_POINTS_CAMERA_POINTS_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/cancel.h"
#include "core/geometry/camera.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/query/tile_result.h"
#include "core/scene/scene.h"

namespace sightline {

class CameraPoints {
 public:
  // Large enough to share a walk between neighbours, small enough to keep all threads busy.
  static constexpr uint32_t kTileSide = 64;
  static constexpr uint64_t kTileRays = uint64_t{kTileSide} * kTileSide;

  // FailedPrecondition, InvalidArgument: the scene has not what the options ask for.
  static absl::StatusOr<std::unique_ptr<CameraPoints>> Make(std::shared_ptr<const Scene> scene,
                                                            const Camera& camera,
                                                            const QueryOptions& options);

  size_t tiles() const { return size_t{across_} * down_; }
  uint64_t rays() const { return uint64_t{camera_.width} * camera_.height; }
  // Of one tile: fewer at the right and the lower edge.
  uint64_t RaysOf(size_t tile) const;

  // `scratch` is the caller's, to be used again for the next tile. Cancelled / DeadlineExceeded
  // from `cancel`, which may be null. REQUIRES: tile < tiles(), once for each.
  absl::Status Trace(size_t tile, const CancelToken* cancel, TileResult* scratch);
  // REQUIRES: every tile has been traced; once.
  PreparedPoints Take();

 private:
  CameraPoints(std::shared_ptr<const Scene> scene, const Camera& camera,
               const QueryOptions& options);
  TileRect RectOf(size_t tile) const;

  const std::shared_ptr<const Scene> scene_;
  const Camera camera_;
  const QueryOptions options_;
  const uint32_t across_, down_;  // Tiles.
  PreparedPoints points_;         // Each tile writes its own pixels.
  std::atomic<uint64_t> hits_ = 0, near_surface_ = 0;
};

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_POINTS_CAMERA_POINTS_H_
