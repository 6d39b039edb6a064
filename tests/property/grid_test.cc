// SPDX-License-Identifier: Apache-2.0
//
// The whole grid of a query's options (grid_options.h) against brute force: every combination there
// is, each over one small scene of several in turn, by a picture and points that fill one packet of
// its size and begin others; and, but for those of the binary BVH, a share of them over one of as
// many whose kd-tree stands alone. How scenes are built, for which of the papers' tests they are
// prepared, the instruction set and the query's mask change from one to the next. By the predicate
// answers have brute force's bits; by the papers' tests they differ from the same test over all
// triangles within its bound; and what has no meaning is refused by name. A camera's rays and a
// light's are asked about by all; suns, segments, shortened shadows, what mirrors show, and a
// larger picture with its lights, some of them by the pixels' own packets, which take the same
// options through other walks or more of them at once, by a share drawn at random.
#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "core/accel/binary_bvh_builder.h"
#include "core/accel/leaf_triangles.h"
#include "core/base/parallel.h"
#include "core/intersect/prepared_geometry.h"
#include "core/mesh/rebase.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/intersector_answers.h"
#include "tests/core/traverse/kernels_fixture.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/property/grid_options.h"
#include "tests/property/paper_answers.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AddKdTree;
using testing_support::AllNamed;
using testing_support::AvailableTargets;
using testing_support::Bit;
using testing_support::CompareHits;
using testing_support::Describe;
using testing_support::Difference;
using testing_support::DifferenceTally;
using testing_support::ForEachQuery;
using testing_support::HasMeaning;
using testing_support::IndexObjects;
using testing_support::IsTheBvhAgain;
using testing_support::kSanitizerBuild;
using testing_support::LeavesEdgesOut;
using testing_support::MakeClosedSphere;
using testing_support::MakeGrid;
using testing_support::MakeNastyScenes;
using testing_support::MakePoints;
using testing_support::MakeSegments;
using testing_support::MayDifferByAnyHit;
using testing_support::NastyRays;
using testing_support::NastyScene;
using testing_support::SameBytes;
using testing_support::TestRng;

// ---- What is asked, and what brute force answers

// So many pixels, and so many valid points that follow one another: a packet of its side is full in
// both, and others are begun. Where packets have no size, what none divides.
struct Shape {
  uint32_t width, height;
  size_t points;
};
constexpr Shape kShapes[] = {{5, 3, 9}, {7, 5, 21}, {11, 9, 69}, {19, 17, 261}, {11, 7, 30}};
static_assert(std::size(kShapes) == kPacketSides.size() + 1);
constexpr Shape kLargest = {19, 17, 261};
// Of one scene more: several tiles and packets of every size, and cut ones.
constexpr Shape kLarge = {37, 33, 700};
static_assert(kLarge.points > static_cast<size_t>(RttTileRays(kMaxRttAntialiasing)));

size_t ShapeOf(const QueryOptions& options) {
  if (options.strategy != Strategy::kPacket) return std::size(kShapes) - 1;
  return static_cast<size_t>(
      std::find(kPacketSides.begin(), kPacketSides.end(), options.packet_side) -
      kPacketSides.begin());
}

constexpr double kShareOfMore = 1.0 / 64, kShareOfAlone = 1.0 / 8;
// Of the large picture: by the predicate alone it has lights.
constexpr double kShareOfLarge = 1.0 / 1024, kShareOfLargeExact = 1.0 / 128;
constexpr double kShareOfMasks = 0.5;  // Of queries that are asked with some mask.
constexpr uint32_t kMasks[] = {0xFFFFFFFFu, 1u, 0x80000002u};
constexpr double kShortened = 0.2;  // ShadowOptions::t_min.
constexpr TileOutputs kTile = {.hits = true, .ids = true, .depth = true, .uv = true};
constexpr TileOutputs kLitTile = {.hits = true, .lit = true};
constexpr TileOutputs kMirrored = {.ids = true, .depth = true, .uv = true, .mirrors = true};
constexpr SegmentOutputs kSegments = {.bits = true, .first_hits = true};
constexpr ShadowOutputs kBlockers = {.bits = true, .blockers = true};

