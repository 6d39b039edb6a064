// SPDX-License-Identifier: Apache-2.0
//
// A point set of what a camera sees: one point per pixel, row by row, invalid where the pixel sees
// nothing.
//
// Thread safety: functions only; runs in parallel within the pool of the calling thread.
//
//   SL_ASSIGN_OR_RETURN(PreparedPoints points, TraceCameraPoints(*scene, camera, options, pool));
#ifndef SIGHTLINE_SERVER_POINTS_CAMERA_POINTS_H_
#define SIGHTLINE_SERVER_POINTS_CAMERA_POINTS_H_

#include "absl/status/statusor.h"
#include "core/base/parallel.h"
#include "core/geometry/camera.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/scene/scene.h"

namespace sightline {

// Cancelled / DeadlineExceeded from options.cancel.
absl::StatusOr<PreparedPoints> TraceCameraPoints(const Scene& scene, const Camera& camera,
                                                 const QueryOptions& options, ThreadPool& pool);

}  // namespace sightline

#endif  // SIGHTLINE_SERVER_POINTS_CAMERA_POINTS_H_
