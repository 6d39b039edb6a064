// SPDX-License-Identifier: Apache-2.0
//
// The whole grid of a query's options, structure × strategy × culling × packet size × intersector,
// and of RTT antialiasing × shared edges × tiles side by side, against brute force: every
// combination there is, each over one small scene of several in turn, and, but for those of the
// binary BVH, a share of them over one of as many whose kd-tree stands alone. By the predicate
// answers have brute force's bits; by the papers' tests they differ from the same test over all
// triangles within its bound; and what has no meaning is refused by name. A camera's rays and a
// light's are asked about by all; suns, segments and a larger picture with its lights, some of them
// by the pixels' own packets, which take the same options through other walks or more of them at
// once, by a share drawn at random.
#include <algorithm>
#include <array>
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
#include "core/intersect/intersector_check.h"
#include "core/mesh/rebase.h"
#include "core/query/segments.h"
#include "core/query/shadows.h"
#include "core/query/tiles.h"
#include "core/traverse/rtt.h"
#include "gtest/gtest.h"
#include "tests/core/intersect/intersector_answers.h"
#include "tests/core/traverse/nasty_scenes.h"
#include "tests/property/query_cases.h"
#include "tests/support/random.h"
#include "tests/support/test_scale.h"

namespace sightline {
namespace {

using testing_support::AddKdTree;
using testing_support::Bit;
using testing_support::CompareHits;
using testing_support::Difference;
using testing_support::DifferenceTally;
using testing_support::IndexObjects;
using testing_support::kSanitizerBuild;
using testing_support::MakeClosedSphere;
using testing_support::MakeGrid;
using testing_support::MakeNastyScenes;
using testing_support::MakePoints;
using testing_support::MakeSegments;
using testing_support::NastyRays;
using testing_support::NastyScene;
using testing_support::SameBytes;
using testing_support::TestRng;

// ---- What there is, as the options themselves say

// All values of an enumeration that counts from 0 and has names.
template <typename T>
std::vector<T> AllNamed(absl::string_view (*name)(T)) {
  std::vector<T> values;
  for (int i = 0; name(static_cast<T>(i)) != "UNKNOWN"; ++i) values.push_back(static_cast<T>(i));
  return values;
}

template <typename T, size_t kCount, typename Fn>
void ForEachOf(const std::array<T, kCount>& values, T* target, const Fn& fn) {
  for (const T value : values) {
    *target = value;
    fn();
  }
}

template <size_t kCount, typename Fn>
void ForEachSwitching(const std::array<bool*, kCount>& switches, const Fn& fn) {
  for (uint32_t bits = 0; bits < 1u << kCount; ++bits) {
    for (size_t i = 0; i < kCount; ++i) *switches[i] = (bits >> i & 1) != 0;
    fn();
  }
}

// fn(culling) for all that packets, or single rays, go by; what only the other goes by stays off.
template <typename Fn>
void ForEachCulling(Structure structure, Strategy strategy, const Fn& fn) {
  LeafCulling culling = LeafCulling::None();
  // A field that is not named here does not compile.
  auto& [tree, intersector, side_planes, near_far, aperture, aperture_first, skip_edges, frustum,
         first_axis, ray_mask, node_test, split, ray_box, ray_box_min_triangles, ray_box_update,
         mailbox, cell_boxes] = culling;
  static_cast<void>(tree), static_cast<void>(intersector);  // The query's own.
  const std::array<bool*, 7> of_packets = {&side_planes, &near_far,   &aperture, &aperture_first,
                                           &skip_edges,  &first_axis, &ray_mask};
  const std::array<bool*, 3> of_rays = {&ray_box, &ray_box_update, &mailbox};
  const auto call = [&, on_kd_tree = structure == Structure::kKdTree, cells = &cell_boxes] {
    fn(culling);
    if (!on_kd_tree) return;
    *cells = true;
    fn(culling);
    *cells = false;
  };
  if (strategy == Strategy::kPacket) {
    FrustumRays* const rays = &frustum;
    NodeTest* const test = &node_test;
    PacketSplit* const parts = &split;
    ForEachSwitching(of_packets, [&] {
      ForEachOf(kAllFrustumRays, rays, [&] {
        ForEachOf(kAllNodeTests, test, [&] { ForEachOf(kAllPacketSplits, parts, call); });
      });
    });
    return;
  }
  uint32_t* const least = &ray_box_min_triangles;
  ForEachSwitching(of_rays, [&] { ForEachOf(std::array<uint32_t, 3>{0, 3, 1000}, least, call); });
}

// fn(options) for every combination, sensible or not.
template <typename Fn>
void ForEachQuery(const Fn& fn) {
  for (const Structure structure : AllNamed(&StructureName)) {
    for (const Strategy strategy : AllNamed(&StrategyName)) {
      for (const Intersector intersector : AllNamed(&IntersectorName)) {
        QueryOptions options;
        options.structure = structure;
        options.strategy = strategy;
        options.intersector = intersector;
        const bool packets = strategy == Strategy::kPacket;
        for (const int side : kPacketSides) {
          if (!packets && side != kPacketSides[0]) continue;  // Read by packets alone.
          options.packet_side = side;
          options.leaf_culling.reset();
          fn(options);
          if (structure == Structure::kAuto && packets) continue;  // The BVH, again.
          if (!packets && strategy != Strategy::kSingle) {
            options.leaf_culling = LeafCulling();
            fn(options);
            continue;
          }
          ForEachCulling(structure, strategy, [&](const LeafCulling& culling) {
            options.leaf_culling = culling;
            fn(options);
          });
        }
        if (strategy != Strategy::kRtt) continue;
        options.leaf_culling.reset();
        for (int n = 1; n <= kMaxRttAntialiasing; ++n) {
          options.rtt_antialiasing = n;
          for (const bool shared : {false, true}) {
            options.rtt_shared_edges = shared;
            for (int tiles = 0; tiles <= kMaxRttSideBySide; ++tiles) {
              options.rtt_side_by_side = tiles;
              fn(options);
            }
          }
        }
      }
    }
  }
}

std::string Describe(const QueryOptions& options) {
  std::string text =
      absl::StrCat(StrategyName(options.strategy), " on ", StructureName(options.structure), ", ",
                   IntersectorName(options.intersector), ", packets of ", options.packet_side,
                   ", antialiasing ", options.rtt_antialiasing, ", ", options.rtt_side_by_side,
                   " side by side", options.rtt_shared_edges ? ", shared edges" : "");
  if (!options.leaf_culling) return text;
  const LeafCulling& c = *options.leaf_culling;
  for (const bool on :
       {c.side_planes, c.near_far, c.aperture, c.aperture_first, c.skip_edges, c.first_axis,
        c.ray_mask, c.ray_box, c.ray_box_update, c.mailbox, c.cell_boxes}) {
    absl::StrAppend(&text, on ? " 1" : " 0");
  }
  absl::StrAppend(&text, ", frustum ", static_cast<int>(c.frustum), ", nodes ",
                  static_cast<int>(c.node_test), ", split ", static_cast<int>(c.split), ", from ",
                  c.ray_box_min_triangles, " triangles");
  return text;
}

// ---- What is asked, and what brute force answers

constexpr uint32_t kWidth = 11, kHeight = 7;  // No side of a packet divides them.
// Of one scene more: several tiles and packets of every size, and cut ones.
constexpr uint32_t kLargeWidth = 37, kLargeHeight = 33;
constexpr double kShareOfMore = 1.0 / 64, kShareOfLarge = 1.0 / 512, kShareOfAlone = 1.0 / 8;
constexpr TileOutputs kLitTile = {.hits = true, .lit = true};
constexpr SegmentOutputs kSegments = {.bits = true, .first_hits = true};
constexpr TileOutputs kTile = {.hits = true, .ids = true, .depth = true, .uv = true};
constexpr ShadowOutputs kBlockers = {.bits = true, .blockers = true};

struct Answers {
  TileResult tile;
  ShadowResult lit, blockers;  // By any hit, and by the first.
  bool more = false;           // Whether these were asked about:
  ShadowResult sun_lit, sun_blockers;
  SegmentResult free, segments;
  TileResult lit_tile;  // Of the large picture by the predicate alone: the light, and the sun.
};

struct GridScene {
  std::string name;
  IndexedGeometry indexed;
  Camera camera;
  LightSample light, sun;
  PreparedPoints points;
  PreparedSegments segments;
  std::vector<Answers> truth;  // By intersector.