struct Answers {
  TileResult tile;
  ShadowResult lit, blockers;  // By any hit, and by the first.
  bool more = false;           // Whether these were asked about:
  ShadowResult sun_lit, sun_blockers;
  SegmentResult free, segments;
  // By the predicate alone, as where a test is off the hit is another, and what reaches it.
  ShadowResult short_lit, short_sun, short_blockers;
  TileResult mirrored;
  TileResult lit_tile;  // Of the large picture: the light, and the sun.
};

struct GridScene {
  std::string name;
  IndexedGeometry indexed;
  Camera camera;
  LightSample light, sun;
  PreparedPoints points;
  PreparedSegments segments;
  std::vector<Mirror> mirrors;
  std::vector<Shape> shapes;
  // Of queries, the first of all objects; and which of the sets of objects below each sees.
  std::vector<uint32_t> masks = {0xFFFFFFFFu};
  std::vector<size_t> seen_by = {0};
  std::vector<std::vector<std::vector<Answers>>> truth;  // By set, intersector and shape.

  // Amid the picture, where the most is seen.
  TileRect RectOf(const Shape& shape) const {
    return {(camera.width - shape.width) / 2, (camera.height - shape.height) / 2, shape.width,
            shape.height};
  }
  // So many that the shape's number of them is valid: packets hold no others.
  size_t PointsOf(const Shape& shape) const {
    size_t count = 0;
    for (size_t valid = 0; valid < shape.points && count < points.size(); ++count) {
      valid += points.valid[count];
    }
    return count;
  }
  bool IsLarge() const { return shapes.size() == 1; }
  const Shape& ShapeFor(const QueryOptions& options) const {
    return shapes[IsLarge() ? 0 : ShapeOf(options)];
  }
  const Answers& Truth(const QueryOptions& options) const {
    const auto mask = std::find(masks.begin(), masks.end(), options.mask) - masks.begin();
    return truth[seen_by[static_cast<size_t>(mask)]][static_cast<size_t>(options.intersector)]
                [IsLarge() ? 0 : ShapeOf(options)];
  }

  absl::Status Ask(const QueryOptions& options, const Shape& shape, bool more,
                   Answers* answers) const {
    answers->more = more;
    const TileRect rect = RectOf(shape);
    absl::Status status = TraceTile(indexed, camera, rect, {}, kTile, options, &answers->tile);
    const PointRange range = PointRange::Slice(points, 0, PointsOf(shape));
    const auto shade = [&](const LightSample& from, const ShadowOptions& shadow,
                           const ShadowOutputs& outputs, ShadowResult* result) {
      if (!status.ok()) return;
      status = ComputeShadows(indexed, range, {&from, 1}, {}, shadow, outputs, options, result);
    };
    shade(light, {}, {.bits = true}, &answers->lit);
    shade(light, {}, kBlockers, &answers->blockers);
    if (!status.ok() || !more) return status;
    shade(sun, {}, {.bits = true}, &answers->sun_lit);
    shade(sun, {}, kBlockers, &answers->sun_blockers);
    if (!status.ok()) return status;
    status = TestSegments(indexed, segments, {.bits = true}, options, &answers->free);
    if (!status.ok()) return status;
    status = TestSegments(indexed, segments, kSegments, options, &answers->segments);
    if (!status.ok() || options.intersector != Intersector::kExact) return status;
    const ShadowOptions shortened = {.t_min = kShortened};
    shade(light, shortened, {.bits = true}, &answers->short_lit);
    shade(sun, shortened, {.bits = true}, &answers->short_sun);
    shade(light, shortened, kBlockers, &answers->short_blockers);
    if (!status.ok()) return status;
    if (!mirrors.empty()) {
      status =
          TraceTile(indexed, camera, rect, {}, mirrors, kMirrored, options, &answers->mirrored);
    }
    if (!status.ok() || !IsLarge()) return status;
    const LightSample lights[] = {light, sun};
    return TraceTile(indexed, camera, rect, lights, kLitTile, options, &answers->lit_tile);
  }
};

