// SPDX-License-Identifier: Apache-2.0
#include "tests/property/query_cases.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/mesh/builtin/builtin.h"
#include "gtest/gtest.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/support/test_scale.h"

namespace sightline::testing_support {
namespace {

// Sides that no block size divides.
constexpr uint32_t kWidth = 45, kHeight = 27;

}  // namespace

void AddKdTree(const KdBuildOptions& options, IndexedGeometry* indexed) {
  ThreadPool pool(1);
  absl::StatusOr<KdTree> tree = BuildKdTree(indexed->geometry, options, pool);
  EXPECT_TRUE(tree.ok()) << tree.status();
  if (tree.ok()) indexed->kd_tree = *std::move(tree);
}

std::vector<QueryScene> MakeNastyQueryScenes(TestRng& rng) {
  std::vector<QueryScene> scenes;
  for (NastyScene& nasty : MakeNastyScenes(rng)) {
    QueryScene scene{nasty.name, std::move(nasty.indexed), {}};
    AddKdTree({}, &scene.indexed);
    NastyRays rays(scene.indexed, rng);
    const Vec3d origin = scene.indexed.geometry.origin;
    for (int tries = 0; tries < 50 && scene.cameras.size() < 2; ++tries) {
      const Vec3d eye = origin + ToDouble(rays.Point()), at = origin + ToDouble(rays.Point());
      const double fov = scene.cameras.empty() ? 60 : 150;
      absl::StatusOr<Camera> camera = LookAt(eye, at, {0.1, 0.3, 1}, fov, kWidth, kHeight);
      if (camera.ok()) scene.cameras.push_back(*camera);
    }
    // One that looks along an axis: rays of whole columns and rows share zeros.
    Camera straight = scene.cameras.empty() ? Camera{} : scene.cameras.front();
    straight.eye = origin + ToDouble(rays.Point());
    straight.right = {1, 0, 0};
    straight.up = {0, 1, 0};
    straight.forward = {0, 0, -1};
    straight.tan_half_fov_y = 1;
    straight.width = kWidth;
    straight.height = kHeight;
    scene.cameras.push_back(straight);
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

std::vector<QueryScene> MakeBuiltinQueryScenes() {
  std::vector<QueryScene> scenes;
  for (const BuiltinInfo& info : BuiltinScenes()) {
    // Brute force is the reference: what does not come small is left to the slower suites.
    if (info.min_triangles > 20'000 || (kSanitizerBuild && info.min_triangles > 2'000)) continue;
    const uint64_t triangles = std::max<uint64_t>(info.min_triangles, 3'000);
    absl::StatusOr<BuiltinScene> builtin =
        MakeBuiltin({.name = std::string(info.name), .target_triangles = triangles});
    EXPECT_TRUE(builtin.ok()) << builtin.status();
    if (!builtin.ok()) continue;
    QueryScene scene{absl::StrCat("builtin:", std::string(info.name)), {}, {}};
    scene.indexed = IndexObjects(builtin->objects, std::nullopt);
    AddKdTree({}, &scene.indexed);
    const BuiltinView& view = builtin->views.front();
    absl::StatusOr<Camera> camera =
        LookAt(view.eye, view.at, view.up, view.fov_y_degrees, kWidth, kHeight);
    EXPECT_TRUE(camera.ok()) << camera.status();
    if (camera.ok()) scene.cameras.push_back(*camera);
    scenes.push_back(std::move(scene));
  }
  return scenes;
}

std::vector<QueryScene> Rebuilt(std::vector<QueryScene> scenes, BvhPreset preset) {
  for (QueryScene& scene : scenes) {
    scene.indexed.bvh = BuildOrFail(scene.indexed.geometry, BvhPresetOptions(preset));
    scene.indexed.kd_tree.reset();
  }
  return scenes;
}

std::vector<QueryScene> Rebuilt(std::vector<QueryScene> scenes, const KdBuildOptions& options) {
  for (QueryScene& scene : scenes) AddKdTree(options, &scene.indexed);
  return scenes;
}

std::vector<LightSample> MakeSamples(const IndexedGeometry& scene, TestRng& rng) {
  NastyRays rays(scene, rng);
  std::vector<LightSample> samples;
  for (uint32_t i = 0; i < 4; ++i) {
    LightSample sample;
    sample.value = rays.Point();  // A vertex, a place on an edge or face, or anywhere.
    sample.light = i;
    sample.source_triangle = rays.Source();
    if (i == 3) sample.mask = 1;
    samples.push_back(sample);
  }
  for (const Vec3f direction : {Vec3f{1, 2, 1}, Vec3f{0.3f, 0.9f, 0.2f}, Vec3f{0, 0, 1}}) {
    LightSample sample;
    sample.directional = true;
    sample.value = direction;
    sample.light = static_cast<uint32_t>(samples.size());
    samples.push_back(sample);
  }
  samples[5].valid = false;
  return samples;
}

PreparedPoints MakePoints(const IndexedGeometry& scene, TestRng& rng, size_t count) {
  NastyRays rays(scene, rng);
  PreparedPoints points;
  for (size_t i = 0; i < count; ++i) {
    const bool valid = !rng.Chance(0.05);
    points.positions.push_back(valid ? rays.Point() : Vec3f{});
    points.sources.push_back(rays.Source());
    points.valid.push_back(valid);
    points.invalid += !valid;
  }
  return points;
}

PreparedSegments MakeSegments(const IndexedGeometry& scene, TestRng& rng, size_t count) {
  NastyRays rays(scene, rng);
  PreparedSegments segments;
  for (size_t i = 0; i < count; ++i) {
    const bool valid = !rng.Chance(0.05);
    const Vec3f from = rays.Point();
    segments.from.push_back(valid ? from : Vec3f{});
    segments.to.push_back(valid ? rays.Target(from, /*segment=*/true) : Vec3f{});
    segments.from_source.push_back(rays.Source());
    segments.to_source.push_back(rays.Source());
    segments.valid.push_back(valid);
    segments.invalid += !valid;
  }
  return segments;
}

std::string Way::Name() const {
  const auto strategy_name = StrategyName(strategy);
  const auto target_name = SimdTargetName(simd);
  const auto structure_name = StructureName(structure);
  return std::string(strategy_name.data(), strategy_name.size()) + " on " +
         std::string(target_name.data(), target_name.size()) + ", structure " +
         std::string(structure_name.data(), structure_name.size()) + ", antialiasing " +
         std::to_string(rtt_antialiasing) + ", " + std::to_string(rtt_side_by_side) +
         " side by side" + (leaf_culling ? ", culling in leaves" : "") + ", packets of " +
         std::to_string(packet_side) + (pixel_shadow_packets ? ", of shadows by pixels" : "");
}

std::vector<Way> AllWays(bool kd_tree) {
  std::vector<Way> ways;
  for (const SimdTarget simd : {SimdTarget::kAvx2, SimdTarget::kAvx512}) {
    if (!SimdTargetAvailable(simd)) continue;
    for (const Strategy strategy : {Strategy::kBruteForce, Strategy::kSingle, Strategy::kPacket,
                                    Strategy::kShaft, Strategy::kAuto}) {
      ways.push_back({strategy, simd});
    }
    // Whole grids of these: tests/property/grid_test.cc.
    for (const Structure structure : {Structure::kBvh, Structure::kKdTree}) {
      if (structure == Structure::kKdTree && !kd_tree) continue;
      ways.push_back({.strategy = Strategy::kSingle,
                      .simd = simd,
                      .structure = structure,
                      .leaf_culling = LeafCulling()});
      ways.push_back({.strategy = Strategy::kPacket,
                      .simd = simd,
                      .structure = structure,
                      .leaf_culling = LeafCulling(),
                      .packet_side = structure == Structure::kBvh ? 4 : 8,
                      .pixel_shadow_packets = structure == Structure::kBvh});
    }
    if (!kd_tree) continue;
    for (const Strategy strategy :
         {Strategy::kSingle, Strategy::kPacket, Strategy::kRtt, Strategy::kAuto}) {
      ways.push_back({strategy, simd, Structure::kKdTree});
    }
    for (const int antialiasing : {2, 3, 4, 6}) {
      ways.push_back({Strategy::kRtt, simd, Structure::kAuto, antialiasing, antialiasing != 3});
    }
    ways.push_back({.strategy = Strategy::kRtt, .simd = simd, .rtt_side_by_side = 1});
  }
  return ways;
}

std::vector<Way> WaysWithoutBvh() {
  std::vector<Way> ways = AllWays(/*kd_tree=*/true);
  std::erase_if(ways, [](const Way& way) {
    return way.structure == Structure::kBvh || way.strategy == Strategy::kShaft;
  });
  return ways;
}

std::vector<Way> InTurn(const std::vector<Way>& ways, TestRng& rng) {
  const size_t stride = kSanitizerBuild ? 3 : 1;
  std::vector<Way> taken;
  for (size_t i = rng.Below(stride); i < ways.size(); i += stride) taken.push_back(ways[i]);
  return taken;
}

}  // namespace sightline::testing_support
