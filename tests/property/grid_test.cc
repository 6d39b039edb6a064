// SPDX-License-Identifier: Apache-2.0
//
// The whole grid of a query's options, structure × strategy × culling × packet size × intersector,
// against brute force: every combination there is, each over one small scene of several in turn,
// and, but for those of the binary BVH, over one of as many whose kd-tree stands alone.
// By the predicate answers have brute force's bits; by the papers' tests they differ from the same
// test over all triangles within its bound; and what has no meaning is refused by name.
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
using testing_support::CompareHits;
using testing_support::Difference;
using testing_support::DifferenceTally;
using testing_support::IndexObjects;
using testing_support::kSanitizerBuild;
using testing_support::MakeClosedSphere;
using testing_support::MakeGrid;
using testing_support::MakeNastyScenes;
using testing_support::MakePoints;
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
            fn(options);
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
                   ", antialiasing ", options.rtt_antialiasing);
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
constexpr TileOutputs kTile = {.hits = true, .ids = true, .depth = true, .uv = true};
constexpr ShadowOutputs kBlockers = {.bits = true, .blockers = true};

struct Answers {
  TileResult tile;
  ShadowResult lit, blockers;  // By any hit, and by the first.
};

struct GridScene {
  std::string name;
  IndexedGeometry indexed;
  Camera camera;
  std::vector<LightSample> lights;
  PreparedPoints points;
  std::vector<Answers> truth;  // By intersector.

  absl::Status Ask(const QueryOptions& options, Answers* answers) const {
    absl::Status status =
        TraceTile(indexed, camera, {0, 0, kWidth, kHeight}, {}, kTile, options, &answers->tile);
    if (!status.ok()) return status;
    const PointRange range = PointRange::Slice(points, 0, points.size());
    status = ComputeShadows(indexed, range, lights, {}, {}, {.bits = true}, options, &answers->lit);
    if (!status.ok()) return status;
    return ComputeShadows(indexed, range, lights, {}, {}, kBlockers, options, &answers->blockers);
  }
};

// Leaves of all structures hold many triangles, and some few.
GridScene Finish(std::string name, IndexedGeometry indexed, TestRng& rng) {
  GridScene scene{std::move(name), std::move(indexed), {}, {}, {}, {}};
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
                    70, kWidth, kHeight);
  }
  EXPECT_TRUE(camera.ok()) << camera.status();
  if (camera.ok()) scene.camera = *camera;
  LightSample light;
  light.value = rays.Point();
  scene.lights.push_back(light);
  scene.points = MakePoints(scene.indexed, rng, 30);
  for (const Intersector intersector : AllNamed(&IntersectorName)) {
    scene.truth.emplace_back();
    QueryOptions options;
    options.strategy = Strategy::kBruteForce;
    options.intersector = intersector;
    const absl::Status status = scene.Ask(options, &scene.truth.back());
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
}

// Whether some triangle blocks the ray by that test beyond doubt: then no walk may miss them all.
bool SurelyBlocked(const GridScene& scene, Intersector kind, const PredicateRay& ray,
                   uint32_t source, uint32_t mask) {
  const SceneGeometry& geometry = scene.indexed.geometry;
  for (uint32_t id = 0; id < geometry.triangles.size(); ++id) {
    const ObjectRecord& object = geometry.objects[geometry.ObjectOf(id)];
    if (id == source || (object.mask & mask) == 0 || object.culling != Culling::kNone) continue;
    if (std::binary_search(geometry.inert.begin(), geometry.inert.end(), id)) continue;
    const auto [a, b, c] = geometry.Corners(id);
    const IntersectorCheck check = CheckIntersector(kind, ray, a, b, c);
    if (check.hit && check.certain) return true;
  }
  return false;
}