template <typename T, size_t kCount>
T OneOf(TestRng& rng, const T (&values)[kCount]) {
  return values[rng.Below(kCount)];
}

void LayOutKdLeaves(bool wanted, IndexedGeometry* indexed) {
  const auto& ids = indexed->kd_tree->ids;
  indexed->kd_leaves.reset();
  if (wanted) indexed->kd_leaves = MakeLeafTriangles(indexed->geometry, {ids.data(), ids.size()});
}

// The papers' leaf sizes, as costs say or kept to, and their other rules to stop; laid out
// beforehand, or not.
void AddTrees(TestRng& rng, IndexedGeometry* indexed) {
  const int kd_leaf = OneOf(rng, {1, 4, 8, 16, 32});
  AddKdTree({.traversal_cost = OneOf(rng, {0.01f, 0.3f, 3.0f, 10.0f}),
             .perfect_splits = rng.Chance(0.4),
             .min_leaf_triangles = kd_leaf,
             .max_leaf_triangles = OneOf(rng, {0, kd_leaf}),
             .max_depth = OneOf(rng, {0, 0, 3, static_cast<int>(kMaxKdDepth)}),  // 0: PBRT's.
             .max_references = OneOf(rng, {1.0f, 6.0f, kMaxKdReferences})},
            indexed);
  LayOutKdLeaves(rng.Chance(0.5), indexed);
  ThreadPool pool(1);
  absl::StatusOr<BinaryBvh> binary =
      BuildBinaryBvh(indexed->geometry,
                     {.bins = OneOf(rng, {2, 8, 64, 1024}),
                      .cost_ratio = OneOf(rng, {0.01f, 0.1f, 1.0f, 10.0f}),
                      .min_triangles = OneOf(rng, {1, 4, 8, 16, 32}),
                      .max_depth = OneOf(rng, {3, 64, 64}),
                      .stop_by_cost = rng.Chance(0.5),
                      .min_extent = OneOf(rng, {0x1p-23f, 0.05f})},
                     pool);
  EXPECT_TRUE(binary.ok()) << binary.status();
  if (binary.ok()) indexed->binary_bvh = *std::move(binary);
  indexed->bvh = testing_support::BuildOrFail(
      indexed->geometry,
      BvhPresetOptions(OneOf(rng, {BvhPreset::kStatic, BvhPreset::kDynamic, BvhPreset::kCompact})));
}

// Whether mirrors take a good part of the picture, but not all.
bool SeesMirrors(const GridScene& scene) {
  const Camera& camera = scene.camera;
  TileResult tile;
  const absl::Status status =
      TraceTile(scene.indexed, camera, {0, 0, camera.width, camera.height}, {}, scene.mirrors,
                kMirrored, {.strategy = Strategy::kBruteForce}, &tile);
  if (!status.ok()) return false;  // The eye may lie in the mirror.
  uint32_t mirrored = 0;
  for (const uint8_t byte : tile.mirror_bits) {
    mirrored += static_cast<uint32_t>(std::popcount(byte));
  }
  const uint32_t pixels = camera.width * camera.height;
  return mirrored > pixels / 4 && mirrored < pixels;
}

// Which of the objects a query of that mask sees, and which of them its light's shadows.
std::vector<bool> SeenBy(const GridScene& scene, uint32_t mask) {
  std::vector<bool> seen;
  for (const ObjectRecord& object : scene.indexed.geometry.objects) {
    seen.push_back((object.mask & mask) != 0);
    seen.push_back((object.mask & mask & scene.light.mask) != 0);
  }
  return seen;
}