  absl::Status Ask(const QueryOptions& options, bool more, Answers* answers) const {
    answers->more = more;
    absl::Status status = TraceTile(indexed, camera, {0, 0, camera.width, camera.height}, {}, kTile,
                                    options, &answers->tile);
    if (!status.ok()) return status;
    const PointRange range = PointRange::Slice(points, 0, points.size());
    const auto shade = [&](const LightSample& from, ShadowResult* lit, ShadowResult* blockers) {
      const std::span<const LightSample> one(&from, 1);
      status = ComputeShadows(indexed, range, one, {}, {}, {.bits = true}, options, lit);
      if (!status.ok()) return;
      status = ComputeShadows(indexed, range, one, {}, {}, kBlockers, options, blockers);
    };
    shade(light, &answers->lit, &answers->blockers);
    if (!status.ok() || !more) return status;
    shade(sun, &answers->sun_lit, &answers->sun_blockers);
    if (!status.ok()) return status;
    status = TestSegments(indexed, segments, {.bits = true}, options, &answers->free);
    if (!status.ok()) return status;
    status = TestSegments(indexed, segments, kSegments, options, &answers->segments);
    if (!status.ok() || !ShadesPixels(options)) return status;
    const LightSample lights[] = {light, sun};
    return TraceTile(indexed, camera, {0, 0, camera.width, camera.height}, lights, kLitTile,
                     options, &answers->lit_tile);
  }

