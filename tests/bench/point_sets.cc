// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/point_sets.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/light/horizon_frame.h"
#include "core/light/sky_patches.h"
#include "core/query/tiles.h"
#include "tests/bench/random.h"
#include "tests/bench/workload.h"

namespace sightline::bench {
namespace {

constexpr uint32_t kBlockSide = 16;

// The pixel offsets of a block in the order of ViewHits: 4×4 squares row by row, 2×2 in those.
std::array<std::pair<uint8_t, uint8_t>, kBlockSide * kBlockSide> BlockOrder() {
  std::array<std::pair<uint8_t, uint8_t>, kBlockSide * kBlockSide> order;
  for (uint32_t i = 0; i < order.size(); ++i) {
    const uint32_t square = i / 16, quad = i / 4 % 4, pixel = i % 4;
    order[i] = {static_cast<uint8_t>(square % 4 * 4 + quad % 2 * 2 + pixel % 2),
                static_cast<uint8_t>(square / 4 * 4 + quad / 2 * 2 + pixel / 2)};
  }
  return order;
}

// The points of a tile by way of its pixels in block order.
void AppendInBlockOrder(const TileRect& tile, const TileResult& result, bool with_sources,
                        PointSet* set) {
  constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();
  static const auto kOrder = BlockOrder();
  std::vector<uint32_t> point_of(size_t{tile.width} * tile.height, kNone);
  for (uint32_t i = 0; i < result.point_pixel.size(); ++i) point_of[result.point_pixel[i]] = i;
  const size_t begin = set->size();
  for (uint32_t y0 = 0; y0 < tile.height; y0 += kBlockSide) {
    for (uint32_t x0 = 0; x0 < tile.width; x0 += kBlockSide) {
      for (const auto& [dx, dy] : kOrder) {
        if (x0 + dx >= tile.width || y0 + dy >= tile.height) continue;
        const uint32_t point = point_of[size_t{y0 + dy} * tile.width + x0 + dx];
        if (point == kNone || !result.points.valid[point]) continue;
        set->positions.push_back(result.points.positions[point]);
        if (with_sources) set->sources.push_back(result.points.sources[point]);
      }
    }
  }
  if (set->size() > begin) set->ranges.push_back({begin, set->size() - begin});
}

// Roberts' R_d sequences: frac(½ + k / g^j) with g the positive root of g^(d+1) = g + 1.
constexpr double kPlastic = 1.32471795724474602596;  // d = 2.
constexpr double kRootR3 = 1.22074408460575947536;   // d = 3.
double Additive(uint64_t k, double step) {
  const double x = 0.5 + static_cast<double>(k) * step;
  return x - std::floor(x);
}

double Area(const std::array<Vec3f, 3>& corners) {
  const Vec3d a = ToDouble(corners[0]);
  return 0.5 * Length(Cross(ToDouble(corners[1]) - a, ToDouble(corners[2]) - a));
}

struct WorldPoints {
  std::vector<Vec3d> positions, normals;
};

absl::StatusOr<WorldPoints> SpreadByArea(const SceneGeometry& geometry, uint64_t count) {
  std::vector<double> area(geometry.triangles.size());
  for (uint32_t id = 0; id < area.size(); ++id) area[id] = Area(geometry.Corners(id));
  for (const uint32_t id : geometry.inert) area[id] = 0;
  const double whole = std::accumulate(area.begin(), area.end(), 0.0);
  if (!(whole > 0) || !std::isfinite(whole)) {
    return absl::InvalidArgumentError("the scene's triangles have no area to spread points over");
  }
  WorldPoints points;
  points.positions.reserve(count);
  points.normals.reserve(count);
  double passed = 0;
  uint64_t k = 0;
  for (uint32_t id = 0; id < area.size(); ++id) {
    passed += area[id];
    const auto [a, b, c] = geometry.Corners(id);
    while (k < count &&
           (static_cast<double>(k) + 0.5) / static_cast<double>(count) * whole < passed) {
      double u = Additive(k, 1 / kPlastic), v = Additive(k, 1 / (kPlastic * kPlastic));
      if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
      }
      const Vec3d corner = ToDouble(a), ab = ToDouble(b) - corner, ac = ToDouble(c) - corner;
      points.positions.push_back(geometry.origin + (corner + ab * u + ac * v));
      points.normals.push_back(Cross(ab, ac));
      ++k;
    }
  }
  return points;
}

void Shuffle(WorldPoints* points) {
  Random random(/*seed=*/1);
  for (size_t i = points->positions.size(); i > 1; --i) {
    const size_t other = random.Below(i);
    std::swap(points->positions[i - 1], points->positions[other]);
    std::swap(points->normals[i - 1], points->normals[other]);
  }
}

}  // namespace