// What brute force answers by each mask; by those that see the same objects, once.
void AddMasks(GridScene* scene) {
  scene->masks.assign(std::begin(kMasks), std::end(kMasks));
  if (!scene->indexed.geometry.uniform) scene->masks.push_back(0);
  scene->seen_by.clear();
  std::vector<std::vector<bool>> sets;
  for (const uint32_t mask : scene->masks) {
    const std::vector<bool> seen = SeenBy(*scene, mask);
    const auto found = std::find(sets.begin(), sets.end(), seen);
    scene->seen_by.push_back(static_cast<size_t>(found - sets.begin()));
    if (found != sets.end()) continue;
    sets.push_back(seen);
    std::vector<std::vector<Answers>>& of_set = scene->truth.emplace_back();
    for (const Intersector intersector : AllNamed(&IntersectorName)) {
      QueryOptions options;
      options.strategy = Strategy::kBruteForce;
      options.intersector = intersector;
      options.mask = mask;
      std::vector<Answers>& truth = of_set.emplace_back();
      for (const Shape& shape : scene->shapes) {
        const absl::Status status =
            scene->Ask(options, shape, /*more=*/true, &truth.emplace_back());
        EXPECT_TRUE(status.ok()) << status;
      }
    }
  }
}

GridScene Finish(std::string name, IndexedGeometry indexed, std::vector<Mirror> mirrors,
                 std::vector<Shape> shapes, TestRng& rng) {
  GridScene scene;
  scene.name = std::move(name);
  scene.indexed = std::move(indexed);
  scene.mirrors = std::move(mirrors);
  scene.shapes = std::move(shapes);
  AddTrees(rng, &scene.indexed);
  const bool large = scene.IsLarge();
  NastyRays rays(scene.indexed, rng);
  const Vec3d origin = scene.indexed.geometry.origin;
  bool found = false;
  for (int tries = 0; tries < 1000 && !found; ++tries) {
    const absl::StatusOr<Camera> camera =
        LookAt(origin + ToDouble(rays.Point()), origin + ToDouble(rays.Point()), {0.1, 0.3, 1}, 70,
               large ? kLarge.width : kLargest.width, large ? kLarge.height : kLargest.height);
    if (!camera.ok()) continue;
    scene.camera = *camera;
    found = scene.mirrors.empty() || SeesMirrors(scene);
  }
  EXPECT_TRUE(found) << "no camera sees the scene, or its mirrors";
  scene.light.value = rays.Point();
  scene.light.mask = 0x80000001u;  // Sees less than the query where they share no bit.
  scene.sun.directional = true;
  scene.sun.value = rays.Target({}, /*segment=*/false);
  const size_t valid = large ? kLarge.points : kLargest.points;
  scene.points = MakePoints(scene.indexed, rng, 2 * valid);
  EXPECT_GE(scene.points.size() - scene.points.invalid, valid);
  scene.segments = MakeSegments(scene.indexed, rng, 12);
  AddMasks(&scene);
  return scene;
}

std::vector<GridScene> MakeGridScenes(TestRng& rng) {
  const std::vector<Shape> shapes(std::begin(kShapes), std::end(kShapes));
  std::vector<GridScene> scenes;
  // Ordinary: waves with a ball over them, before a mirror.
  ObjectInput ball = MakeClosedSphere(5, 6, 0.7, {0.2, 1, 0.1});
  ball.mask = 1;
  scenes.push_back(Finish("waves, a ball and a mirror",
                          IndexObjects({MakeGrid(5, 0.4, {-2.5, 0, -2.5}, rng), ball,
                                        MakeGrid(2, 0, {-1, 2.5, -1}, rng)},
                                       std::nullopt),
                          {Mirror{.object = 2}}, shapes, rng));
  for (NastyScene& nasty : MakeNastyScenes(rng)) {
    for (const absl::string_view name :
         {"slivers", "coplanar and duplicate faces", "a closed box", "masks and culling",
          "mixed exponents, fewer", "zero areas and non-finite corners"}) {
      if (nasty.name == name) {
        scenes.push_back(Finish(nasty.name, std::move(nasty.indexed), {}, shapes, rng));
        break;
      }
    }
  }
  // Each prepared for one of the papers' tests; the others prepare each triangle anew.
  std::vector<Intersector> kinds(kPaperIntersectors.begin(), kPaperIntersectors.end());
  for (GridScene& scene : scenes) {
    std::swap(kinds[rng.Below(kinds.size())], kinds.back());
    scene.indexed.prepared = PrepareGeometry(scene.indexed.geometry, kinds.back());
    if (kinds.size() > 1) kinds.pop_back();
  }
  return scenes;
}

