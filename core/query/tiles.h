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

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "core/accel/indexed_geometry.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/query/mirrors.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/traverse/answered_by.h"

namespace sightline {

struct TileRect {
  uint32_t x = 0, y = 0, width = 0, height = 0;  // Pixels; within the image, not empty.
};

struct TileOutputs {
  bool hits = true;     // Which pixels see a triangle.
  bool ids = false;     // Which one.
  bool depth = false;   // How far, along the camera's forward axis.
  bool uv = false;      // Where on it: barycentric weights of corners B and C.
  bool lit = false;     // Which light samples reach the hit (one bit each; see `samples`).
  bool points = false;  // The placed hit points themselves, as PreparedPoints (for point sets).
  bool answered_by = false;      // What answered each pixel's ray...
  bool lit_answered_by = false;  // ... and, if `lit`, each light sample's at its hit.
  bool mirrors = false;          // Which pixels look into a mirror.
};

// Arrays in row-major pixel order of the tile, n = width · height; empty unless asked for.
struct TileResult {
  std::vector<uint8_t> hit_bits;   // n bits, least significant first, padded to a byte.
  std::vector<uint32_t> triangle;  // n global ids, kNoTriangle for a miss.
  std::vector<float> depth;        // n, +inf for a miss.
  std::vector<float> u, v;         // n each, 0 for a miss.
  // One row per sample, each (n + 7) / 8 bytes: 1 where the pixel hits something and the sample
  // reaches it.
  std::vector<uint8_t> lit_bits;
  PreparedPoints points;                // One per hit pixel, in pixel order.
  std::vector<uint32_t> point_pixel;    // Its pixel, 0 .. n - 1.
  std::vector<AnsweredBy> answered_by;  // n.
  // One row of n per sample: kNoRay where the pixel hits nothing, or the sample is invalid.
  std::vector<AnsweredBy> lit_answered_by;
  // n bits as hit_bits: 1 where the pixel's ray met a mirror, and all else is about its mirrored
  // ray (mirrors.h).
  std::vector<uint8_t> mirror_bits;
  QueryStats primary, shadow;
};

// InvalidArgument (camera, rectangle; each field named with its value), Cancelled /
// DeadlineExceeded. On an error the result holds nothing. Rows of invalid samples are zero; the
// caller reports them (LightSample::valid).
absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, const TileOutputs& outputs,
                       const QueryOptions& options, TileResult* result);
// The same with what is seen in mirrors (mirrors.h, and its errors). Hits, ids, depths, weights,
// points and lights are then those of the mirrored rays.
absl::Status TraceTile(const IndexedGeometry& scene, const Camera& camera, const TileRect& tile,
                       std::span<const LightSample> samples, std::span<const Mirror> mirrors,
                       const TileOutputs& outputs, const QueryOptions& options, TileResult* result);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_TILES_H_
