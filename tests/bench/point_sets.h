// SPDX-License-Identifier: Apache-2.0
//
// The points and lights of the shadow workloads, as stored floats in the order that both sides get
// them in.
//
// Thread safety: functions only.
//
//   SL_ASSIGN_OR_RETURN(PointSet hits, ViewHits(scene, camera, pool));
//   hits.ranges    // What the engine is handed in one call each.
#ifndef SIGHTLINE_TESTS_BENCH_POINT_SETS_H_
#define SIGHTLINE_TESTS_BENCH_POINT_SETS_H_

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/statusor.h"
#include "core/accel/indexed_geometry.h"
#include "core/base/aligned_vector.h"
#include "core/base/parallel.h"
#include "core/geometry/camera.h"
#include "core/light/light.h"
#include "core/query/points.h"
#include "core/query/shadows.h"

namespace sightline::bench {

// All of them valid: the others were left out.
struct PointSet {
  struct Range {
    size_t begin = 0, count = 0;
  };
  AlignedVector<Vec3f> positions;
  AlignedVector<uint32_t> sources;  // Empty unless asked for.
  std::vector<Range> ranges;        // They cover the points in order; none is empty.

  size_t size() const { return positions.size(); }
  std::span<const Vec3f> Positions(const Range& range) const {
    return std::span(positions).subspan(range.begin, range.count);
  }
  PointRange Slice(const Range& range) const {
    return {Positions(range),
            sources.empty() ? std::span<const uint32_t>()
                            : std::span(sources).subspan(range.begin, range.count),
            {}};
  }
};

// What the camera's pixels hit, placed on the eye's side of it (TraceTile's points). Tile by tile
// (a range each, kTileSide wide), in blocks of 16×16 pixels, in those by 4×4, in those by 2×2:
// neighbours in the image are neighbours in the arrays, which suits packets and shafts alike.
// Pixels that hit nothing are left out. `sources` only `with_sources`.
absl::StatusOr<PointSet> ViewHits(const IndexedGeometry& scene, const Camera& camera,
                                  bool with_sources, ThreadPool& pool);

// `count` points spread over the surface by area, in mesh order: point k lies on the triangle in
// which the running sum of areas, in the order of triangle ids, passes (k + ½)/count of the whole,
// at the k-th element of the R2 sequence folded into the triangle. Each is placed on the front side
// of its triangle, as `attach` places points (PreparePoints). Ranges of `range`. Shuffled: the same
// points in one fixed random order.
struct SurfaceOptions {
  uint64_t count = 1'000'000;
  uint64_t range = 65'536;
  bool shuffled = false;
  bool with_sources = false;
};
absl::StatusOr<PointSet> SurfacePoints(const IndexedGeometry& scene, const SurfaceOptions& options,
                                       ThreadPool& pool);

// The 145 patch centres of Tregenza's sky (core/light/sky_patches.h) above the plane that `up`
// stands on.
absl::StatusOr<std::vector<Light>> SkyLights(Vec3d up);

// `count` point lights in the scene's box, by the R3 sequence; fixed.
std::vector<Light> BoxLights(const SceneGeometry& geometry, int count);

}  // namespace sightline::bench

#endif  // SIGHTLINE_TESTS_BENCH_POINT_SETS_H_