GridScene MakeLargePicture(TestRng& rng) {
  ObjectInput ball = MakeClosedSphere(5, 6, 0.7, {0.2, 1, 0.1});
  ball.mask = 1;
  return Finish("a ball over a mirror, a large picture",
                IndexObjects({MakeGrid(3, 0, {-3, 0, -3}, rng), ball}, std::nullopt),
                {Mirror{.object = 0}}, {kLarge}, rng);
}

// The same scenes and answers without their BVHs. Some kd-trees are cut as finely as can be.
std::vector<GridScene> OnKdTreesAlone(const std::vector<GridScene>& scenes, TestRng& rng) {
  std::vector<GridScene> alone = scenes;
  for (size_t i = 0; i < alone.size(); ++i) {
    IndexedGeometry& indexed = alone[i].indexed;
    alone[i].name += ", a kd-tree alone";
    AddKdTree({.traversal_cost = 0.1f,
               .perfect_splits = i % 2 == 0,
               .min_leaf_triangles = OneOf(rng, {1, 3, 12})},
              &indexed);
    LayOutKdLeaves(i % 3 == 0, &indexed);
    indexed.bvh = Bvh();
    EXPECT_TRUE(indexed.kd_tree_alone());
  }
  return alone;
}

// ---- Comparisons

void ExpectSameBits(const Answers& a, const Answers& b) {
  EXPECT_TRUE(SameBytes(a.tile.hit_bits, b.tile.hit_bits));
  EXPECT_TRUE(SameBytes(a.tile.triangle, b.tile.triangle));
  EXPECT_TRUE(SameBytes(a.tile.depth, b.tile.depth));
  EXPECT_TRUE(SameBytes(a.tile.u, b.tile.u));
  EXPECT_TRUE(SameBytes(a.tile.v, b.tile.v));
  EXPECT_TRUE(SameBytes(a.lit.lit_bits, b.lit.lit_bits));
  EXPECT_TRUE(SameBytes(a.blockers.lit_bits, b.blockers.lit_bits));
  EXPECT_TRUE(SameBytes(a.blockers.blocker, b.blockers.blocker));
  EXPECT_TRUE(SameBytes(a.blockers.blocker_t, b.blockers.blocker_t));
  if (!a.more) return;
  EXPECT_TRUE(SameBytes(a.sun_lit.lit_bits, b.sun_lit.lit_bits));
  EXPECT_TRUE(SameBytes(a.sun_blockers.lit_bits, b.sun_blockers.lit_bits));
  EXPECT_TRUE(SameBytes(a.sun_blockers.blocker, b.sun_blockers.blocker));
  EXPECT_TRUE(SameBytes(a.sun_blockers.blocker_t, b.sun_blockers.blocker_t));
  EXPECT_TRUE(SameBytes(a.free.blocked_bits, b.free.blocked_bits));
  EXPECT_TRUE(SameBytes(a.segments.blocked_bits, b.segments.blocked_bits));
  EXPECT_TRUE(SameBytes(a.segments.triangle, b.segments.triangle));
  EXPECT_TRUE(SameBytes(a.segments.t, b.segments.t));
  EXPECT_TRUE(SameBytes(a.short_lit.lit_bits, b.short_lit.lit_bits));
  EXPECT_TRUE(SameBytes(a.short_sun.lit_bits, b.short_sun.lit_bits));
  EXPECT_TRUE(SameBytes(a.short_blockers.lit_bits, b.short_blockers.lit_bits));
  EXPECT_TRUE(SameBytes(a.short_blockers.blocker, b.short_blockers.blocker));
  EXPECT_TRUE(SameBytes(a.short_blockers.blocker_t, b.short_blockers.blocker_t));
  EXPECT_TRUE(SameBytes(a.mirrored.triangle, b.mirrored.triangle));
  EXPECT_TRUE(SameBytes(a.mirrored.depth, b.mirrored.depth));
  EXPECT_TRUE(SameBytes(a.mirrored.u, b.mirrored.u));
  EXPECT_TRUE(SameBytes(a.mirrored.v, b.mirrored.v));
  EXPECT_TRUE(SameBytes(a.mirrored.mirror_bits, b.mirrored.mirror_bits));
  EXPECT_TRUE(SameBytes(a.lit_tile.hit_bits, b.lit_tile.hit_bits));
  EXPECT_TRUE(SameBytes(a.lit_tile.lit_bits, b.lit_tile.lit_bits));
}