absl::StatusOr<PointSet> ViewHits(const IndexedGeometry& scene, const Camera& camera,
                                  bool with_sources, ThreadPool& pool) {
  const std::vector<TileRect> tiles = CutImage(camera.width, camera.height);
  std::vector<TileResult> results(tiles.size());
  std::vector<absl::Status> statuses(tiles.size());
  pool.ParallelFor(tiles.size(), 1, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      statuses[i] =
          TraceTile(scene, camera, tiles[i], {}, {.hits = false, .points = true}, {}, &results[i]);
    }
  });
  PointSet set;
  for (size_t i = 0; i < tiles.size(); ++i) {
    SL_RETURN_IF_ERROR(statuses[i]);
    AppendInBlockOrder(tiles[i], results[i], with_sources, &set);
  }
  return set;
}

absl::StatusOr<PointSet> SurfacePoints(const IndexedGeometry& scene, const SurfaceOptions& options,
                                       ThreadPool& pool) {
  SL_ASSIGN_OR_RETURN(WorldPoints world, SpreadByArea(scene.geometry, options.count));
  if (options.shuffled) Shuffle(&world);
  // Far above the rounding of a point on its triangle, far below what it could be confused with.
  const Vec3d extent = ToDouble(scene.geometry.bounds.Extent());
  const double attach = Length(extent) * 0x1p-16;
  const size_t n = world.positions.size();
  PointSet set;
  set.positions.resize(n);
  if (options.with_sources) set.sources.resize(n, kNoTriangle);
  for (size_t begin = 0; begin < n; begin += options.range) {
    set.ranges.push_back({begin, std::min<size_t>(options.range, n - begin)});
  }
  constexpr size_t kGrain = 4096;
  std::vector<absl::Status> statuses((n + kGrain - 1) / kGrain);
  pool.ParallelFor(n, kGrain, [&](size_t begin, size_t end) {
    const absl::StatusOr<PreparedPoints> prepared =
        PreparePoints(scene,
                      {.positions = std::span(world.positions).subspan(begin, end - begin),
                       .normals = std::span(world.normals).subspan(begin, end - begin)},
                      {.attach_distance = attach, .count_near_surface = false});
    absl::Status& status = statuses[begin / kGrain];
    status = prepared.status();
    if (!status.ok()) return;
    if (prepared->invalid > 0) {
      status =
          absl::InternalError(absl::StrCat(prepared->invalid, " surface points are out of range"));
      return;
    }
    std::copy(prepared->positions.begin(), prepared->positions.end(),
              set.positions.begin() + static_cast<ptrdiff_t>(begin));
    if (!options.with_sources) return;
    std::copy(prepared->sources.begin(), prepared->sources.end(),
              set.sources.begin() + static_cast<ptrdiff_t>(begin));
  });
  for (const absl::Status& status : statuses) SL_RETURN_IF_ERROR(status);
  return set;
}

absl::StatusOr<std::vector<Light>> SkyLights(Vec3d up) {
  // Any level axis serves as north: the one that `up` leans on least.
  const Vec3d lean = {std::abs(up.x), std::abs(up.y), std::abs(up.z)};
  Vec3d axis{0, 0, 0};
  axis[lean.x <= lean.y && lean.x <= lean.z ? 0 : lean.y <= lean.z ? 1 : 2] = 1;
  SL_ASSIGN_OR_RETURN(const HorizonFrame frame, MakeHorizonFrame(up, axis));
  SL_ASSIGN_OR_RETURN(const std::vector<SkyPatch> sky, SkyPatches(/*subdivision=*/1));
  std::vector<Light> lights;
  lights.reserve(sky.size());
  for (const SkyPatch& patch : sky) {
    lights.push_back(
        Light::Directional(frame.Toward(patch.altitude_degrees, patch.azimuth_degrees)));
  }
  return lights;
}

std::vector<Light> BoxLights(const SceneGeometry& geometry, int count) {
  const Vec3d lo = ToDouble(geometry.bounds.lo), extent = ToDouble(geometry.bounds.hi) - lo;
  std::vector<Light> lights;
  for (int k = 0; k < count; ++k) {
    const uint64_t number = static_cast<uint64_t>(k);
    double step = 1;
    Vec3d at = geometry.origin + lo;
    for (int axis = 0; axis < 3; ++axis) {
      step /= kRootR3;
      at[axis] += extent[axis] * Additive(number, step);
    }
    lights.push_back(Light::Point(at));
  }
  return lights;
}

}  // namespace sightline::bench
