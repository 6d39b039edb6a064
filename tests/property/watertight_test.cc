// SPDX-License-Identifier: Apache-2.0
//
// No ray slips between triangles that share vertices: rays aimed at shared vertices and edges of
// closed meshes from inside, and sun rays through the vertices of grids, by every walk and
// instruction set.
//
// A longer run: SIGHTLINE_WATERTIGHT_RAYS=100000000 property_watertight_test (rays per test and way
// of asking).
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "core/query/shadows.h"
#include "core/traverse/kernels.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AllWays;
using testing_support::IndexObjects;
using testing_support::MakeClosedBox;
using testing_support::MakeClosedSphere;
using testing_support::MakeGrid;
using testing_support::Printed;
using testing_support::ScaledCount;
using testing_support::TestRng;
using testing_support::Way;

constexpr size_t kBlock = RayPacket::kMaxRays;

// Rays of one test, of each way of asking.
int64_t RayCount() {
  const char* const text = std::getenv("SIGHTLINE_WATERTIGHT_RAYS");
  if (text != nullptr && *text != '\0')
    return std::max<int64_t>(1, std::strtoll(text, nullptr, 10));
  return ScaledCount(1'000'000, 100);
}

// A closed mesh that every segment from `inside` of its centre to beyond a point of its surface
// crosses.
struct ClosedMesh {
  std::string name;
  IndexedGeometry indexed;
  Vec3d centre;
  double inner_radius;  // Of a ball around the centre that is strictly inside.
};

