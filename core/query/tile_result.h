// SPDX-License-Identifier: Apache-2.0
//
// A rectangle of an image's pixels: what may be asked about them, and what is answered (tiles.h).
//
// Thread safety: plain values.
#ifndef SIGHTLINE_CORE_QUERY_TILE_RESULT_H_
#define SIGHTLINE_CORE_QUERY_TILE_RESULT_H_

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/base/aligned_vector.h"
#include "core/geometry/camera.h"
#include "core/geometry/vec3.h"
#include "core/query/options.h"
#include "core/query/points.h"
#include "core/traverse/answered_by.h"

namespace sightline {

struct TileRect {
  // Pixels; within the image, not empty, and fewer than 2^32 - 1 of them.
  uint32_t x = 0, y = 0, width = 0, height = 0;
};

// The pixel of a point that has none.
inline constexpr uint32_t kNoPixel = 0xFFFFFFFFu;

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
  // Speed alone: ids, depths and weights are written past the caches. For whoever fills arrays that
  // no cache holds and reads them later: a whole picture. What is read at once is slower for it.
  // Nothing changes where the tile's width is no multiple of sixteen.
  bool past_caches = false;
};

// Arrays in row-major pixel order of the tile, n = width · height; empty unless asked for.
struct TileResult {
  std::vector<uint8_t> hit_bits;     // n bits, least significant first, padded to a byte.
  AlignedVector<uint32_t> triangle;  // n global ids, kNoTriangle for a miss.
  AlignedVector<float> depth;        // n, +inf for a miss.
  AlignedVector<float> u, v;         // n each, 0 for a miss.
  // One row per sample, each (n + 7) / 8 bytes: 1 where the pixel hits something and the sample
  // reaches it.
  std::vector<uint8_t> lit_bits;
  PreparedPoints points;  // One per hit pixel, in pixel order, each attached to what it hit.
  std::vector<uint32_t> point_pixel;    // Its pixel, 0 .. n - 1.
  std::vector<AnsweredBy> answered_by;  // n.
  // One row of n per sample: kNoRay where the pixel hits nothing, or the sample is invalid.
  std::vector<AnsweredBy> lit_answered_by;
  // n bits as hit_bits: 1 where the pixel's ray met a mirror, and all else is about its mirrored
  // ray (mirrors.h).
  std::vector<uint8_t> mirror_bits;
  QueryStats primary, shadow;

  // Points come block by block, some without a pixel: from now on in the order of their pixels, of
  // which there are `pixels`, and none without. REQUIRES: no two have one pixel.
  void SortPoints(size_t pixels);

  // Forgets everything but the memory of what is asked for again: a caller that traces tile after
  // tile into one result pays for it once. Arrays keep what they held.
  void Reset(const TileOutputs& outputs);
};

// InvalidArgument unless the rectangle has pixels, not too many, and all are the camera's; names
// field and value.
absl::Status CheckRect(const Camera& camera, const TileRect& tile);

// Where the camera's rays begin, in the frame of the scene with that origin. InvalidArgument if
// that is too far off.
absl::StatusOr<Vec3f> EyeInScene(const Camera& camera, Vec3d origin);

}  // namespace sightline

#endif  // SIGHTLINE_CORE_QUERY_TILE_RESULT_H_