void ExpectWithinBound(const GridScene& scene, const QueryOptions& options, const Answers& a,
                       DifferenceTally* tally) {
  const Intersector kind = options.intersector;
  const Answers& b = scene.Truth(options);
  const Shape& shape = scene.ShapeFor(options);
  const SceneGeometry& geometry = scene.indexed.geometry;
  const bool edges_left_out = LeavesEdgesOut(options);
  const auto compare = [&](const PredicateRay& ray, const Hit& hit, const Hit& truth) {
    const Difference difference = CompareHits(geometry, kind, ray, hit, truth, edges_left_out);
    tally->Add(difference);
    EXPECT_NE(difference, Difference::kBeyondBound)
        << hit.triangle << " at " << hit.t << ", not " << truth.triangle << " at " << truth.t;
    return difference == Difference::kNone;
  };
  Vec3f eye;
  ASSERT_TRUE(Rebase(scene.camera.eye, geometry.origin, &eye));
  const TileRect rect = scene.RectOf(shape);
  for (uint32_t p = 0; p < rect.width * rect.height; ++p) {
    const PredicateRay ray = PredicateRay::Ray(
        eye, PixelDirection(scene.camera, rect.x + p % rect.width, rect.y + p / rect.width));
    if (compare(ray, {a.tile.depth[p], a.tile.triangle[p]},
                {b.tile.depth[p], b.tile.triangle[p]})) {
      EXPECT_EQ(a.tile.u[p], b.tile.u[p]);
      EXPECT_EQ(a.tile.v[p], b.tile.v[p]);
    }
  }
  const size_t points = scene.PointsOf(shape);
  const auto compare_shadows = [&](const LightSample& light, const ShadowResult& lit,
                                   const ShadowResult& blockers, const ShadowResult& true_lit,
                                   const ShadowResult& true_blockers) {
    for (size_t i = 0; i < points; ++i) {
      if (!scene.points.valid[i]) continue;
      const Vec3f point = scene.points.positions[i];
      const PredicateRay ray = light.directional ? PredicateRay::Ray(point, light.value)
                                                 : PredicateRay::Segment(light.value, point);
      compare(ray, {blockers.blocker_t[i], blockers.blocker[i]},
              {true_blockers.blocker_t[i], true_blockers.blocker[i]});
      const bool is_lit = Bit(lit.lit_bits, i);
      if (is_lit == Bit(true_lit.lit_bits, i)) continue;
      const TraceRay query = {
          .ray = ray, .mask = options.mask & light.mask, .from_source = scene.points.sources[i]};
      EXPECT_TRUE(MayDifferByAnyHit(geometry, kind, query, !is_lit, edges_left_out));
    }
  };
  compare_shadows(scene.light, a.lit, a.blockers, b.lit, b.blockers);
  if (!a.more) return;
  compare_shadows(scene.sun, a.sun_lit, a.sun_blockers, b.sun_lit, b.sun_blockers);
  const PreparedSegments& segments = scene.segments;
  for (size_t i = 0; i < segments.size(); ++i) {
    if (!segments.valid[i]) continue;
    const PredicateRay ray = PredicateRay::Segment(segments.from[i], segments.to[i]);
    compare(ray, {a.segments.t[i], a.segments.triangle[i]},
            {b.segments.t[i], b.segments.triangle[i]});
    if (Bit(a.free.blocked_bits, i) == Bit(b.free.blocked_bits, i)) continue;
    const TraceRay query = {.ray = ray,
                            .mask = options.mask,
                            .from_source = segments.from_source[i],
                            .to_source = segments.to_source[i]};
    EXPECT_TRUE(MayDifferByAnyHit(geometry, kind, query, Bit(a.free.blocked_bits, i),
                                  /*edges_left_out=*/false));
  }
}