  // Where a test is off the hit is another, and what reaches it: these are not compared.
  bool ShadesPixels(const QueryOptions& options) const {
    return camera.width == kLargeWidth && options.intersector == Intersector::kExact;
  }
};

// Leaves of all structures hold many triangles, and some few.
GridScene Finish(std::string name, IndexedGeometry indexed, TestRng& rng, uint32_t width = kWidth,
                 uint32_t height = kHeight) {
  GridScene scene{std::move(name), std::move(indexed), {}, {}, {}, {}, {}, {}};
  AddKdTree({.traversal_cost = 0.3f, .min_leaf_triangles = 12}, &scene.indexed);
  ThreadPool pool(1);
  absl::StatusOr<BinaryBvh> binary =
      BuildBinaryBvh(scene.indexed.geometry, {.cost_ratio = 0.1f}, pool);
  EXPECT_TRUE(binary.ok()) << binary.status();
  if (binary.ok()) scene.indexed.binary_bvh = *std::move(binary);
  NastyRays rays(scene.indexed, rng);
  const Vec3d origin = scene.indexed.geometry.origin;
  absl::StatusOr<Camera> camera = absl::UnknownError("none");
  for (int tries = 0; tries < 50 && !camera.ok(); ++tries) {
    camera = LookAt(origin + ToDouble(rays.Point()), origin + ToDouble(rays.Point()), {0.1, 0.3, 1},
                    70, width, height);
  }
  EXPECT_TRUE(camera.ok()) << camera.status();
  if (camera.ok()) scene.camera = *camera;
  scene.light.value = rays.Point();
  scene.sun.directional = true;
  scene.sun.value = rays.Target({}, /*segment=*/false);
  scene.points = MakePoints(scene.indexed, rng, 30);
  scene.segments = MakeSegments(scene.indexed, rng, 12);
  for (const Intersector intersector : AllNamed(&IntersectorName)) {
    scene.truth.emplace_back();
    QueryOptions options;
    options.strategy = Strategy::kBruteForce;
    options.intersector = intersector;
    const absl::Status status = scene.Ask(options, /*more=*/true, &scene.truth.back());
    EXPECT_TRUE(status.ok()) << status;
  }
  return scene;
}

std::vector<GridScene> MakeGridScenes(TestRng& rng) {
  std::vector<GridScene> scenes;
  // Ordinary: waves with a ball over them.
  scenes.push_back(Finish("waves and a ball",
                          IndexObjects({MakeGrid(5, 0.4, {-2.5, 0, -2.5}, rng),
                                        MakeClosedSphere(5, 6, 0.7, {0.2, 1, 0.1})},
                                       std::nullopt),
                          rng));
  for (NastyScene& nasty : MakeNastyScenes(rng)) {
    for (const absl::string_view name :
         {"slivers", "coplanar and duplicate faces", "a closed box", "masks and culling",
          "mixed exponents, fewer", "zero areas and non-finite corners"}) {
      if (nasty.name == name) {
        scenes.push_back(Finish(nasty.name, std::move(nasty.indexed), rng));
        break;
      }
    }
  }
  return scenes;
}

GridScene MakeLargePicture(TestRng& rng) {
  return Finish(
      "a ball over a floor, a large picture",
      IndexObjects({MakeGrid(3, 2, {-3, 0, -3}, rng), MakeClosedSphere(5, 6, 0.7, {0.2, 1, 0.1})},
                   std::nullopt),
      rng, kLargeWidth, kLargeHeight);
}

// The same scenes and answers without their BVHs. Some kd-trees are cut as finely as can be, and
// some have their leaves laid out: neither is what the scenes beside a BVH have.
std::vector<GridScene> OnKdTreesAlone(const std::vector<GridScene>& scenes) {
  std::vector<GridScene> alone = scenes;
  for (size_t i = 0; i < alone.size(); ++i) {
    alone[i].name += ", a kd-tree alone";
    AddKdTree({.traversal_cost = 0.1f, .perfect_splits = i % 2 == 0, .min_leaf_triangles = 3},
              &alone[i].indexed);
    if (i % 3 == 0) {
      const auto& ids = alone[i].indexed.kd_tree->ids;
      alone[i].indexed.kd_leaves =
          MakeLeafTriangles(alone[i].indexed.geometry, {ids.data(), ids.size()});
    }
    alone[i].indexed.bvh = Bvh();
    EXPECT_TRUE(alone[i].indexed.kd_tree_alone());
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
  EXPECT_TRUE(SameBytes(a.lit_tile.hit_bits, b.lit_tile.hit_bits));
  EXPECT_TRUE(SameBytes(a.lit_tile.lit_bits, b.lit_tile.lit_bits));
}

// Whether `says` is true of what the test has to say of some triangle that may block the ray,
// and of whether it does so from either side.
template <typename Says>
bool AnyTriangle(const GridScene& scene, Intersector kind, const PredicateRay& ray, uint32_t source,
                 uint32_t other, uint32_t mask, const Says& says) {
  const SceneGeometry& geometry = scene.indexed.geometry;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    const ObjectRecord& object = geometry.objects[geometry.ObjectOf(id)];
    if (id == source || id == other || (object.mask & mask) == 0) continue;
    if (std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) continue;
    const auto [a, b, c] = geometry.Corners(id);
    if (says(CheckIntersector(kind, ray, a, b, c), object.culling == Culling::kNone)) return true;
  }
  return false;
}

// Beyond doubt: then no walk may miss them all.
bool SurelyBlocks(const IntersectorCheck& check, bool two_sided) {
  return check.hit && check.certain && two_sided;
}
// What a walk that leaves edge tests out may find.
bool IsDeniedInDoubt(const IntersectorCheck& check, bool) { return !check.hit && !check.certain; }

void ExpectWithinBound(const GridScene& scene, const QueryOptions& options, const Answers& a,
                       DifferenceTally* tally) {
  const Intersector kind = options.intersector;
  const Answers& b = scene.truth[static_cast<size_t>(kind)];
  const SceneGeometry& geometry = scene.indexed.geometry;
  const bool edges_left_out = options.strategy == Strategy::kPacket && options.leaf_culling &&
                              options.leaf_culling->aperture && options.leaf_culling->skip_edges;
  const auto compare = [&](const PredicateRay& ray, const Hit& hit, const Hit& truth) {
    const Difference difference = CompareHits(geometry, kind, ray, hit, truth, edges_left_out);
    tally->Add(difference);
    EXPECT_NE(difference, Difference::kBeyondBound)
        << hit.triangle << " at " << hit.t << ", not " << truth.triangle << " at " << truth.t;
    return difference == Difference::kNone;
  };
  Vec3f eye;
  ASSERT_TRUE(Rebase(scene.camera.eye, geometry.origin, &eye));
  const uint32_t width = scene.camera.width;
  for (uint32_t p = 0; p < width * scene.camera.height; ++p) {
    const PredicateRay ray =
        PredicateRay::Ray(eye, PixelDirection(scene.camera, p % width, p / width));
    if (compare(ray, {a.tile.depth[p], a.tile.triangle[p]},
                {b.tile.depth[p], b.tile.triangle[p]})) {
      EXPECT_EQ(a.tile.u[p], b.tile.u[p]);
      EXPECT_EQ(a.tile.v[p], b.tile.v[p]);
    }
  }
  const auto compare_shadows = [&](const LightSample& light, const ShadowResult& lit,
                                   const ShadowResult& blockers, const ShadowResult& true_lit,
                                   const ShadowResult& true_blockers) {
    for (size_t i = 0; i < scene.points.size(); ++i) {
      if (!scene.points.valid[i]) continue;
      const Vec3f point = scene.points.positions[i];
      const PredicateRay ray = light.directional ? PredicateRay::Ray(point, light.value)
                                                 : PredicateRay::Segment(light.value, point);
      compare(ray, {blockers.blocker_t[i], blockers.blocker[i]},
              {true_blockers.blocker_t[i], true_blockers.blocker[i]});
      if (Bit(lit.lit_bits, i) == Bit(true_lit.lit_bits, i)) continue;
      const auto any = [&](const auto& says) {
        return AnyTriangle(scene, kind, ray, scene.points.sources[i], kNoTriangle, light.mask,
                           says);
      };
      if (Bit(lit.lit_bits, i)) {
        EXPECT_FALSE(any(SurelyBlocks));
      } else {
        EXPECT_TRUE(edges_left_out && any(IsDeniedInDoubt)) << "a blocker that brute force has not";
      }
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
    EXPECT_FALSE(Bit(a.free.blocked_bits, i)) << "a blocker that brute force has not";
    EXPECT_FALSE(AnyTriangle(scene, kind, ray, segments.from_source[i], segments.to_source[i],
                             options.mask, SurelyBlocks));
  }
}

// What CheckOptions is to say: the contract, written down a second time.
bool HasMeaning(const QueryOptions& options) {
  const bool walks = options.strategy == Strategy::kSingle || options.strategy == Strategy::kPacket;
  if (options.strategy == Strategy::kRtt && options.structure == Structure::kBvh) return false;
  if ((options.strategy == Strategy::kRtt || options.strategy == Strategy::kShaft) &&
      options.structure == Structure::kBinaryBvh) {
    return false;
  }
  if (options.strategy == Strategy::kShaft && options.structure == Structure::kKdTree) return false;
  if (options.leaf_culling && !walks) return false;
  if (options.intersector == Intersector::kHavelHeroutDotProduct &&
      options.strategy == Strategy::kPacket) {
    return false;
  }
  return options.intersector == Intersector::kExact || walks ||
         options.strategy == Strategy::kBruteForce;
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
    answers_.lit_tile = TileResult();
    const absl::Status status = scene.Ask(options, more, &answers_);
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
    pixel_packets_ += options.pixel_shadow_packets && options.strategy == Strategy::kPacket &&
                      !answers_.lit_tile.lit_bits.empty();
    for (const QueryStats* stats :
         {&answers_.tile.primary, &answers_.lit.stats, &answers_.blockers.stats}) {
      tiles_answered_ += stats->tiles_answered;
      culled_tests_ += stats->culled_tests;
    }
    if (options.intersector == Intersector::kExact) {
      ExpectSameBits(answers_, scene.truth[0]);
    } else {
      ExpectWithinBound(scene, options, answers_, &tally_);
    }
    if (testing::Test::HasFailure()) {
      ADD_FAILURE() << Describe(options) << " over " << scene.name;
    }
  }

  uint64_t answered() const { return answered_; }
  uint64_t more() const { return more_; }
  uint64_t pixel_packets() const { return pixel_packets_; }
  uint64_t answered_alone() const { return answered_alone_; }
  uint64_t refused() const { return refused_; }
  uint64_t tiles_answered() const { return tiles_answered_; }
  uint64_t culled_tests() const { return culled_tests_; }
  const DifferenceTally& tally() const { return tally_; }

 private:
  Answers answers_;
  uint64_t answered_ = 0, answered_alone_ = 0, refused_ = 0;
  uint64_t tiles_answered_ = 0, culled_tests_ = 0, more_ = 0, pixel_packets_ = 0;
  DifferenceTally tally_;
};

TEST(GridTest, EveryCombinationAnswersAsBruteForceDoesOrIsRefused) {
  TestRng rng;
  const std::vector<GridScene> scenes = MakeGridScenes(rng);
  ASSERT_EQ(scenes.size(), 7u);
  const std::vector<GridScene> alone = OnKdTreesAlone(scenes);
  const GridScene large = MakeLargePicture(rng);
  // Sanitizers see every so many-th of them.
  const uint64_t step = kSanitizerBuild ? 61 : 1, offset = rng.Below(step);
  uint64_t number = 0;
  Grid grid;
  ForEachQuery([&](const QueryOptions& options) {
    if (testing::Test::HasFailure() || number++ % step != offset) return;
    grid.Ask(scenes[rng.Below(scenes.size())], options, rng.Chance(kShareOfMore));
    // All of RTT, and some of the others.
    if (options.strategy == Strategy::kRtt || rng.Chance(kShareOfLarge)) {
      QueryOptions pixels = options;
      pixels.pixel_shadow_packets = rng.Chance(0.5);
      grid.Ask(large, pixels, /*more=*/true);
    }
    // The binary BVH is the same, whatever stands beside it.
    if (options.structure == Structure::kBinaryBvh) return;
    if (options.strategy != Strategy::kRtt && !rng.Chance(kShareOfAlone)) return;
    grid.Ask(alone[rng.Below(alone.size())], options, rng.Chance(kShareOfMore));
  });
  std::cout << grid.answered() << " combinations answered, and " << grid.answered_alone()
            << " by kd-trees alone, " << grid.more() << " with suns and segments, "
            << grid.pixel_packets() << " with the pixels' own packets, " << grid.refused()
            << " refused; " << grid.tiles_answered() << " tiles answered, " << grid.culled_tests()
            << " tests culled; the papers' tests: " << grid.tally() << '\n';
  EXPECT_GT(grid.tiles_answered(), 0u);
  EXPECT_GT(grid.more(), 0u);
  EXPECT_GT(grid.culled_tests(), 0u);
  if (kSanitizerBuild) return;
  EXPECT_GT(grid.answered(), 100'000u);
  EXPECT_GT(grid.answered_alone(), 10'000u);
  EXPECT_GT(grid.pixel_packets(), 10u);
  EXPECT_GT(grid.refused(), 50u);
  EXPECT_GT(grid.tally().of(Difference::kNone), grid.tally().compared() * 3 / 4);
}

}  // namespace
}  // namespace sightline
