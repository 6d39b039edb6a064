// SPDX-License-Identifier: Apache-2.0
#include "core/query/tile_result.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/mesh/rebase.h"

namespace sightline {

void TileResult::Reset(const TileOutputs& outputs) {
  const auto keep = [](bool asked, auto& values) {
    if (!asked) values.clear();
  };
  keep(outputs.hits, hit_bits);
  keep(outputs.ids, triangle);
  keep(outputs.depth, depth);
  keep(outputs.uv, u);
  keep(outputs.uv, v);
  keep(outputs.lit, lit_bits);
  keep(outputs.answered_by, answered_by);
  keep(outputs.lit && outputs.lit_answered_by, lit_answered_by);
  keep(outputs.mirrors, mirror_bits);
  points = PreparedPoints();
  point_pixel.clear();
  primary = shadow = QueryStats();
}

void TileResult::SortPoints(size_t pixels) {
  const size_t n = point_pixel.size();
  std::vector<uint32_t> at(pixels, kNoTriangle);
  for (size_t i = 0; i < n; ++i) {
    if (point_pixel[i] != kNoPixel) at[point_pixel[i]] = static_cast<uint32_t>(i);
  }
  PreparedPoints sorted;
  sorted.positions.reserve(n);
  sorted.sources.reserve(n);
  size_t next = 0;
  for (size_t pixel = 0; pixel < pixels; ++pixel) {
    if (at[pixel] == kNoTriangle) continue;
    sorted.positions.push_back(points.positions[at[pixel]]);
    sorted.sources.push_back(points.sources[at[pixel]]);
    point_pixel[next++] = static_cast<uint32_t>(pixel);
  }
  sorted.valid.assign(next, 1);
  sorted.attached = next;
  sorted.near_surface = points.near_surface;
  point_pixel.resize(next);
  points = std::move(sorted);
}

absl::Status CheckRect(const Camera& camera, const TileRect& tile) {
  const auto check = [](const char* field, uint64_t begin, uint64_t extent, const char* side,
                        uint64_t limit) -> absl::Status {
    if (extent == 0) {
      return absl::InvalidArgumentError(absl::StrCat("tile.", side, " = 0: a tile has pixels"));
    }
    if (begin + extent > limit) {
      return absl::InvalidArgumentError(
          absl::StrCat("tile.", field, " = ", begin, " with tile.", side, " = ", extent,
                       " leaves the image, whose ", side, " is ", limit));
    }
    return absl::OkStatus();
  };
  SL_RETURN_IF_ERROR(check("x", tile.x, tile.width, "width", camera.width));
  SL_RETURN_IF_ERROR(check("y", tile.y, tile.height, "height", camera.height));
  if (uint64_t{tile.width} * tile.height >= kNoPixel) {
    return absl::InvalidArgumentError(
        absl::StrCat("tile.width = ", tile.width, " with tile.height = ", tile.height,
                     " has more pixels than the ", kNoPixel - 1, " of the largest tile"));
  }
  return absl::OkStatus();
}

absl::StatusOr<Vec3f> EyeInScene(const Camera& camera, Vec3d origin) {
  Vec3f eye;
  if (Rebase(camera.eye, origin, &eye)) return eye;
  return absl::InvalidArgumentError(
      absl::StrCat("camera.eye = (", camera.eye.x, ", ", camera.eye.y, ", ", camera.eye.z,
                   ") lies beyond 2^40 along an axis, in the world or from the scene's origin"));
}

}  // namespace sightline