void ExpectWithinBound(const GridScene& scene, const QueryOptions& options, const Answers& a,
                       DifferenceTally* tally) {
  const Intersector kind = options.intersector;
  const Answers& b = scene.truth[static_cast<size_t>(kind)];
  const SceneGeometry& geometry = scene.indexed.geometry;
  const auto compare = [&](const PredicateRay& ray, const Hit& hit, const Hit& truth) {
    const Difference difference = CompareHits(geometry, kind, ray, hit, truth);
    tally->Add(difference);
    EXPECT_NE(difference, Difference::kBeyondBound)
        << hit.triangle << " at " << hit.t << ", not " << truth.triangle << " at " << truth.t;
    return difference == Difference::kNone;
  };
  Vec3f eye;
  ASSERT_TRUE(Rebase(scene.camera.eye, geometry.origin, &eye));
  for (uint32_t p = 0; p < kWidth * kHeight; ++p) {
    const PredicateRay ray =
        PredicateRay::Ray(eye, PixelDirection(scene.camera, p % kWidth, p / kWidth));
    if (compare(ray, {a.tile.depth[p], a.tile.triangle[p]},
                {b.tile.depth[p], b.tile.triangle[p]})) {
      EXPECT_EQ(a.tile.u[p], b.tile.u[p]);
      EXPECT_EQ(a.tile.v[p], b.tile.v[p]);
    }
  }
  const size_t n = scene.points.size(), row = (n + 7) / 8;
  for (size_t s = 0; s < scene.lights.size(); ++s) {
    const LightSample& light = scene.lights[s];
    for (size_t i = 0; i < n; ++i) {
      if (!scene.points.valid[i]) continue;
      const PredicateRay ray = PredicateRay::Segment(light.value, scene.points.positions[i]);
      const size_t at = s * n + i;
      compare(ray, {a.blockers.blocker_t[at], a.blockers.blocker[at]},
              {b.blockers.blocker_t[at], b.blockers.blocker[at]});
      const auto lit = [&](const std::vector<uint8_t>& bits) {
        return bits[s * row + i / 8] >> (i % 8) & 1;
      };
      if (lit(a.lit.lit_bits) == lit(b.lit.lit_bits)) continue;
      EXPECT_TRUE(lit(a.lit.lit_bits)) << "a blocker that brute force has not";
      EXPECT_FALSE(SurelyBlocked(scene, kind, ray, scene.points.sources[i], light.mask));
    }
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
  void Ask(const GridScene& scene, const QueryOptions& options) {
    const absl::Status status = scene.Ask(options, &answers_);
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
  uint64_t answered_alone() const { return answered_alone_; }
  uint64_t refused() const { return refused_; }
  const DifferenceTally& tally() const { return tally_; }

 private:
  Answers answers_;
  uint64_t answered_ = 0, answered_alone_ = 0, refused_ = 0;
  DifferenceTally tally_;
};

TEST(GridTest, EveryCombinationAnswersAsBruteForceDoesOrIsRefused) {
  TestRng rng;
  const std::vector<GridScene> scenes = MakeGridScenes(rng);
  ASSERT_EQ(scenes.size(), 7u);
  const std::vector<GridScene> alone = OnKdTreesAlone(scenes);
  // Sanitizers see every so many-th of them.
  const uint64_t step = kSanitizerBuild ? 61 : 1, offset = rng.Below(step);
  uint64_t number = 0;
  Grid grid;
  ForEachQuery([&](const QueryOptions& options) {
    if (testing::Test::HasFailure() || number++ % step != offset) return;
    grid.Ask(scenes[rng.Below(scenes.size())], options);
    // The binary BVH is the same, whatever stands beside it.
    if (options.structure == Structure::kBinaryBvh) return;
    grid.Ask(alone[rng.Below(alone.size())], options);
  });
  std::cout << grid.answered() << " combinations answered, and " << grid.answered_alone()
            << " by kd-trees alone, " << grid.refused()
            << " refused; the papers' tests: " << grid.tally() << '\n';
  if (kSanitizerBuild) return;
  EXPECT_GT(grid.answered(), 100'000u);
  EXPECT_GT(grid.answered_alone(), 40'000u);
  EXPECT_GT(grid.refused(), 50u);
  EXPECT_GT(grid.tally().of(Difference::kNone), grid.tally().compared() * 3 / 4);
}

}  // namespace
}  // namespace sightline