// What a scene is to say of the options where it cannot answer them.
std::optional<absl::StatusCode> Refusal(const GridScene& scene, const QueryOptions& options) {
  const bool wants_bvh = options.structure == Structure::kBvh ? options.strategy != Strategy::kRtt
                         : options.structure == Structure::kAuto
                             ? options.strategy == Strategy::kShaft
                             : false;
  if (wants_bvh && scene.indexed.kd_tree_alone()) return absl::StatusCode::kFailedPrecondition;
  if (!HasMeaning(options)) return absl::StatusCode::kInvalidArgument;
  return std::nullopt;
}

// Asks one combination after another, and counts.
class Grid {
 public:
  void Ask(const GridScene& scene, const QueryOptions& options, bool more) {
    // Asked about by some alone, as the truth is that of the predicate.
    answers_.lit_tile = answers_.mirrored = TileResult();
    const absl::Status status = scene.Ask(options, scene.ShapeFor(options), more, &answers_);
    const std::optional<absl::StatusCode> refusal = Refusal(scene, options);
    if (refusal.has_value()) {
      ++refused_;
      EXPECT_EQ(status.code(), *refusal) << Describe(options) << " over " << scene.name;
      EXPECT_TRUE(
          absl::StrContains(status.message(), *refusal == absl::StatusCode::kFailedPrecondition
                                                  ? "needs a BVH"
                                                  : StrategyName(options.strategy)))
          << status << " for " << Describe(options) << " over " << scene.name;
      return;
    }
    ++(scene.indexed.kd_tree_alone() ? answered_alone_ : answered_);
    ASSERT_TRUE(status.ok()) << status << " for " << Describe(options) << " over " << scene.name;
    more_ += more;
    // Objects are left out, not all of them.
    const std::vector<bool> seen = SeenBy(scene, options.mask);
    masked_ += std::find(seen.begin(), seen.end(), true) != seen.end() &&
               seen != SeenBy(scene, 0xFFFFFFFFu);
    for (const uint8_t byte : answers_.mirrored.mirror_bits) mirrored_ += std::popcount(byte);
    prepared_ += scene.indexed.prepared && scene.indexed.prepared->kind == options.intersector;
    pixel_packets_ += options.pixel_shadow_packets && options.strategy == Strategy::kPacket &&
                      !answers_.lit_tile.lit_bits.empty();
    for (const QueryStats* stats :
         {&answers_.tile.primary, &answers_.lit.stats, &answers_.blockers.stats}) {
      tiles_answered_ += stats->tiles_answered;
      culled_tests_ += stats->culled_tests;
    }
    if (options.intersector == Intersector::kExact) {
      ExpectSameBits(answers_, scene.Truth(options));
    } else {
      ExpectWithinBound(scene, options, answers_, &tally_);
    }
    if (testing::Test::HasFailure()) {
      ADD_FAILURE() << Describe(options) << " over " << scene.name;
    }
  }

  uint64_t answered() const { return answered_; }
  uint64_t masked() const { return masked_; }
  uint64_t more() const { return more_; }
  uint64_t pixel_packets() const { return pixel_packets_; }
  uint64_t mirrored() const { return mirrored_; }
  uint64_t prepared() const { return prepared_; }
  uint64_t answered_alone() const { return answered_alone_; }
  uint64_t refused() const { return refused_; }
  uint64_t tiles_answered() const { return tiles_answered_; }
  uint64_t culled_tests() const { return culled_tests_; }
  const DifferenceTally& tally() const { return tally_; }

