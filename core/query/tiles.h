// SPDX-License-Identifier: Apache-2.0
//
// Camera tiles: what is seen through each pixel of a rectangle of an image, and which lights reach
// it.
//
// Thread safety: functions only. TraceTile runs in the caller's thread; a caller with many tiles
// runs them side by side (a tile is the unit of work), and results do not depend on how an image is
// cut.
//
//   TileResult result;
//   absl::Status status = TraceTile(*scene, camera, {0, 0, 64, 64}, samples, {.depth = true}, {},
//   &result);
#ifndef SIGHTLINE_CORE_QUERY_TILES_H_
#define SIGHTLINE_CORE_QUERY_TILES_H_

#include <span>

#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/query/mirrors.h"
#include "core/query/options.h"
#include "core/query/tile_result.h"

namespace sightline {

// What is seen in mirrors (mirrors.h), too: hits, ids, depths, weights, points and lights are then
// those of the mirrored rays. InvalidArgument (camera, rectangle; each field named with its value),
// what CheckOptions says of the options, Cancelled / DeadlineExceeded. On an error the result holds
// nothing. Rows of invalid samples are zero; the caller reports them (LightSample::valid).
// REQUIRES: the mirrors were prepared for this scene and this camera (PrepareMirrors).
absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, const PreparedMirrors& mirrors,
                       const TileOutputs& outputs, const QueryOptions& options, TileResult* result);
// The same for one tile alone: prepares them, with PrepareMirrors's errors.
absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, std::span<const Mirror> mirrors,
                       const TileOutputs& outputs, const QueryOptions& options, TileResult* result);
// The same without mirrors.
inline absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera,
                              const TileRect& tile, std::span<const LightSample> samples,
                              const TileOutputs& outputs, const QueryOptions& options,
                              TileResult* result) {
  return TraceTile(scene, camera, tile, samples, PreparedMirrors(), outputs, options, result);
}

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_TILES_H_