std::vector<ClosedMesh> MakeClosedMeshes() {
  std::vector<ClosedMesh> meshes;
  const Vec3d far{150'000, -150'000, 150'000};
  // Stored relative to zero, so that far ones are far: their floats are 2^-6 apart.
  for (const Vec3d centre : {Vec3d{}, far}) {
    const std::string where = centre == far ? " at 1.5e5" : "";
    meshes.push_back({"sphere" + where,
                      IndexObjects({MakeClosedSphere(9, 14, 100, centre)}, Vec3d{}), centre, 40});
    meshes.push_back(
        {"box" + where,
         IndexObjects({MakeClosedBox(4, centre - Vec3d{64, 64, 64}, centre + Vec3d{64, 64, 64})},
                      Vec3d{}, 6),
         centre, 32});
  }
  return meshes;
}

// A place inside; on a coarse lattice at times, so that what is aimed at is met exactly.
Vec3f Inside(const ClosedMesh& mesh, TestRng& rng) {
  Vec3d p;
  for (int k = 0; k < 3; ++k) {
    const double r = mesh.inner_radius / 2;
    p[k] = rng.Chance(0.5) ? static_cast<double>(rng.Below(17)) - 8 : rng.Uniform(-r, r);
  }
  return ToFloat(mesh.centre + p);
}

// A vertex, the middle of an edge, or anywhere on one.
Vec3f OnSharedFeature(const SceneGeometry& geometry, TestRng& rng) {
  const auto corners =
      geometry.Corners(static_cast<uint32_t>(rng.Below(geometry.triangles.size())));
  const uint64_t first = rng.Below(3);
  const Vec3d a = ToDouble(corners[first]), b = ToDouble(corners[(first + 1) % 3]);
  if (rng.Chance(0.5)) return ToFloat(a);
  const double w = rng.Chance(0.3) ? 0.5 : rng.Uniform(0, 1);
  return ToFloat(a * (1 - w) + b * w);
}

// Lights inside, points outside behind the surface: none is lit.
TEST(WatertightTest, NoSegmentLeavesAClosedMeshThroughAVertexOrAnEdge) {
  TestRng rng;
  const std::vector<ClosedMesh> meshes = MakeClosedMeshes();
  const int64_t blocks = RayCount() / static_cast<int64_t>(kBlock * meshes.size()) + 1;
  QueryStats stats;
  for (const ClosedMesh& mesh : meshes) {
    SCOPED_TRACE(mesh.name);
    for (int64_t block = 0; block < blocks; ++block) {
      LightSample light;
      light.value = Inside(mesh, rng);
      PreparedPoints points;
      points.sources.assign(kBlock, kNoTriangle);
      points.valid.assign(kBlock, 1);
      for (size_t i = 0; i < kBlock; ++i) {
        const Vec3f at = OnSharedFeature(mesh.indexed.geometry, rng);
        points.positions.push_back(at + (at - light.value));  // Twice as far.
      }
      for (const Way& way : AllWays()) {
        if (way.strategy == Strategy::kAuto) continue;  // One of the others.
        ShadowResult result;
        const ShadowOutputs outputs{.bits = true, .blockers = block % 4 == 0};
        ASSERT_TRUE(ComputeShadows(mesh.indexed, PointRange::All(points), {&light, 1}, {}, {},
                                   outputs, way.Options(), &result)
                        .ok());
        stats.Add(result.stats);
        for (size_t i = 0; i < kBlock; ++i) {
          const TraceRay query{.ray = PredicateRay::Segment(light.value, points.positions[i])};
          ASSERT_FALSE(result.lit_bits[i / 8] >> (i % 8) & 1)
              << way.Name() << ": " << Printed{query};
        }
      }
    }
  }
  std::cout << stats.rays << " segments, " << stats.doubt_double << " pairs left to doubles, "
            << stats.doubt_exact << " to expansions\n";
  EXPECT_GT(stats.doubt_exact, 0u);
}

// The same with rays that have no end, as a camera's: every one hits.
TEST(WatertightTest, NoRayLeavesAClosedMeshThroughAVertexOrAnEdge) {
  TestRng rng;
  const std::vector<ClosedMesh> meshes = MakeClosedMeshes();
  const int64_t blocks = RayCount() / static_cast<int64_t>(kBlock * meshes.size()) + 1;
  const auto packet = std::make_unique<RayPacket>();
  WalkStats stats;
  for (const ClosedMesh& mesh : meshes) {
    SCOPED_TRACE(mesh.name);
    packet->first_leaf = RayPacket::kNoLeaf;  // Not the mesh before's.
    for (int64_t block = 0; block < blocks; ++block) {
      packet->origin = Inside(mesh, rng);
      packet->segments = false;
      packet->count = kBlock;
      std::vector<TraceRay> rays(kBlock);
      for (size_t i = 0; i < kBlock; ++i) {
        const Vec3f d = OnSharedFeature(mesh.indexed.geometry, rng) - packet->origin;
        packet->target_x[i] = d.x;
        packet->target_y[i] = d.y;
        packet->target_z[i] = d.z;
        packet->target_source[i] = kNoTriangle;
        rays[i].ray = packet->ray(static_cast<int>(i));
      }
      std::vector<Hit> hits(kBlock);
      const auto expect_hits = [&](const char* how, SimdTarget simd, const auto& triangle_of) {
        for (size_t i = 0; i < kBlock; ++i) {
          ASSERT_NE(triangle_of(i), kNoTriangle)
              << how << ", target " << static_cast<int>(simd) << ": " << Printed{rays[i]};
        }
      };
      const auto of_single = [&](size_t i) { return hits[i].triangle; };
      for (const SimdTarget simd : {SimdTarget::kAvx2, SimdTarget::kAvx512}) {
        if (!SimdTargetAvailable(simd)) continue;
        const Kernels& kernels = KernelsFor(simd);
        // Any and closest hits take turns.
        const bool any = block % 2 == 0;
        ASSERT_TRUE((any ? kernels.occluded_packet : kernels.closest_packet)(mesh.indexed, *packet,
                                                                             nullptr, &stats));
        ASSERT_NO_FATAL_FAILURE(
            expect_hits("packet", simd, [&](size_t i) { return packet->triangle[i]; }));
        ASSERT_TRUE((any ? kernels.occluded_single : kernels.closest_single)(
            mesh.indexed, rays, hits, nullptr, &stats));
        ASSERT_NO_FATAL_FAILURE(expect_hits("single", simd, of_single));
        ASSERT_TRUE((any ? kernels.occluded_brute : kernels.closest_brute)(mesh.indexed, rays, hits,
                                                                           nullptr, &stats));
        ASSERT_NO_FATAL_FAILURE(expect_hits("brute force", simd, of_single));
      }
    }
  }
  std::cout << stats.doubt_double << " pairs left to doubles, " << stats.doubt_exact
            << " to expansions\n";
}

// Points below a grid, each with a vertex or a place on an edge between it and the sun: none is
// lit.
TEST(WatertightTest, NoSunRayPassesTheVerticesOfAGrid) {
  TestRng rng;
  struct Grid {
    std::string name;
    IndexedGeometry indexed;
    int cells;
    bool small;
  };
  std::vector<Grid> grids;
  for (const int cells : {12, 64}) {
    // The wavy ones rise by less than the suns do, so a line toward the sun crosses them once.
    for (const double height : {0.0, 0.3}) {
      for (const Vec3d corner : {Vec3d{}, Vec3d{150'000, 0, -150'000}}) {
        const std::string name = std::string(height == 0 ? "flat" : "wavy") + " grid of " +
                                 std::to_string(cells) + (corner == Vec3d{} ? "" : " at 1.5e5");
        grids.push_back({name, IndexObjects({MakeGrid(cells, height, corner, rng)}, Vec3d{}), cells,
                         cells <= 12});
      }
    }
  }
  const Vec3f suns[] = {{1, 2, 1}, {0.3f, 0.9f, 0.2f}, {-1, 2, 1}, {0, 1, 0}};
  const int64_t blocks =
      RayCount() / static_cast<int64_t>(kBlock * grids.size() * std::size(suns)) + 1;
  QueryStats stats;
  for (const Grid& grid : grids) {
    SCOPED_TRACE(grid.name);
    const SceneGeometry& geometry = grid.indexed.geometry;
    const uint32_t row = static_cast<uint32_t>(grid.cells) + 1;
    for (const Vec3f sun : suns) {
      LightSample sample;
      sample.directional = true;
      sample.value = sun;
      for (int64_t block = 0; block < blocks; ++block) {
        PreparedPoints points;
        points.sources.assign(kBlock, kNoTriangle);
        points.valid.assign(kBlock, 1);
        for (size_t i = 0; i < kBlock; ++i) {
          // Not of the border, where there is nothing beside it.
          const uint32_t x = 1 + static_cast<uint32_t>(rng.Below(row - 2));
          const uint32_t z = 1 + static_cast<uint32_t>(rng.Below(row - 2));
          Vec3f at = geometry.vertices[z * row + x];
          if (rng.Chance(0.3) && x + 2 < row) {  // On the edge to the next one.
            const Vec3f next = geometry.vertices[z * row + x + 1];
            const double w = rng.Uniform(0, 1);
            at = ToFloat(ToDouble(at) * (1 - w) + ToDouble(next) * w);
          }
          // Exact for the whole-numbered suns at the origin; rounded otherwise.
          const float steps = static_cast<float>(1 + rng.Below(4));
          points.positions.push_back(at - sun * steps);
        }
        for (const Way& way : AllWays()) {
          if (way.strategy == Strategy::kAuto || way.strategy == Strategy::kPacket) continue;
          if (way.strategy == Strategy::kBruteForce && !grid.small) continue;
          ShadowResult result;
          ASSERT_TRUE(ComputeShadows(grid.indexed, PointRange::All(points), {&sample, 1}, {}, {},
                                     {.bits = true}, way.Options(), &result)
                          .ok());
          stats.Add(result.stats);
          for (size_t i = 0; i < kBlock; ++i) {
            const TraceRay query{.ray = PredicateRay::Ray(points.positions[i], sun)};
            ASSERT_FALSE(result.lit_bits[i / 8] >> (i % 8) & 1)
                << way.Name() << ": " << Printed{query};
          }
        }
      }
    }
  }
  std::cout << stats.rays << " sun rays, " << stats.doubt_double << " pairs left to doubles, "
            << stats.doubt_exact << " to expansions\n";
  EXPECT_GT(stats.doubt_exact, 0u);
}

}  // namespace
}  // namespace sightline