 private:
  Answers answers_;
  uint64_t answered_ = 0, answered_alone_ = 0, refused_ = 0;
  uint64_t tiles_answered_ = 0, culled_tests_ = 0, more_ = 0, pixel_packets_ = 0;
  uint64_t mirrored_ = 0, prepared_ = 0, masked_ = 0;
  DifferenceTally tally_;
};

TEST(GridTest, EveryCombinationAnswersAsBruteForceDoesOrIsRefused) {
  TestRng rng;
  const std::vector<GridScene> scenes = MakeGridScenes(rng);
  ASSERT_EQ(scenes.size(), 7u);
  const std::vector<GridScene> alone = OnKdTreesAlone(scenes, rng);
  const GridScene large = MakeLargePicture(rng);
  // Sanitizers see every so many-th of them.
  const uint64_t step = kSanitizerBuild ? 61 : 1, offset = rng.Below(step);
  uint64_t number = 0;
  Grid grid;
  const std::vector<SimdTarget> targets = AvailableTargets();
  ForEachQuery([&](QueryOptions options) {
    if (testing::Test::HasFailure() || number++ % step != offset) return;
    options.simd = targets[rng.Below(targets.size())];
    const auto ask = [&](const GridScene& scene, QueryOptions asked, bool more) {
      if (rng.Chance(kShareOfMasks)) asked.mask = scene.masks[rng.Below(scene.masks.size())];
      grid.Ask(scene, asked, more);
    };
    const bool exact = options.intersector == Intersector::kExact;
    const bool rtt = options.strategy == Strategy::kRtt, again = IsTheBvhAgain(options);
    if (!again) ask(scenes[rng.Below(scenes.size())], options, rng.Chance(kShareOfMore));
    // All of RTT, and some of the others.
    if (!again && (rtt || rng.Chance(exact ? kShareOfLargeExact : kShareOfLarge))) {
      QueryOptions pixels = options;
      pixels.pixel_shadow_packets = rng.Chance(0.5);
      ask(large, pixels, /*more=*/true);
    }
    // The binary BVH is the same, whatever stands beside it.
    if (options.structure == Structure::kBinaryBvh) return;
    if (!rtt && !rng.Chance(kShareOfAlone)) return;
    ask(alone[rng.Below(alone.size())], options, rng.Chance(kShareOfMore));
  });
  std::cout << grid.answered() << " combinations answered, and " << grid.answered_alone()
            << " by kd-trees alone, " << grid.more() << " with suns and segments, " << grid.masked()
            << " that see some objects alone, " << grid.pixel_packets()
            << " with the pixels' own packets, " << grid.prepared() << " over prepared triangles, "
            << grid.refused() << " refused; " << grid.mirrored() << " pixels of mirrors, "
            << grid.tiles_answered() << " tiles answered, " << grid.culled_tests()
            << " tests culled; the papers' tests: " << grid.tally() << '\n';
  EXPECT_GT(grid.tiles_answered(), 0u);
  EXPECT_GT(grid.more(), 0u);
  EXPECT_GT(grid.culled_tests(), 0u);
  if (kSanitizerBuild) return;
  EXPECT_GT(grid.answered(), 100'000u);
  EXPECT_GT(grid.answered_alone(), 10'000u);
  EXPECT_GT(grid.masked(), 10'000u);
  EXPECT_GT(grid.pixel_packets(), 50u);
  EXPECT_GT(grid.mirrored(), 1'000u);
  EXPECT_GT(grid.prepared(), 10'000u);
  EXPECT_GT(grid.refused(), 50u);
  EXPECT_GT(grid.tally().of(Difference::kNone), grid.tally().compared() * 3 / 4);
}

}  // namespace
}  // namespace sightline
